"""``sweepctl calibrate`` as users run it: results shown, confirmed, and written."""

from __future__ import annotations

import io
import math
import tomllib
from typing import TYPE_CHECKING

import pytest

from bridge.bringup.square import SquareResult, Squares
from bridge.bringup.umbmark import Benchmark, Correction
from bridge.config import parse_robot
from bridge.motion.robot_model import RobotModel
from protocol.messages.device import Range
from protocol.messages.values import ResetCause
from sim_device.sweeper import VirtualSweeper
from support.bench_wire import bringup_session
from support.cli import sweepctl
from support.served import PLAN, Served

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.processes import Done

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]

BIAS_DEG_S = 2.0
BIAS = pytest.approx(math.radians(BIAS_DEG_S), abs=1e-5)


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        served.device.sensors.faults.gyro_bias_deg_s = (0.0, 0.0, BIAS_DEG_S)
        yield served


def calibrate(monkeypatch: pytest.MonkeyPatch, answers: str, *arguments: str | Path) -> Done:
    monkeypatch.setattr("sys.stdin", io.StringIO(answers))
    return sweepctl("calibrate", *arguments)


def test_the_gyros_bias_goes_to_file_and_device(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "robot.toml"
    file.write_text('name = "bert" # mine\n')
    gyro = ("gyro", served.port, "--seconds", "2", "--robot", file)
    declined = calibrate(monkeypatch, "n\n", *gyro)
    assert declined.status == 0
    assert "nothing was written" in declined.err
    assert "gyro_bias: 0 -> 0.0349" in declined.err
    assert file.read_text() == 'name = "bert" # mine\n'
    assert served.parameter("gyro_bias") == 0.0

    done = calibrate(monkeypatch, "", *gyro, "--yes", "--json")
    assert done.status == 0
    assert done.json["gyro"]["z"]["bias_rad_s"] == BIAS
    assert done.json["written"]["device"] == ["gyro_bias"]
    model = parse_robot(file.read_text())
    assert model.name == "bert"
    assert model.gyro_bias_rad_s == BIAS
    assert "# mine" in file.read_text()
    assert sweepctl("reboot", served.port).status == 0  # the flash keeps it
    assert served.parameter("gyro_bias") == pytest.approx(math.radians(2.0), abs=1e-5)


def test_a_range_sensor_against_a_tape(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wall is 2.88 m from the sensor. A tape measure shows 2.85 m, so the offset is -3 cm."""
    file = tmp_path / "new.toml"
    asked = ("range", served.port, "--sensor", "ultrasonic", "--at", "2.85", "--robot", file)
    done = calibrate(monkeypatch, "y\ny\n", *asked, "--json")
    assert done.status == 0
    fit = done.json["range"]["ultrasonic"]
    assert fit["scale"] == 1.0
    assert fit["offset_m"] == pytest.approx(-0.03, abs=0.002)
    assert done.json["written"]["needs_reboot"] == ["ultrasonic_scale", "ultrasonic_offset"]
    ultrasonic = tomllib.loads(file.read_text())["ultrasonic"]
    assert ultrasonic["offset_m"] == pytest.approx(fit["offset_m"], abs=1e-6)
    skipped = calibrate(monkeypatch, "n\n", *asked)
    assert skipped.status == 0
    assert "skipped" in skipped.err


def test_a_sensor_that_fails_does_not_discard_the_others(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No obstacle is beside the robot, so the infrared sensor sees none."""
    file = tmp_path / "new.toml"
    asked = ("--sensor", "infrared-left", "--sensor", "ultrasonic", "--at", "2.85")
    done = calibrate(
        monkeypatch, "", "range", served.port, *asked, "--robot", file, "--yes", "--json"
    )
    assert done.status == 1
    assert done.json["failed"] == ["infrared_left"]
    assert "infrared-left: at 2.85 m only 0 of" in done.err
    assert done.json["range"].keys() == {"ultrasonic"}
    assert "offset_m" in tomllib.loads(file.read_text())["ultrasonic"]


def test_a_calibrated_device_sends_corrected_ranges() -> None:
    """The device sends 0.9 times 2.88 m plus 5 cm, before and after a reboot.

    The run is in virtual time.
    """
    device = VirtualSweeper(PLAN, noise="none", seed=1)
    session, _ = bringup_session(device)
    with session:
        assert session.await_newest(Range).ultrasonic_m == pytest.approx(2.88, abs=0.002)
        session.client.set_parameter("ultrasonic_scale", 0.9)
        session.client.set_parameter("ultrasonic_offset", 0.05)
        session.client.save_parameters()
        device.reset(ResetCause.SOFTWARE)
    session, _ = bringup_session(device)
    with session:
        reported = session.await_newest(Range).ultrasonic_m
        assert reported == pytest.approx(0.9 * 2.88 + 0.05, abs=0.002)


def test_no_square_is_driven_without_a_yes(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    done = calibrate(monkeypatch, "", "odometry", served.port)  # the end of the input means no
    assert done.status == 1
    assert "nothing was driven" in done.err
    assert served.device.truth.path_m == 0.0


@pytest.mark.parametrize("refuted", [None, "the error of the new squares is 122.8 mm"])
def test_a_refuted_result_is_never_written(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refuted: str | None
) -> None:
    """The result fails its verification. ``test_calibrate_squares`` tests the driving itself."""
    still = Benchmark((0.0, 0.0), (0.0, 0.0))
    correction = Correction(1.01, 1.02, 0.0, 0.0)
    model = correction.applied_to(RobotModel())
    found = SquareResult(None, (), still, correction, correction, still, model, still, refuted)
    monkeypatch.setattr(Squares, "run", lambda _squares, _asked: found)
    file = tmp_path / "robot.toml"
    asked = ("odometry", served.port, "--robot", file, "--verify", "--yes", "--json")
    done = calibrate(monkeypatch, "", *asked)
    assert sweepctl("reboot", served.port).status == 0  # saved values are in effect from now on
    device = served.parameter("wheel_base")
    assert done.json["odometry"]["refuted"] == refuted
    if refuted is None:
        assert done.status == 0
        assert parse_robot(file.read_text()).wheel_base_m == pytest.approx(0.23 * 1.02)
        assert device == pytest.approx(0.23 * 1.02, rel=1e-6)
    else:
        assert done.status == 1
        assert f"verification failed: {refuted}; nothing was written" in done.err
        assert not file.exists()
        assert device == pytest.approx(0.23)
        assert done.json["written"]["device"] == []


def test_a_file_that_cannot_be_written_changes_nothing(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "no-such-folder" / "robot.toml"
    done = calibrate(monkeypatch, "y\n", "gyro", served.port, "--seconds", "2", "--robot", file)
    assert done.status == 2
    assert "cannot write" in done.err
    assert served.parameter("gyro_bias") == 0.0
