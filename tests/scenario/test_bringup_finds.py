"""Bring-up on the emulated device: it reports each wiring fault, and a correct robot passes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.bringup.port import InterruptedByPersonError
from bridge.bringup.procedure import BringUp
from bridge.errors import CommandRejectedError, ParameterError, StoppedForSafetyError
from bridge.motion.robot_model import RobotModel
from protocol.authentication import key_words
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.messages.device import Imu
from protocol.messages.host import ClearStop, SetKey
from protocol.messages.values import Mode, StopCause
from sim_device.noise import NOISE_LEVELS
from sim_device.sweeper import VirtualSweeper
from support.bench_wire import Scripted, bringup_session
from support.miswired import PLAN, Stand

if TYPE_CHECKING:
    from bridge.bringup.wiring import CheckResult
    from sim_device.sensors.imu import ImuCounts

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

ALL_STEPS = (
    "battery",
    "logic supply",
    "imu gravity",
    "imu rates",
    "encoders at standstill",
    "motor left",
    "encoder left",
    "motor right",
    "encoder right",
    "imu turn",
    "imu nose",
    "imu side",
    "ultrasonic",
    "infrared left",
    "infrared right",
    "bumper left",
    "bumper right",
    "cliff",
    "wheel control left",
    "wheel control right",
)


def brought_up(stand: Stand, *steps: str) -> list[CheckResult]:
    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    session, _ = bringup_session(stand.device)
    with session:
        bench = BringUp(session, person, RobotModel())
        found = bench.run(steps) if steps else bench.run()
    assert [f.line for f in found] == [t for t in person.reported if ": " in t]
    return found


def wrongs(found: list[CheckResult]) -> set[tuple[str, str]]:
    return {(f.step, f.text.split(" (")[0]) for f in found if f.ok is False}


def test_a_correctly_wired_robot_passes_every_check() -> None:
    stand = Stand()
    found = brought_up(stand)
    assert [(f.step, f.ok) for f in found] == [(step, True) for step in ALL_STEPS], found
    device = stand.device
    assert device.firmware.latch.cause is StopCause.SESSION_END
    assert device.firmware.mode is Mode.IDLE
    assert device.truth.left_rad_s == device.truth.right_rad_s == 0.0


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        (["motors swapped"], {("motors", "left and right are swapped")}),
        (["encoders swapped"], {("encoders", "left and right are swapped")}),
        (
            ["motors swapped", "encoders swapped"],
            {("motors", "left and right are swapped"), ("encoders", "left and right are swapped")},
        ),
        (["left motor inverted"], {("motor left", "turns backwards")}),
        (["right motor inverted"], {("motor right", "turns backwards")}),
        (["left encoder inverted"], {("encoder left", "counts in reverse")}),
        (["right encoder inverted"], {("encoder right", "counts in reverse")}),
        # Motor and encoder of one side are both reversed. A closed loop would work, but drive
        # backwards.
        (
            ["left motor inverted", "left encoder inverted"],
            {("motor left", "turns backwards"), ("encoder left", "counts in reverse")},
        ),
        (["left motor dead"], {("motor left", "neither wheel turned")}),
        (["right encoder dead"], {("encoder right", "does not count")}),
    ],
)
def test_motors_and_encoders(wrong: list[str], expected: set[tuple[str, str]]) -> None:
    found = brought_up(Stand(*wrong), "motors", "control")
    assert wrongs(found) == expected
    assert found[-1].step == "wheel control", "a loop over crossed wires is not closed"
    assert found[-1].ok is None


SEEDS = [range(4), pytest.param(range(4, 20), marks=pytest.mark.nightly, id="others")]
IMU_WRONG = {
    "": set[tuple[str, str]](),
    "imu upside down": {
        ("imu gravity", "-z of the IMU points up, not +z"),
        ("imu turn", "-z responds, not +z"),
        ("imu side", "-y responds, not +y"),
    },
    "imu turned": {("imu nose", "-y responds, not +x"), ("imu side", "+x responds, not +y")},
    "gyro inverted": {("imu turn", "-z responds, not +z")},
}


@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("noise", NOISE_LEVELS)
@pytest.mark.parametrize("wrong", IMU_WRONG)
def test_miswired_axes_are_named_at_any_noise(wrong: str, noise: str, seeds: range) -> None:
    for seed in seeds:
        found = brought_up(Stand(wrong, seed=seed, noise=noise), "rest", "axes")
        assert wrongs(found) == IMU_WRONG[wrong], seed
        assert {f.step for f in found if f.ok is not None} >= {"imu turn", "imu nose", "imu side"}


@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("noise", NOISE_LEVELS)
def test_a_gyro_bias_at_rest_is_not_reported_as_a_turn(noise: str, seeds: range) -> None:
    for seed in seeds:
        device = VirtualSweeper(PLAN, noise=noise, seed=seed)
        person = Scripted(confirm=lambda text: "Turn" in text, choose=lambda _text: "n")
        session, _ = bringup_session(device)
        with session:
            turn, *_ = BringUp(session, person, RobotModel()).run(("axes",))
        assert turn.line == "imu turn: skipped: no motion was measured", seed


def test_axes_are_left_out_while_the_robot_is_moved() -> None:
    stand = Stand()
    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    session, _ = bringup_session(stand.device)
    shaken = stand.device.sensors.imu

    def shaking() -> ImuCounts:
        swing = round(131 * 20 * math.sin(stand.device.plant.tick_ms / 80))
        counts = shaken()
        return counts._replace(gyro_z=counts.gyro_z + swing)

    with session, pytest.MonkeyPatch.context() as patch:
        patch.setattr(stand.device.sensors, "imu", shaking)
        (finding,) = BringUp(session, person, RobotModel()).run(("axes",))
    assert finding.ok is None
    assert "is not still" in finding.line
    assert person.asked == [], "no motion is asked for"
    assert sum("the robot was moved: the z rate" in text for text in person.reported) > 1


def test_a_knock_is_not_reported_as_a_tilt() -> None:
    """A side raised for half a second counts. A blow of 2 g along the wrong axis does not."""
    stand = Stand()
    felt = stand.device.sensors.imu
    knocks = iter(range(1_000_000))

    def knocked() -> ImuCounts:
        counts = felt()
        hit = 16384 * 2 if next(knocks) % 100 < 2 else 0
        return counts._replace(accel_y=max(-32768, counts.accel_y - hit))

    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    session, _ = bringup_session(stand.device)
    with session, pytest.MonkeyPatch.context() as patch:
        patch.setattr(stand.device.sensors, "imu", knocked)
        found = BringUp(session, person, RobotModel()).run(("axes",))
    assert [(f.step, f.ok) for f in found] == [
        ("imu turn", True),
        ("imu nose", True),
        ("imu side", True),
    ]


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("ultrasonic dead", {("ultrasonic", "does not respond")}),
        (
            "infrared swapped",
            {
                ("infrared left", "the right one responds"),
                ("infrared right", "the left one responds"),
            },
        ),
        (
            "bumpers swapped",
            {("bumper left", "the right one responds"), ("bumper right", "the left one responds")},
        ),
        ("bumper stuck", {("bumper left", "responds before it is pressed")}),
        ("cliff dead", {("cliff", "does not respond")}),
    ],
)
def test_the_sensors(wrong: str, expected: set[tuple[str, str]]) -> None:
    assert wrongs(brought_up(Stand(wrong), "sensors")) == expected


def test_nothing_turns_before_a_yes() -> None:
    stand = Stand()
    person = Scripted(confirm=lambda _text: False, choose=lambda _text: "n")
    session, _ = bringup_session(stand.device)
    with session:
        found = BringUp(session, person, RobotModel()).run(("motors", "control"))
    assert [(f.step, f.ok) for f in found] == [("motors", None), ("wheel control", None)]
    assert stand.device.plant.wheel_angles_rad == (0.0, 0.0)
    assert any("OFF THE FLOOR" in text for text in person.asked)
    assert stand.device.firmware.mode is Mode.IDLE


def test_the_step_response_is_that_of_the_wheels() -> None:
    stand = Stand()
    session, _ = bringup_session(stand.device)
    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    with session:
        bench = BringUp(session, person, RobotModel())
        bench.run(("control",))
    assert [step.wheel for step in bench.steps] == ["left", "right"]
    for step in bench.steps:
        assert step.steady_m_s == pytest.approx(0.15, rel=0.03)
        # the ramp of 1 m/s² alone takes 0.12 s from 10 to 90 % of 0.15 m/s
        assert 0.08 < step.rise_s < 0.35
        assert step.settled_s < 0.8


def test_a_bus_does_as_well_as_a_line() -> None:
    device = VirtualSweeper(PLAN, noise="none", seed=1, link=CanLink)
    session, wire = bringup_session(device)
    with session:
        names = [p.name for p in session.client.list_parameters()]
        assert names[:3] == ["node", "wheel_diameter", "wheel_base"]
        assert session.client.set_parameter("cruise_speed", 0.15).value == pytest.approx(0.15)
        assert len(session.collect(Imu, 1.0)) == pytest.approx(100, abs=2)
        with pytest.raises(CommandRejectedError, match="other_cause"):
            session.client.command(ClearStop, StopCause.OPERATOR)
        with pytest.raises(ParameterError, match="did you mean cruise_speed"):
            session.client.set_parameter("cruise_sped", 0.1)
    assert wire.closed


def test_quitting_leaves_the_robot_stopped() -> None:
    device = VirtualSweeper(PLAN, noise="none", seed=1)
    session, wire = bringup_session(device)
    with session:
        session.enable(Mode.VELOCITY)
        session.steer(lambda: (0.1, 0.0))
        session.run(2.0)
        assert device.truth.v_m_s == pytest.approx(0.1, abs=0.02)
        session.interrupt()
        with pytest.raises(InterruptedByPersonError):
            session.run(2.0)
    assert device.firmware.latch.cause is StopCause.SESSION_END
    wire.turn(b"", HostNs(wire.now() + 1_000_000_000))
    assert InterruptedByPersonError.exit_status == 1


def test_the_wire_is_released_even_if_the_stop_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    session, wire = bringup_session(VirtualSweeper(PLAN, noise="none", seed=1))
    session.enable(Mode.VELOCITY)

    def unplugged(_data: bytes, _until_ns: int) -> bytes:
        raise OSError("gone")

    monkeypatch.setattr(wire, "turn", unplugged)
    with pytest.raises(OSError, match="gone"):
        session.close()
    assert wire.closed


@pytest.mark.python_only("stops the device from inside")
def test_a_device_that_stops_by_itself_ends_the_procedure() -> None:
    device = VirtualSweeper(PLAN, noise="none", seed=1)
    session, _ = bringup_session(device)
    with session:
        session.enable(Mode.VELOCITY)
        session.steer(lambda: (0.05, 0.0))
        session.run(0.5)
        device.firmware.stop(StopCause.HARDWARE)
        with pytest.raises(StoppedForSafetyError, match="cause: hardware"):
            session.run(5.0)
        session.stop()
        with pytest.raises(StoppedForSafetyError, match="clear_stop=True"):
            session.enable(Mode.VELOCITY)


def test_a_device_with_a_key_is_moved_by_each_holder_of_the_key() -> None:
    device = VirtualSweeper(PLAN, noise="none", seed=1)
    key = bytes(range(1, 17))
    session, _ = bringup_session(device)
    with session:
        session.client.command(SetKey, *key_words(key))
    session, _ = bringup_session(device)
    with session, pytest.raises((CommandRejectedError, StoppedForSafetyError)):
        session.enable(Mode.BRINGUP)
    session, _ = bringup_session(device, key=key)
    with session:
        session.enable(Mode.BRINGUP)
        session.duties(0.3, 0.0)
        session.run(0.5)
        assert device.plant.wheel_angles_rad[0] > 0.5
        session.stop()
        assert session.client.set_parameter("cruise_speed", 0.1).value == pytest.approx(0.1)
