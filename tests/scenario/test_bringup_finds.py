"""Bring-up on the emulated device: each deliberate miswiring is named, and a good robot passes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.bench.bringup import BringUp
from bridge.motion.robot_model import RobotModel
from protocol.values import Mode, StopCause
from support.bench_wire import Scripted, desk_on
from support.miswired import Stand

if TYPE_CHECKING:
    from bridge.bench.wiring import Finding

ALL_STEPS = (
    "battery",
    "logic supply",
    "imu gravity",
    "imu rates",
    "encoders at rest",
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


def brought_up(stand: Stand, *steps: str) -> list[Finding]:
    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    desk, _ = desk_on(stand.device)
    with desk:
        bench = BringUp(desk, person, RobotModel())
        found = bench.run(steps) if steps else bench.run()
    assert [f.line for f in found] == [t for t in person.told if ": " in t]
    return found


def wrongs(found: list[Finding]) -> set[tuple[str, str]]:
    return {(f.step, f.text.split(" (")[0]) for f in found if f.ok is False}


def test_a_robot_wired_as_it_should_be_passes_every_look() -> None:
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
        (["left encoder inverted"], {("encoder left", "counts down forwards")}),
        (["right encoder inverted"], {("encoder right", "counts down forwards")}),
        # both wrong ways round on one side: a closed loop would work, and drive backwards
        (
            ["left motor inverted", "left encoder inverted"],
            {("motor left", "turns backwards"), ("encoder left", "counts down forwards")},
        ),
        (["left motor dead"], {("motor left", "neither wheel turned")}),
        (["right encoder dead"], {("encoder right", "counts nothing")}),
    ],
)
def test_motors_and_encoders(wrong: list[str], expected: set[tuple[str, str]]) -> None:
    found = brought_up(Stand(*wrong), "motors", "control")
    assert wrongs(found) == expected
    assert found[-1].step == "wheel control", "a loop over crossed wires is not closed"
    assert found[-1].ok is None


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        (
            "imu upside down",
            {
                ("imu gravity", "the chip's -z is up, not +z"),
                ("imu turn", "-z answers, not +z"),
                ("imu side", "-y answers, not +y"),
            },
        ),
        (
            "imu turned",
            {("imu nose", "-y answers, not +x"), ("imu side", "+x answers, not +y")},
        ),
        ("gyro inverted", {("imu turn", "-z answers, not +z")}),
    ],
)
def test_the_inertial_sensor(wrong: str, expected: set[tuple[str, str]]) -> None:
    assert wrongs(brought_up(Stand(wrong), "rest", "axes")) == expected


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("ultrasonic dead", {("ultrasonic", "does not answer")}),
        (
            "infrared swapped",
            {
                ("infrared left", "the right one answers"),
                ("infrared right", "the left one answers"),
            },
        ),
        (
            "bumpers swapped",
            {("bumper left", "the right one answers"), ("bumper right", "the left one answers")},
        ),
        ("bumper stuck", {("bumper left", "answers before anybody is near")}),
        ("cliff dead", {("cliff", "does not answer")}),
    ],
)
def test_the_sensors(wrong: str, expected: set[tuple[str, str]]) -> None:
    assert wrongs(brought_up(Stand(wrong), "sensors")) == expected


def test_nothing_turns_before_a_yes() -> None:
    stand = Stand()
    person = Scripted(confirm=lambda _text: False, choose=lambda _text: "n")
    desk, _ = desk_on(stand.device)
    with desk:
        found = BringUp(desk, person, RobotModel()).run(("motors", "control"))
    assert [(f.step, f.ok) for f in found] == [("motors", None), ("wheel control", None)]
    assert stand.device.plant.wheel_angles_rad == (0.0, 0.0)
    assert any("OFF THE FLOOR" in text for text in person.asked)
    assert stand.device.firmware.mode is Mode.IDLE


def test_the_step_response_is_that_of_the_wheels() -> None:
    stand = Stand()
    desk, _ = desk_on(stand.device)
    person = Scripted(confirm=stand.confirm, choose=stand.choose)
    with desk:
        bench = BringUp(desk, person, RobotModel())
        bench.run(("control",))
    assert [step.wheel for step in bench.steps] == ["left", "right"]
    for step in bench.steps:
        assert step.steady_m_s == pytest.approx(0.15, rel=0.03)
        # the ramp of 1 m/s² alone takes 0.12 s from 10 to 90 % of 0.15 m/s
        assert 0.08 < step.rise_s < 0.35
        assert step.settled_s < 0.8
