"""The rules for tilt, lifting, bumps and cliffs, each at its limits."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.bodily import Bump, Cliff, Lifted, Tilt
from bridge.supervise.settings import BumpRule, CliffRule, TiltRule
from protocol.messages.values import Contact, Fault
from support.watching import G_LSB, MODEL, Walk, imu, reading, status

if TYPE_CHECKING:
    from protocol.messages.device import Imu

LEFT, RIGHT, CLIFF = (
    int(Contact.BUMPER_LEFT),
    int(Contact.BUMPER_RIGHT),
    int(Contact.CLIFF),
)


# ---- tilt --------------------------------------------------------------------------------


def leaning(degrees: float, *, aside: bool = False) -> Imu:
    along, up = (round(G_LSB * f(math.radians(degrees))) for f in (math.sin, math.cos))
    return imu(0, along, up) if aside else imu(along, 0, up)


@pytest.mark.parametrize("aside", [False, True])
@pytest.mark.parametrize(("degrees", "found"), [(11.8, False), (12.2, True), (-12.2, True)])
def test_it_leans_beyond_its_limit(degrees: float, *, aside: bool, found: bool) -> None:
    walk = Walk(rule := Tilt(TiltRule(angle_deg=12.0)))
    for _ in range(100):
        walk.step(1, imu=leaning(degrees, aside=aside))
    assert walk.held is found
    assert rule.evidence()[1]["angle_deg"] == pytest.approx(abs(degrees), abs=0.1)


def test_a_shock_is_no_lean() -> None:
    """The rule smooths the accelerometer over 0.2 s, so a tilt of 20° for 40 ms reads 3.8°."""
    walk = Walk(rule := Tilt(TiltRule(angle_deg=5.0)))
    walk.step(50, imu=imu())
    for _ in range(2):
        walk.step(1, imu=leaning(20.0))
    assert not walk.held
    assert rule.evidence()[1]["angle_deg"] == pytest.approx(3.8, abs=0.2)
    for _ in range(2):
        walk.step(1, imu=leaning(20.0))
    assert walk.held


def test_without_a_new_sample_it_stays_as_it_was() -> None:
    walk = Walk(rule := Tilt(TiltRule(angle_deg=12.0)))
    assert not walk.step(3, imu=None)
    sample = leaning(30.0)
    assert walk.step(1, imu=sample)
    assert walk.step(5, imu=sample)
    assert walk.step(1, imu=None)
    rule.restart()
    assert not walk.step(1, imu=None)


def test_a_dead_accelerometer_is_no_lean() -> None:
    assert not Walk(Tilt(TiltRule())).step(2, imu=imu(0, 0, 0))


def test_upside_down_is_a_lean() -> None:
    walk = Walk(rule := Tilt(TiltRule()))
    assert walk.step(2, imu=imu(0, 0, -G_LSB))
    assert rule.evidence()[1]["angle_deg"] == 180.0


# ---- lifted ------------------------------------------------------------------------------


JOLT = round(G_LSB * (1.0 + 2.45 / 9.80665))
"""Acceleration, in LSB, for 0.2 s while a person lifts the robot by 10 cm in 0.4 s."""
NO_JOLT = round(G_LSB * (1.0 + 1.45 / 9.80665))
DROP = round(G_LSB * (1.0 - 2.45 / 9.80665))
LIFT_STEPS = 10
"""Number of control steps with the acceleration ``JOLT``: 0.2 s."""


def jolt(walk: Walk, up: int, steps: int = LIFT_STEPS) -> None:
    for _ in range(steps):
        walk.step(1, imu=imu(0, 0, up), range=reading())


@pytest.mark.parametrize(("up", "found"), [(JOLT, True), (DROP, True), (NO_JOLT, False)])
def test_a_jolt_and_no_floor_is_a_lift(up: int, *, found: bool) -> None:
    walk = Walk(rule := Lifted())
    walk.step(10, imu=imu(), range=reading())
    jolt(walk, up)
    assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found
    if found:
        assert rule.evidence()[1] == {"by": "host"}
        assert walk.step(200, imu=imu(), range=reading(contacts=CLIFF)), (
            "lasts while there is no floor"
        )
        assert not walk.step(1, imu=imu(), range=reading(contacts=LEFT))


def test_a_jolt_of_long_ago_is_no_lift() -> None:
    for steps, found in ((48, True), (55, False)):  # the smoothed jolt lasts for three more steps
        walk = Walk(Lifted())
        jolt(walk, JOLT)
        jolt(walk, G_LSB, steps)
        assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found


def test_vibration_and_a_bias_are_no_jolt() -> None:
    """The bias is 100 mg, and the vibration is 120 mg or -60 mg. The floor is lost at step 151."""
    walk = Walk(Lifted())
    for number in range(200):
        up = round(G_LSB * (1.10 + (0.12 if number % 3 == 0 else -0.06)))
        held = walk.step(1, imu=imu(0, 0, up), range=reading(contacts=CLIFF if number > 150 else 0))
        assert not held


@pytest.mark.parametrize(("steps", "found"), [(5, False), (6, True)])
def test_an_acceleration_becomes_a_jolt_with_the_time_constants_of_the_rule(
    steps: int, *, found: bool
) -> None:
    """After n steps of 20 ms, 2 m/s² become 2 · (0.99^n - 0.75^n): 1.43 after five, 1.53 after six.

    0.75 and 0.99 are 1 - 20 ms / 80 ms and 1 - 20 ms / 2 s.
    """
    walk = Walk(Lifted())
    walk.step(10, imu=imu(), range=reading())
    jolt(walk, round(G_LSB * (1.0 + 2.0 / 9.80665)), steps)
    assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found


@pytest.mark.parametrize(("steps", "found"), [(64, True), (72, False)])
def test_a_lasting_acceleration_becomes_gravity(steps: int, *, found: bool) -> None:
    """1.8 m/s² exceed 1.5 m/s² while 0.99^n > 0.83, for 18 steps. A jolt counts for 50 steps."""
    walk = Walk(Lifted())
    jolt(walk, round(G_LSB * (1.0 + 1.8 / 9.80665)), steps)
    assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found


def test_one_sample_counts_once() -> None:
    walk = Walk(Lifted())
    walk.step(20, imu=imu(0, 0, JOLT), range=reading())  # the same sample in each step
    assert not walk.step(1, imu=imu(), range=reading(contacts=CLIFF))


@pytest.mark.parametrize(
    ("up_m_s2", "step_s", "found"),
    [
        (1.0, 0.3, False),  # longer than the time constant of a jolt: not more than the sample
        (4.0, 3.0, False),  # longer than that of gravity, which is then the sample
        (3.0, 1.0, False),  # 3 m/s², less half of it as gravity: exactly the limit
        (3.1, 1.0, True),
    ],
)
def test_a_long_step_smooths_no_sample_beyond_itself(
    up_m_s2: float, step_s: float, *, found: bool
) -> None:
    rule = Lifted()
    sample: Any = SimpleNamespace(accel_z_m_s2=9.80665 + up_m_s2)
    step: Any = SimpleNamespace(step_s=step_s)
    inputs = RuleInputs(time_s=1.0, pose=Pose2(0.0, 0.0, 0.0), v_m_s=0.0, yaw_rate_rad_s=0.0)
    assert not rule.holds(inputs._replace(imu=sample, range=reading()), step)
    assert rule.holds(inputs._replace(imu=sample, range=reading(contacts=CLIFF)), step) is found


def test_a_jolt_alone_and_a_cliff_alone_are_none() -> None:
    assert not Walk(Lifted()).step(5, imu=imu(0, 0, JOLT), range=reading(contacts=LEFT | RIGHT))
    assert not Walk(Lifted()).step(5, imu=imu(0, 0, JOLT), range=None)
    assert not Walk(Lifted()).step(5, imu=imu(), range=reading(contacts=CLIFF))
    assert not Walk(Lifted()).step(5, imu=None, range=reading(contacts=CLIFF))


def test_the_device_reports_that_it_is_lifted() -> None:
    walk = Walk(rule := Lifted())
    assert walk.step(1, status=status(int(Fault.LIFTED | Fault.IMU)))
    assert rule.evidence()[1] == {"by": "device"}
    assert not walk.step(1, status=status(int(Fault.IMU)))
    jolt(walk, JOLT)
    rule.restart()
    assert not walk.step(1, range=reading(contacts=CLIFF)), "a restart discards the jolt"


# ---- bump --------------------------------------------------------------------------------


def test_count_of_bumps_in_the_window() -> None:
    walk = Walk(rule := Bump(BumpRule(count=3.0, window_s=1.0, held_s=5.0)))
    for number in (1, 2, 3):
        held = walk.step(1, range=reading(contacts=LEFT if number % 2 else RIGHT))
        assert held is (number == 3)
        if number < 3:
            assert not walk.step(4, range=reading())
    assert rule.evidence()[1] == {"count": 3, "window_s": 1.0, "held_s": 0.0}
    assert walk.step(39, range=reading())
    assert not walk.step(2, range=reading()), "the first bump has left the window"


def test_another_half_of_a_pressed_bumper_is_no_new_bump() -> None:
    walk = Walk(Bump(BumpRule(count=2.0, window_s=10.0, held_s=5.0)))
    walk.step(1, range=reading(contacts=LEFT))
    assert not walk.step(1, range=reading(contacts=LEFT | RIGHT))
    assert not walk.step(1, range=reading(contacts=RIGHT))
    assert not walk.step(1, range=reading(contacts=CLIFF)), "the cliff sensor is not a bumper"
    assert walk.step(1, range=reading(contacts=LEFT))


@pytest.mark.parametrize("half", [LEFT, RIGHT])
def test_a_half_that_stays_pressed(half: int) -> None:
    walk = Walk(rule := Bump(BumpRule(count=100.0, window_s=10.0, held_s=2.0)))
    walk.step(1, range=reading(contacts=half))
    assert not walk.step(99, range=reading(contacts=half))
    assert walk.step(2, range=reading(contacts=half))
    assert rule.evidence()[1]["held_s"] == pytest.approx(2.0, abs=0.03)
    assert walk.step(1, range=reading(contacts=LEFT | RIGHT))
    assert not walk.step(1, range=reading(contacts=(LEFT | RIGHT) ^ half))
    assert not walk.step(99, range=reading(contacts=(LEFT | RIGHT) ^ half))


def test_the_same_reading_twice_is_one() -> None:
    walk = Walk(rule := Bump(BumpRule(count=2.0, window_s=10.0, held_s=5.0)))
    touch, free = reading(contacts=LEFT), reading()
    walk.step(3, range=touch)
    walk.step(3, range=free)
    assert not walk.held
    assert rule.evidence()[1] == {"count": 1, "window_s": 10.0, "held_s": 0.0}
    rule.restart()
    walk.step(1, range=reading(contacts=LEFT))
    assert not walk.held
    assert rule.evidence()[1]["count"] == 1, "a restart discards the earlier contact"
    assert not walk.step(1, range=None)


@pytest.mark.parametrize(
    ("made_m", "after_s", "counts"),
    [
        # At 6 cm/s the robot moves 15 mm in 0.25 s and 60 mm in 1 s.
        *((0.0039, 0.25, 2), (0.0041, 0.25, 1), (0.0149, 0.25, 1), (0.0151, 0.25, 2)),
        *((0.0299, 1.0, 1), (0.0301, 1.0, 2), (-0.01, 1.0, 2), (0.0, 1.0, 2)),
        *((0.004, 0.25, 2), (0.03, 1.0, 2)),
    ],
)
def test_a_touch_that_creeps_along_is_one(made_m: float, after_s: float, counts: int) -> None:
    rule, measured = Bump(BumpRule(count=9.0, window_s=8.0, held_s=5.0)), Measured(MODEL)
    for time_s, contacts in ((1.0, LEFT), (1.1, 0), (1.0 + after_s, LEFT)):
        measured.distance_m = made_m * (time_s > 1.1)
        inputs = RuleInputs(
            *(time_s, Pose2(0.0, 0.0, 0.0), 0.0, 0.0), range=reading(contacts=contacts)
        )
        rule.holds(inputs, measured)
    assert rule.evidence()[1]["count"] == counts


def test_a_wall_that_is_followed_slowly_is_no_run_of_bumps() -> None:
    """At 3 cm/s the switch closes every 0.3 s. Each contact continues the contact before it."""
    walk = Walk(rule := Bump(BumpRule()))
    for _ in range(100):
        walk.step(5, left_m=0.0006, right_m=0.0006, range=reading(contacts=LEFT))
        walk.step(10, left_m=0.0006, right_m=0.0006, range=reading())
    assert not walk.held
    assert rule.evidence()[1]["count"] == 0, "the first bump was half a minute ago"
    walk.step(1, range=reading(contacts=LEFT))
    rule.restart()
    walk.step(1, left_m=0.01, right_m=0.01, range=reading(contacts=LEFT))
    assert rule.evidence()[1]["count"] == 1, "after a restart, a contact is a new bump"


# ---- cliff -------------------------------------------------------------------------------


def test_no_floor_is_reported_and_driving_on_is_grave() -> None:
    walk = Walk(rule := Cliff(CliffRule(ahead_m=0.05)))
    assert not walk.step(5, left_m=0.004, right_m=0.004, range=reading(contacts=LEFT))
    assert walk.step(1, left_m=0.004, right_m=0.004, range=reading(contacts=CLIFF))
    grave = [rule.grave]
    for steps, path_m in ((12, 0.004), (1, 0.004), (20, -0.004)):
        walk.step(steps, left_m=path_m, right_m=path_m, range=reading(contacts=CLIFF))
        grave.append(rule.grave)
        if steps == 12:
            assert rule.evidence()[1]["ahead_m"] == pytest.approx(0.048, abs=0.001)
    assert grave == [False, False, True, True], "backing off does not undo the severity"
    held = [walk.step(1, range=reading()), walk.step(1, range=reading(contacts=CLIFF))]
    assert held == [False, True]
    assert rule.evidence() == ("no floor ahead", {"ahead_m": 0.0}), "the distance starts at 0 again"


def test_backing_off_from_a_cliff_is_right() -> None:
    walk = Walk(rule := Cliff(CliffRule(ahead_m=0.05)))
    walk.step(1, range=reading(contacts=CLIFF))
    walk.step(40, left_m=-0.004, right_m=-0.004, range=reading(contacts=CLIFF))
    assert not rule.grave
    assert not walk.step(1, range=None)
