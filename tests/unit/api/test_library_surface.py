"""The public interface of the library: help, values in SI units, error texts for Python."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

import bridge
from bridge.api.remote import reach
from bridge.api.robot import Robot
from bridge.errors import CommandRejectedError, OutputExistsError, Remedy, StoppedForSafetyError
from bridge.run.ending import Ending, cannot_move
from protocol.messages.device import Imu, Range, Status
from tools.cli.remedies import error_line
from tools.dev import planner_reference
from tools.dev.api_reference import PATH, documented, page
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper


@pytest.mark.parametrize("name", ["imu", "encoders", "range", "power", "status", "planner"])
def test_help_names_a_robots_measurements(name: str) -> None:
    found = getattr(Robot, name)
    assert isinstance(found, property)
    assert found.__doc__
    assert inspect.getdoc(found)


def test_help_names_attributes_that_messages_have() -> None:
    text = " ".join(inspect.getdoc(value) or "" for value in vars(Robot).values())
    for kind, names in (
        (Imu, ("accel_x_m_s2", "gyro_x_rad_s", "temperature_deg_c")),
        (Range, ("ultrasonic_m", "infrared_left_m", "contacts")),
        (Status, ("mode", "stop_cause", "faults", "load")),
    ):
        for name in names:
            assert name in text
            assert hasattr(kind, name)


def test_a_message_shows_itself_in_si_units() -> None:
    assert repr(Range(1234, 80, 255, 1, 30)) == (
        "Range(ultrasonic_m=1.234, infrared_left_m=0.1, infrared_right_m=None, contacts=1, "
        "ultrasonic_age_s=0.03)"
    )
    shown = repr(Imu(0, 0, 16384, 0, 0, 0, 131))
    assert "accel_z_m_s2=9.80665" in shown
    assert "gyro_z_rad_s=0.0174533" in shown
    assert "16384" not in shown


def test_a_virtual_robot_and_its_recording_show_themselves(tmp_path: Path) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(room="empty", noise="none"))
    with sweeper.record(tmp_path / "drive.mcap") as recording:
        sweeper.enable()
        sweeper.drive(0.1, 0.0, for_s=1.0)
        assert repr(recording) == f"<Recording {tmp_path}/drive.mcap: open, 0 records dropped>"
    assert "drive.mcap: closed" in repr(recording)
    assert repr(sweeper).startswith("<SimulatedSweeper empty: time_s=")
    assert "x_m=0.3" in repr(sweeper), "it started at 0.3 m and drove less than 0.1 m"
    assert "ultrasonic_m=" in repr(sweeper.range)


def test_an_error_has_the_callers_own_words() -> None:
    ending = Ending("stopped", "the robot has a latched stop", 5, remedy=Remedy.CLEAR_STOP)
    error = cannot_move(ending)
    assert isinstance(error, StoppedForSafetyError)
    assert str(error) == "the robot has a latched stop, then call enable(clear_stop=True)"
    assert error_line(error) == "the robot has a latched stop, then add --clear-stop"
    exists = OutputExistsError(Path("a.mcap"))
    assert "force=True" in str(exists)
    assert "--" not in str(exists)
    assert error_line(exists) == "a.mcap exists; give another name, or --force to replace it"


def test_an_error_without_a_remedy_is_the_same_for_all() -> None:
    error = CommandRejectedError("reboot", "moving")
    assert str(error) == error_line(error) == "the device rejected reboot: moving"


def test_every_remedy_has_words_for_both() -> None:
    for remedy in Remedy:
        error = StoppedForSafetyError("it stands")
        error.remedy = remedy
        assert "--" not in str(error)
        assert "--" in error_line(error)


def test_open_has_the_options_of_a_robot() -> None:
    """The options have equal names, kinds, types and defaults, and none has an arbitrary type."""
    ours, robots = (
        {name: p for name, p in inspect.signature(call).parameters.items() if name != "self"}
        for call in (bridge.open, Robot)
    )
    assert ours == robots
    assert all(p.kind is not p.VAR_KEYWORD for p in ours.values())
    asked = inspect.signature(reach).parameters
    assert set(asked) == set(robots) - {"model", "sink", "timeout_s"}
    assert all(asked[name] == robots[name] for name in asked)


def test_the_reference_page_is_fresh() -> None:
    assert PATH.read_text("utf-8") == page(), "run `python -m tools.dev.api_reference`"


def test_the_page_of_a_planners_interface_is_fresh_and_complete() -> None:
    text = planner_reference.page()
    found = planner_reference.PATH.read_text("utf-8")
    assert found == text, "run `python -m tools.dev.planner_reference`"
    assert "|  |\n" not in text, "a field without a docstring"


def test_everything_on_the_reference_page_is_documented_and_typed() -> None:
    found = dict(documented())
    assert {"Robot.record", "Robot.imu", "Recording.close", "SimulatedSweeper.clean"} <= set(found)
    for name, member in found.items():
        assert inspect.getdoc(member), name
        if not isinstance(member, property):
            parameters = [*inspect.signature(member).parameters.values()][1:]
            assert all(p.annotation is not p.empty for p in parameters), name
