"""UMBmark on the emulated device: it finds deliberate errors with an accuracy of 0.1 %."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.bringup.square import Asked, ByTape, SquareResult, Squares
from bridge.errors import BridgeError, StoppedForSafetyError
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from protocol.messages.values import StopCause
from sim_device import sweeper as device_module
from sim_device.noise import NoiseLevel
from sim_device.sweeper import VirtualSweeper
from support.bench_wire import Scripted, bringup_session

if TYPE_CHECKING:
    from bridge.bringup.person import Person

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

PLAN = parse_floorplan('{"walls": [[0,0],[8,0],[8,8],[0,8]], "start": [4,4,0.3]}')
MODEL = RobotModel()


class ByTruth:
    """Replaces the person's measurement by the plant's true pose."""

    def __init__(self, device: VirtualSweeper) -> None:
        self._device = device
        self._from = device.truth.pose

    def begin(self) -> None:
        self._from = self._device.truth.pose

    def end(self) -> tuple[float, float]:
        here, start = self._device.truth.pose, self._from
        dx, dy = here.x_m - start.x_m, here.y_m - start.y_m
        c, s = math.cos(start.theta_rad), math.sin(start.theta_rad)
        return dx * c + dy * s, dy * c - dx * s


def wrong_wheels(monkeypatch: pytest.MonkeyPatch, seed: int, noise: NoiseLevel) -> VirtualSweeper:
    """Return a device with random wheel diameters and wheelbase, from wide tolerances."""
    monkeypatch.setattr(device_module, "noise_level", lambda _name: noise)
    return VirtualSweeper(PLAN, MODEL, seed=seed)


def calibrated(device: VirtualSweeper, asked: Asked, person: Person | None = None) -> SquareResult:
    session, _ = bringup_session(device)
    with session:
        squares = Squares(session, person or Scripted(), MODEL, ByTruth(device))
        return squares.run(asked)


def test_ratio_base_and_diameter_are_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    wide = NoiseLevel(
        name="wide", wheel_diameter_error=0.01, wheel_mismatch=0.03, wheel_base_error=0.03
    )
    device = wrong_wheels(monkeypatch, 2, wide)
    plant = device.plant
    ratio = plant.right_radius_m / plant.left_radius_m
    assert abs(ratio - 1.0) > 0.003, "an error worth looking for"
    assert abs(plant.wheel_base_m / MODEL.wheel_base_m - 1.0) > 0.003
    found = calibrated(device, Asked(side_m=1.2, runs=1, speed_m_s=0.2, verify=True))
    assert found.model.wheel_ratio == pytest.approx(ratio, rel=1e-3)
    assert found.model.wheel_base_m == pytest.approx(plant.wheel_base_m, rel=1e-3)
    mean_m = plant.right_radius_m + plant.left_radius_m
    assert found.model.wheel_diameter_m == pytest.approx(mean_m, rel=1e-3)
    assert found.before.worst_m > 0.02
    assert found.after.worst_m < 0.1 * found.before.worst_m
    assert found.verified is not None  # the corrected squares were driven and measured too
    assert found.verified.worst_m < 0.1 * found.before.worst_m
    assert found.refuted is None
    assert device.firmware.latch.cause is StopCause.SESSION_END


def test_a_wheel_that_slips_in_the_second_squares_refutes_the_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = wrong_wheels(monkeypatch, 1, NoiseLevel(name="none"))
    squares = 0

    def confirm(text: str) -> bool:
        nonlocal squares
        squares += text.startswith("Square")
        if squares > 2:  # one to the right, one to the left
            device.plant.faults.slip_left = 0.04
        return True

    asked = Asked(side_m=0.8, runs=1, straight=False, verify=True)
    found = calibrated(device, asked, Scripted(confirm=confirm))
    assert found.after.worst_m < 0.002
    assert found.verified is not None
    assert found.verified.worst_m > 0.01
    assert found.refuted is not None
    assert f"new squares is {1000 * found.verified.worst_m:.1f} mm" in found.refuted


def test_a_correct_robot_is_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = calibrated(
        wrong_wheels(monkeypatch, 1, NoiseLevel(name="none")),
        Asked(side_m=0.6, runs=1, straight=False),
    )
    assert found.scale is None
    assert found.model.wheel_ratio == pytest.approx(1.0, abs=4e-4)
    assert found.model.wheel_base_m == pytest.approx(MODEL.wheel_base_m, rel=1e-3)
    assert found.model.wheel_diameter_m == MODEL.wheel_diameter_m


def test_an_obstacle_ends_it_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    device = wrong_wheels(monkeypatch, 1, NoiseLevel(name="none"))
    with pytest.raises(StoppedForSafetyError, match="side of the square ended"):
        calibrated(device, Asked(side_m=5.0, runs=1, straight=False, speed_m_s=0.25))
    assert device.firmware.latch.cause is StopCause.SUPERVISE
    assert device.truth.v_m_s == 0.0


def test_nothing_is_driven_without_a_yes(monkeypatch: pytest.MonkeyPatch) -> None:
    device = wrong_wheels(monkeypatch, 1, NoiseLevel(name="none"))
    with pytest.raises(BridgeError, match="nothing was driven"):
        calibrated(device, Asked(), Scripted(confirm=lambda _text: False))
    assert device.truth.path_m == 0.0


def test_a_tape_is_read_in_millimetres() -> None:
    person = Scripted(number=lambda text: 12.0 if "AHEAD" in text else -7.0)
    assert ByTape(person).end() == pytest.approx((0.012, -0.007))
