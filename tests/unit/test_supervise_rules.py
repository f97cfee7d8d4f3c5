"""Each rule's condition at its limits: what holds, what does not yet, and what ends it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.bodily import Bump, Cliff, Fence, Lifted, Progress, Tilt
from bridge.supervise.electric import Battery, Reset, Sensor, Silence, Stall
from bridge.supervise.measured import Measured
from bridge.supervise.settings import (
    BatteryRule,
    BumpRule,
    CliffRule,
    FenceRule,
    ProgressRule,
    SilenceRule,
    SlipRule,
    StallRule,
    TiltRule,
)
from bridge.supervise.slip import Slip
from bridge.supervise.watched import Watched
from protocol.messages import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.values import Contact, Fault
from support.watching import G_LSB, MODEL, PER_COUNT_M, STEP_S, Walk, imu, power, reading, status

if TYPE_CHECKING:
    from bridge.supervise.conditions import Condition

LEFT, RIGHT, CLIFF = (
    int(Contact.BUMPER_LEFT),
    int(Contact.BUMPER_RIGHT),
    int(Contact.CLIFF),
)


# ---- what is measured --------------------------------------------------------------------


def test_ways_are_the_wheels_mean_by_eq_3() -> None:
    walk = Walk()
    walk.step(1)
    walk.step(10, left_m=10 * PER_COUNT_M, right_m=20 * PER_COUNT_M)
    assert walk.measured.way_m == pytest.approx(150 * PER_COUNT_M)
    assert walk.measured.left_m == pytest.approx(10 * PER_COUNT_M)
    assert walk.measured.right_m == pytest.approx(20 * PER_COUNT_M)
    assert walk.measured.wheel_turn_rad == pytest.approx(10 * PER_COUNT_M / 0.23)
    walk.step(10, left_m=-10 * PER_COUNT_M, right_m=-20 * PER_COUNT_M)
    assert walk.measured.way_m == pytest.approx(0.0, abs=1e-9)
    assert walk.measured.travel_m == pytest.approx(300 * PER_COUNT_M)


def test_the_scale_of_the_estimate_counts() -> None:
    walk = Walk()
    walk.step(1, wheel_scale=1.5)
    walk.step(2, left_m=10 * PER_COUNT_M, right_m=10 * PER_COUNT_M, wheel_scale=1.5)
    assert walk.measured.way_m == pytest.approx(30 * PER_COUNT_M)


def test_counts_wrap_at_16_bits_in_both_directions() -> None:
    walk = Walk()
    walk.left_m = walk.right_m = 0xFFFE * PER_COUNT_M
    walk.step(1)
    walk.step(1, left_m=5 * PER_COUNT_M, right_m=5 * PER_COUNT_M)
    assert walk.measured.way_m == pytest.approx(5 * PER_COUNT_M)
    walk.step(1, left_m=-9 * PER_COUNT_M, right_m=-9 * PER_COUNT_M)
    assert walk.measured.way_m == pytest.approx(-4 * PER_COUNT_M)


def test_the_turn_is_the_gyros() -> None:
    walk = Walk()
    walk.step(1, yaw_rate_rad_s=0.5)
    assert walk.measured.turn_rad == 0.0, "what was before the first step is not known"
    assert walk.measured.step_s == 0.0
    walk.step(50, yaw_rate_rad_s=0.5)
    assert walk.measured.turn_rad == pytest.approx(0.5)
    assert walk.measured.step_s == pytest.approx(STEP_S)


def test_a_gap_is_not_known() -> None:
    walk = Walk()
    walk.step(2)
    walk.time_s += 0.3
    walk.step(1, left_m=1.0, right_m=1.0, yaw_rate_rad_s=1.0)
    assert walk.measured.step_s == 0.0
    assert walk.measured.way_m == walk.measured.turn_rad == walk.measured.slip_m_s == 0.0
    walk.time_s += 0.3 - STEP_S
    walk.step(1, left_m=100 * PER_COUNT_M, right_m=100 * PER_COUNT_M, yaw_rate_rad_s=1.0)
    assert walk.measured.step_s == pytest.approx(0.3), "just short enough"
    assert walk.measured.way_m == pytest.approx(100 * PER_COUNT_M)
    assert walk.measured.turn_rad == pytest.approx(0.3)


def test_no_count_no_way_and_the_same_count_no_way() -> None:
    walk = Walk()
    walk.step(2, encoders=None, left_m=0.01, right_m=0.01)
    assert walk.measured.way_m == 0.0
    same = Encoders(5, 5)
    walk.step(1, encoders=same)
    walk.step(1, encoders=Encoders(25, 25))
    way_m = walk.measured.way_m
    assert way_m == pytest.approx(20 * PER_COUNT_M)
    held = Encoders(45, 45)
    walk.step(3, encoders=held)
    assert walk.measured.way_m == pytest.approx(way_m + 20 * PER_COUNT_M)
    assert walk.measured.left_m == walk.measured.right_m == walk.measured.wheel_turn_rad == 0.0


def test_slip_is_what_the_wheels_turn_beyond_the_gyro_smoothed_over_0_3_s() -> None:
    walk = Walk()
    walk.step(1)
    walk.step(1, right_m=20 * PER_COUNT_M)
    rim_m_s = 20 * PER_COUNT_M / STEP_S
    assert walk.measured.slip_m_s == pytest.approx(rim_m_s * STEP_S / 0.3, rel=1e-6)
    walk.step(400, right_m=20 * PER_COUNT_M)
    assert walk.measured.slip_m_s == pytest.approx(rim_m_s, rel=1e-3)
    walk.step(400, right_m=20 * PER_COUNT_M, yaw_rate_rad_s=rim_m_s / 0.23)
    assert walk.measured.slip_m_s == pytest.approx(0.0, abs=1e-5), "the gyro says so too"
    walk.step(400, left_m=20 * PER_COUNT_M)
    assert walk.measured.slip_m_s == pytest.approx(-rim_m_s, rel=1e-3)


def test_a_range_is_new_once() -> None:
    walk = Walk()
    first = reading(1.0)
    new = []
    for now in (first, first, reading(1.0)):
        walk.step(1, range=now)
        new.append(walk.measured.new_range)
    assert new == [True, False, True]


def test_restart_forgets() -> None:
    walk = Walk()
    walk.step(5, left_m=0.004, right_m=0.006, yaw_rate_rad_s=1.0, range=reading(1.0))
    walk.measured.restart()
    m = walk.measured
    assert (m.way_m, m.travel_m, m.turn_rad, m.slip_m_s, m.step_s) == (0.0,) * 5
    assert (m.left_m, m.right_m, m.wheel_turn_rad, m.new_range) == (0.0, 0.0, 0.0, False)
    walk.step(1, left_m=0.1)
    assert walk.measured.way_m == 0.0, "the reference is forgotten too"
    assert walk.measured.step_s == 0.0


# ---- stall -------------------------------------------------------------------------------


def stall() -> Stall:
    return Stall(StallRule(current_a=0.5))


def test_a_wheel_that_stands_under_current_stalls() -> None:
    walk = Walk(rule := stall())
    first, second = power(), power(left_a=0.5, right_a=0.1)
    walk.step(10, right_m=0.002, power=first)
    assert walk.step(1, power=second)
    assert rule.tell()[1] == {"by": "host", "side": "left", "current_a": 0.5}
    assert walk.step(9, power=second), "until the next reading"
    assert not walk.step(1, power=power(left_a=0.48))


@pytest.mark.parametrize(("way_m", "stands"), [(0.00385, True), (0.0043, False)])
def test_a_wheel_stands_below_2_cm_s(way_m: float, *, stands: bool) -> None:
    """4 mm between two readings of 5 Hz, either way round, on either side."""
    for side, sign in (("left_m", 1), ("left_m", -1), ("right_m", 1), ("right_m", -1)):
        walk = Walk(rule := stall())
        first = power()
        walk.step(1, power=first)
        walk.step(9, power=first, **{side: sign * way_m / 9})
        assert walk.step(1, power=power(left_a=1.0, right_a=1.0))
        name = "left" if side == "left_m" else "right"
        told = rule.tell()[1]["side"]
        assert isinstance(told, str)
        assert (name in told) is stands


def test_ways_are_counted_from_one_reading_to_the_next() -> None:
    walk = Walk(stall())
    first, second = power(), power(left_a=1.0, right_a=1.0)
    walk.step(1, power=first)
    walk.step(10, left_m=0.002, right_m=0.002, power=first)
    assert not walk.step(1, power=second)
    walk.step(9, power=second)
    assert walk.step(1, power=power(left_a=1.0)), "it stood since the second reading"


def test_the_first_reading_says_nothing() -> None:
    assert not Walk(stall()).step(3, power=power(left_a=2.0, right_a=2.0))
    assert not Walk(stall()).step(3, power=None)


def test_the_devices_own_word_is_enough() -> None:
    walk = Walk(rule := stall())
    assert not walk.step(1, status=status(int(Fault.INFRARED)))
    assert walk.step(1, status=status(int(Fault.MOTOR_STALL | Fault.IMU)))
    assert rule.tell()[1] == {"by": "device"}
    assert not walk.step(1, status=status())
    rule.restart()
    assert not walk.step(1, status=None)


# ---- slip --------------------------------------------------------------------------------


def slip() -> Slip:
    return Slip(SlipRule(difference_m_s=0.015, share=0.25))


def test_slip_of_one_wheel_at_its_limit() -> None:
    step_m = 0.0149 * STEP_S
    walk = Walk(slip())
    walk.step(1)
    assert not walk.step(300, left_m=0.004, right_m=0.004 + step_m)
    assert walk.step(300, left_m=0.004, right_m=0.004 + 1.03 * step_m)
    assert not walk.step(300, left_m=0.004, right_m=0.004)
    assert walk.step(300, left_m=0.004 + 1.03 * step_m, right_m=0.004)


def run_towards(  # noqa: PLR0913 - a run
    walk: Walk,
    closing: float,
    *,
    way_m: float = 0.6,
    from_m: float = 2.0,
    speed_m_s: float = 0.2,
    turn_rad: float = 0.0,
    bend: float = 0.0,
) -> bool:
    """Drive ahead; the range closes by a share of the way, sounded at 25 Hz."""
    ever = False
    made_m = 0.0
    step_m = speed_m_s * STEP_S
    now = reading(from_m)
    count = round(way_m / step_m)
    for index in range(count):
        made_m += step_m
        if index % 2:
            share = closing + bend * (made_m / way_m - 0.5)
            now = reading(from_m - share * made_m)
        rate = turn_rad / (count * STEP_S)
        # The wheels turn with the body, or a turn would be slip.
        lead_m = 0.5 * 0.23 * rate * STEP_S
        walk.step(
            1, left_m=step_m - lead_m, right_m=step_m + lead_m, range=now, yaw_rate_rad_s=rate
        )
        ever = ever or walk.held
    return ever


@pytest.mark.parametrize(
    ("closing", "found"), [(1.0, False), (0.77, False), (0.72, True), (0.5, True), (0.0, True)]
)
def test_both_wheels_slip_where_the_range_does_not_close(closing: float, *, found: bool) -> None:
    walk = Walk(rule := slip())
    assert run_towards(walk, closing) is found
    if found:
        _, data = rule.tell()
        assert data["by"] == "ultrasonic"
        assert data["lost_share"] == pytest.approx(1.0 - closing, abs=0.02)


def test_a_run_that_is_too_short_says_nothing() -> None:
    assert not run_towards(Walk(slip()), 0.5, way_m=0.28)
    assert run_towards(Walk(slip()), 0.5, way_m=0.34)


def test_a_run_needs_a_dozen_readings() -> None:
    walk = Walk(slip())
    for index in range(12):  # 5 cm from one to the next
        assert not walk.held
        walk.step(1, left_m=0.05, right_m=0.05, range=reading(2.0 - 0.025 * index))
    assert walk.held


def test_a_bend_is_no_straight_run() -> None:
    assert not run_towards(Walk(slip()), 0.5, way_m=0.6, turn_rad=0.3)
    assert run_towards(Walk(slip()), 0.5, way_m=0.6, turn_rad=0.05)
    assert not run_towards(Walk(slip()), 0.5, way_m=0.6, turn_rad=-0.3)


def test_an_echo_that_wanders_over_a_round_thing_is_no_slip() -> None:
    assert not run_towards(Walk(slip()), 0.7, bend=1.2)


def test_no_echo_and_a_far_one_say_nothing() -> None:
    walk = Walk(slip())
    for _ in range(200):
        walk.step(1, left_m=0.004, right_m=0.004, range=reading(None))
    assert not walk.held
    assert not run_towards(Walk(slip()), 0.5, from_m=3.95, way_m=0.6)
    assert run_towards(Walk(slip()), 0.5, from_m=3.4, way_m=0.6)


def test_a_missed_echo_begins_the_run_anew() -> None:
    walk = Walk(slip())
    assert run_towards(walk, 0.5, way_m=0.4)
    walk.step(1, range=reading(None))
    assert not walk.held
    assert not run_towards(walk, 0.5, way_m=0.28)


def test_another_thing_ahead_begins_the_run_anew() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, way_m=0.25, from_m=2.0)
    assert not run_towards(walk, 0.5, way_m=0.25, from_m=1.0)
    assert not run_towards(walk, 0.5, way_m=0.25, from_m=2.0)


@pytest.mark.parametrize(("jump_m", "same"), [(0.029, True), (0.045, False)])
def test_how_far_a_range_may_jump(jump_m: float, *, same: bool) -> None:
    for sign in (1.0, -1.0):
        walk = Walk(slip())
        assert not run_towards(walk, 0.5, way_m=0.2)
        after_m = 2.0 - 0.1 + sign * jump_m
        assert run_towards(walk, 0.5, way_m=0.2, from_m=after_m) is same


def test_driving_back_begins_the_run_anew() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, way_m=0.25)
    walk.step(5, left_m=-0.001, right_m=-0.001, range=reading(1.88))
    walk.step(1, range=reading(1.88))
    assert not run_towards(walk, 0.5, way_m=0.25, from_m=1.88)


def test_standing_neither_ends_a_run_nor_counts() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, way_m=0.2)
    for _ in range(40):
        walk.step(1, range=reading(1.9))
    assert run_towards(walk, 0.5, way_m=0.2, from_m=1.9)


def test_slip_restarts() -> None:
    walk = Walk(rule := slip())
    assert run_towards(walk, 0.5, way_m=0.4)
    rule.restart()
    assert not walk.step(1, range=None)
    assert not run_towards(walk, 0.5, way_m=0.28)


def test_at_its_very_limit_nothing_holds_yet() -> None:
    """A rule says "by more than"; what is measured stands in for the odometry here."""
    rule = slip()
    watched = Watched(0.0, Pose2(0.0, 0.0, 0.0), 0.0, 0.0)
    for slip_m_s, found in ((0.015, False), (-0.015, False), (0.01501, True), (-0.01501, True)):
        measured = Measured(MODEL)
        measured.slip_m_s = slip_m_s
        assert rule.holds(watched, measured) is found


@pytest.mark.parametrize(("turn_rad", "straight"), [(0.065, True), (0.08, False)])
def test_how_much_a_run_may_bend(turn_rad: float, *, straight: bool) -> None:
    for sign in (1.0, -1.0):
        walk = Walk(slip())
        walk.step(40, left_m=-0.002, right_m=0.002, yaw_rate_rad_s=0.87)  # turned beforehand
        assert run_towards(walk, 0.5, way_m=0.36, turn_rad=sign * turn_rad) is straight


@pytest.mark.parametrize(("first", "second", "found"), [(0.5, 0.5, True), (0.9, 0.3, False)])
def test_each_half_must_show_it(first: float, second: float, *, found: bool) -> None:
    for shares in ((first, second), (second, first)):
        walk = Walk(rule := slip())
        ever = False
        range_m = 2.0
        for index in range(78):
            range_m -= shares[index >= 38] * 0.004
            walk.step(1, left_m=0.004, right_m=0.004, range=reading(range_m))
            ever = ever or walk.held
        assert ever is found, rule.tell()


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
    assert rule.tell()[1]["angle_deg"] == pytest.approx(abs(degrees), abs=0.1)


def test_a_shock_is_no_lean() -> None:
    """The accelerometer is smoothed over 0.2 s; 20° for 40 ms comes to 3.8°."""
    walk = Walk(rule := Tilt(TiltRule(angle_deg=5.0)))
    walk.step(50, imu=imu())
    for _ in range(2):
        walk.step(1, imu=leaning(20.0))
    assert not walk.held
    assert rule.tell()[1]["angle_deg"] == pytest.approx(3.8, abs=0.2)
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
    assert rule.tell()[1]["angle_deg"] == 180.0


# ---- lifted ------------------------------------------------------------------------------

JOLT = round(G_LSB * (1.0 + 1.55 / 9.80665))
NO_JOLT = round(G_LSB * (1.0 + 1.45 / 9.80665))
DROP = round(G_LSB * (1.0 - 1.55 / 9.80665))


@pytest.mark.parametrize(("up", "found"), [(JOLT, True), (DROP, True), (NO_JOLT, False)])
def test_a_jolt_and_no_floor_is_a_lift(up: int, *, found: bool) -> None:
    walk = Walk(rule := Lifted())
    walk.step(10, imu=imu(), range=reading())
    walk.step(1, imu=imu(0, 0, up), range=reading())
    assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found
    if found:
        assert rule.tell()[1] == {"by": "host"}
        assert walk.step(200, imu=imu(), range=reading(contacts=CLIFF)), "as long as it is up"
        assert not walk.step(1, imu=imu(), range=reading(contacts=LEFT))


def test_a_jolt_of_long_ago_is_no_lift() -> None:
    for steps, found in ((48, True), (50, False)):
        walk = Walk(Lifted())
        walk.step(1, imu=imu(0, 0, JOLT), range=reading())
        walk.step(steps, imu=imu(), range=reading())
        assert walk.step(1, imu=imu(), range=reading(contacts=CLIFF)) is found


def test_a_jolt_alone_and_a_cliff_alone_are_none() -> None:
    assert not Walk(Lifted()).step(5, imu=imu(0, 0, JOLT), range=reading(contacts=LEFT | RIGHT))
    assert not Walk(Lifted()).step(5, imu=imu(0, 0, JOLT), range=None)
    assert not Walk(Lifted()).step(5, imu=imu(), range=reading(contacts=CLIFF))
    assert not Walk(Lifted()).step(5, imu=None, range=reading(contacts=CLIFF))


def test_the_device_says_that_it_is_lifted() -> None:
    walk = Walk(rule := Lifted())
    assert walk.step(1, status=status(int(Fault.LIFTED | Fault.IMU)))
    assert rule.tell()[1] == {"by": "device"}
    assert not walk.step(1, status=status(int(Fault.IMU)))
    walk.step(1, imu=imu(0, 0, JOLT), range=reading(contacts=CLIFF))
    rule.restart()
    assert not walk.step(1, range=reading(contacts=CLIFF)), "the jolt is forgotten"


# ---- bump --------------------------------------------------------------------------------


def test_so_many_bumps_in_the_window() -> None:
    walk = Walk(rule := Bump(BumpRule(count=3.0, window_s=1.0, held_s=5.0)))
    for number in (1, 2, 3):
        held = walk.step(1, range=reading(contacts=LEFT if number % 2 else RIGHT))
        assert held is (number == 3)
        if number < 3:
            assert not walk.step(4, range=reading())
    assert rule.tell()[1] == {"count": 3, "window_s": 1.0, "held_s": 0.0}
    assert walk.step(39, range=reading())
    assert not walk.step(2, range=reading()), "the first is a second ago"


def test_another_half_of_a_pressed_bumper_is_no_new_bump() -> None:
    walk = Walk(Bump(BumpRule(count=2.0, window_s=10.0, held_s=5.0)))
    walk.step(1, range=reading(contacts=LEFT))
    assert not walk.step(1, range=reading(contacts=LEFT | RIGHT))
    assert not walk.step(1, range=reading(contacts=RIGHT))
    assert not walk.step(1, range=reading(contacts=CLIFF)), "no floor is no bump"
    assert walk.step(1, range=reading(contacts=LEFT))


@pytest.mark.parametrize("half", [LEFT, RIGHT])
def test_a_half_that_stays_pressed(half: int) -> None:
    walk = Walk(rule := Bump(BumpRule(count=100.0, window_s=10.0, held_s=2.0)))
    walk.step(1, range=reading(contacts=half))
    assert not walk.step(99, range=reading(contacts=half))
    assert walk.step(2, range=reading(contacts=half))
    assert rule.tell()[1]["held_s"] == pytest.approx(2.0, abs=0.03)
    assert walk.step(1, range=reading(contacts=LEFT | RIGHT))
    assert not walk.step(1, range=reading(contacts=(LEFT | RIGHT) ^ half))
    assert not walk.step(99, range=reading(contacts=(LEFT | RIGHT) ^ half))


def test_the_same_reading_twice_is_one() -> None:
    walk = Walk(rule := Bump(BumpRule(count=2.0, window_s=10.0, held_s=5.0)))
    touch, free = reading(contacts=LEFT), reading()
    walk.step(3, range=touch)
    walk.step(3, range=free)
    assert not walk.held
    assert rule.tell()[1]["count"] == 1
    rule.restart()
    assert rule.tell()[1]["count"] == 0
    walk.step(1, range=reading(contacts=LEFT))
    assert not walk.held
    assert not walk.step(1, range=None)


# ---- cliff -------------------------------------------------------------------------------


def test_no_floor_is_told_and_driving_on_is_grave() -> None:
    walk = Walk(rule := Cliff(CliffRule(ahead_m=0.05)))
    assert not walk.step(5, left_m=0.004, right_m=0.004, range=reading(contacts=LEFT))
    assert walk.step(1, left_m=0.004, right_m=0.004, range=reading(contacts=CLIFF))
    grave = [rule.grave]
    for steps, way_m in ((12, 0.004), (1, 0.004), (20, -0.004)):
        walk.step(steps, left_m=way_m, right_m=way_m, range=reading(contacts=CLIFF))
        grave.append(rule.grave)
        if steps == 12:
            assert rule.tell()[1]["ahead_m"] == pytest.approx(0.048, abs=0.001)
    assert grave == [False, False, True, True], "what was done is done"
    held = [walk.step(1, range=reading()), walk.step(1, range=reading(contacts=CLIFF))]
    assert held == [False, True]
    assert rule.tell() == ("no floor ahead", {"ahead_m": 0.0}), "it begins anew"


def test_backing_off_from_a_cliff_is_right() -> None:
    walk = Walk(rule := Cliff(CliffRule(ahead_m=0.05)))
    walk.step(1, range=reading(contacts=CLIFF))
    walk.step(40, left_m=-0.004, right_m=-0.004, range=reading(contacts=CLIFF))
    assert not rule.grave
    assert not walk.step(1, range=None)


# ---- progress and fence --------------------------------------------------------------------


def test_a_small_square_for_a_long_time_is_no_progress() -> None:
    walk = Walk(rule := Progress(ProgressRule(window_s=4.0, least_m=0.1)))
    walk.step(1)
    for index in range(199):
        x = 0.099 * (index % 2)
        assert not walk.step(1, pose=Pose2(x, -x, 0.0))
    assert not walk.step(1, pose=Pose2(0.05, 0.0, 0.0))
    assert walk.step(2, pose=Pose2(0.05, 0.0, 0.0))
    assert rule.tell()[1] == {"for_s": pytest.approx(4.0, abs=0.05), "least_m": 0.1}


@pytest.mark.parametrize("there", [(0.101, 0.0), (-0.101, 0.0), (0.0, 0.101), (0.0, -0.101)])
def test_leaving_the_square_begins_it_anew(there: tuple[float, float]) -> None:
    walk = Walk(Progress(ProgressRule(window_s=4.0, least_m=0.1)))
    walk.step(150)
    walk.step(1, pose=Pose2(*there, 0.0))
    assert not walk.step(199, pose=Pose2(*there, 0.0))
    assert walk.step(3, pose=Pose2(*there, 0.0)), "from there on it stood"


def test_steps_to_and_fro_make_a_square_of_their_own() -> None:
    walk = Walk(rule := Progress(ProgressRule(window_s=1.0, least_m=0.1)))
    for x in (0.0, 0.06, -0.06):
        walk.step(10, pose=Pose2(x, 0.0, 0.0))
    assert not walk.step(40, pose=Pose2(-0.06, 0.0, 0.0)), "0.12 m apart: it left the square"
    rule.restart()
    assert not walk.step(49, pose=Pose2(-0.06, 0.0, 0.0))
    assert walk.step(3, pose=Pose2(-0.06, 0.0, 0.0))


def test_the_radius_is_around_the_first_place() -> None:
    walk = Walk(rule := Fence(FenceRule(radius_m=1.0)))
    assert not walk.step(1, pose=Pose2(5.0, 5.0, 0.0))
    assert not walk.step(1, pose=Pose2(5.99, 5.0, 0.0))
    assert walk.step(1, pose=Pose2(5.8, 5.8, 0.0))
    assert rule.tell()[1] == {"x_m": 5.8, "y_m": 5.8}
    assert "further than 1 m" in rule.tell()[0]
    rule.restart()
    assert walk.step(1, pose=Pose2(5.8, 5.8, 0.0)), "the fence stands where it stood"


def test_without_a_fence_nothing_is_outside() -> None:
    assert not Walk(Fence(FenceRule())).step(1, pose=Pose2(900.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("x", "y", "outside"),
    [
        *[(0.5, 0.5, False), (1.5, 0.5, False), (0.5, 1.5, False), (1.5, 1.5, True)],
        *[(-0.1, 0.5, True), (2.1, 0.5, True), (0.5, -0.1, True), (0.5, 2.1, True)],
        *[(0.99, 1.5, False), (1.01, 1.5, True), (1.5, 0.99, False), (1.5, 1.01, True)],
    ],
)
def test_an_l_shaped_fence(x: float, y: float, *, outside: bool) -> None:
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0))
    walk = Walk(rule := Fence(FenceRule(polygon=corners)))
    assert walk.step(1, pose=Pose2(x, y, 0.0)) is outside
    if outside:
        assert "outside of the fence" in rule.tell()[0]


def test_a_slanting_fence() -> None:
    """A triangle whose long side is y = 2 - x / 2: a crossing is not where its corner is."""
    corners = ((0.0, 0.0), (4.0, 0.0), (0.0, 2.0))
    for x, y, outside in ((2.0, 0.9, False), (2.0, 1.1, True), (3.0, 0.4, False), (3.0, 0.6, True)):
        assert Walk(Fence(FenceRule(polygon=corners))).step(1, pose=Pose2(x, y, 0.0)) is outside


# ---- battery -----------------------------------------------------------------------------


def battery() -> Battery:
    return Battery(BatteryRule(low_v=12.8, empty_v=12.0))


def drain(walk: Walk, volts: float, seconds: float) -> bool:
    """Readings at 5 Hz."""
    for _ in range(round(5 * seconds)):
        walk.step(10, power=power(volts))
    return walk.held


@pytest.mark.parametrize(
    ("volts", "low", "empty"),
    [(12.85, False, False), (12.75, True, False), (12.05, True, False), (11.95, True, True)],
)
def test_the_battery_at_its_limits(volts: float, *, low: bool, empty: bool) -> None:
    walk = Walk(rule := battery())
    assert drain(walk, volts, 4.0) is low
    assert rule.grave is empty
    assert rule.tell()[1] == {
        "battery_v": pytest.approx(volts, abs=0.01),
        "limit_v": 12.0 if empty else 12.8,
    }


def test_a_dip_is_smoothed_over_a_second() -> None:
    """One reading of 10 V after 16 V moves the mean by a fifth of the difference."""
    walk = Walk(rule := battery())
    drain(walk, 16.0, 2.0)
    dip = power(10.0)
    walk.step(10, power=dip)
    assert not walk.held
    assert rule.tell()[1]["battery_v"] == pytest.approx(16.0 - 0.2 * 6.0, abs=0.02)
    assert drain(walk, 10.0, 1.0)


def test_the_device_says_that_it_is_low() -> None:
    walk = Walk(rule := battery())
    assert walk.step(1, status=status(int(Fault.BATTERY_LOW)))
    assert not rule.grave
    assert not walk.step(1, status=status(int(Fault.IMU)))
    drain(walk, 11.0, 1.0)
    rule.restart()
    assert not rule.grave
    assert not walk.step(1), "nothing is known of it again"
    assert drain(walk, 11.0, 0.2), "the first reading is taken as it is"


# ---- silence -----------------------------------------------------------------------------


def silence() -> Silence:
    return Silence(SilenceRule(silent_s=0.4, stream_s=1.0))


def test_nothing_of_the_device() -> None:
    walk = Walk(rule := silence())
    assert not walk.look(heard_s=walk.time_s - 0.39)
    assert walk.look(heard_s=walk.time_s - 0.42)
    assert rule.tell()[1] == {"stream": "", "for_s": 0.42}
    assert not walk.look(heard_s=walk.time_s)


@pytest.mark.parametrize("kind", [Encoders, Imu, Range, Status, Power, PlannerState])
def test_a_stream_that_ends(kind: type[Encoders | Imu | Range | Status | Power]) -> None:
    walk = Walk(rule := silence())
    others = dict.fromkeys((Encoders, Imu, Range, Status, Power, PlannerState), walk.time_s)
    assert not walk.look(arrived_s={**others, kind: walk.time_s - 0.98})
    assert walk.look(arrived_s={**others, kind: walk.time_s - 1.02})
    assert rule.tell()[1] == {"stream": kind.__name__.lower(), "for_s": 1.02}
    del others[kind]
    assert not walk.look(arrived_s=others), "a stream that never was has not ended"
    rule.restart()
    assert rule.tell()[1] == {"stream": "", "for_s": 0.0}


# ---- sensor and reset ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "fault",
    [Fault.IMU, Fault.ENCODER_LEFT, Fault.ENCODER_RIGHT, Fault.ULTRASONIC, Fault.INFRARED],
)
def test_what_the_device_says_of_its_sensors(fault: Fault) -> None:
    walk = Walk(rule := Sensor())
    assert walk.step(1, status=status(int(fault | Fault.LIFTED)))
    assert rule.tell()[1] == {"sensor": (fault.name or "").lower()}
    assert not walk.step(1, status=status(int(Fault.LIFTED | Fault.BATTERY_LOW)))
    assert not walk.step(1, status=None)


def test_registers_that_do_not_change_while_the_wheels_turn() -> None:
    """A second of turning on the spot by 0.25 rad/s."""
    walk = Walk(rule := Sensor())
    way_m = 0.5 * 0.23 * 0.25 * STEP_S
    walk.step(1, imu=imu(mark=1))
    assert not walk.step(49, left_m=-way_m, right_m=way_m, imu=imu(mark=1))
    assert walk.step(2, left_m=-way_m, right_m=way_m, imu=imu(mark=1))
    assert rule.tell()[1] == {"sensor": "imu", "frozen_s": pytest.approx(1.0, abs=0.03)}
    assert not walk.step(1, left_m=-way_m, right_m=way_m, imu=imu(mark=2))
    assert not walk.step(49, left_m=way_m, right_m=-way_m, imu=imu(mark=2))
    assert walk.step(2, left_m=way_m, right_m=-way_m, imu=imu(mark=2))
    rule.restart()
    assert not walk.step(1, imu=imu(mark=2))


def test_registers_that_stay_on_a_straight_way_are_none() -> None:
    walk = Walk(Sensor())
    slow_m = 0.5 * 0.23 * 0.15 * STEP_S
    assert not walk.step(200, left_m=0.004, right_m=0.004, imu=imu())
    assert not walk.step(200, left_m=-slow_m, right_m=slow_m, imu=imu())
    assert not walk.step(200, left_m=-0.01, right_m=0.01, imu=None)


def test_another_boot_is_a_reset() -> None:
    walk = Walk(rule := Reset())
    assert not walk.step(2, boot_id=7)
    assert walk.step(1, boot_id=8)
    assert rule.tell()[1] == {"boot_id": "8", "was": "7"}
    rule.restart()
    assert walk.step(1, boot_id=8), "the boot that was watched is another"
    assert not walk.step(1, boot_id=7)


@pytest.mark.parametrize(
    "rule",
    [
        *(stall(), slip(), Tilt(TiltRule()), Lifted(), Bump(BumpRule()), Cliff(CliffRule())),
        *(battery(), silence(), Progress(ProgressRule()), Fence(FenceRule()), Sensor(), Reset()),
    ],
)
def test_a_robot_at_rest_holds_nothing(rule: Condition) -> None:
    walk = Walk(rule)
    for index in range(100):
        assert not walk.step(
            1, imu=imu(mark=index), range=reading(1.0), power=power(), status=status(), boot_id=3
        )
    assert not rule.grave
    assert MODEL.robot_diameter_m == 0.32
