"""The values that all rules share: motion from encoder counts and gyro, by eq. 3."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from protocol.messages.device import Encoders
from support.watching import MODEL, PER_COUNT_M, STEP_S, Walk, reading

if TYPE_CHECKING:
    from collections.abc import Iterator


def test_ways_are_the_wheels_mean_by_eq_3() -> None:
    walk = Walk()
    walk.step(1)
    walk.step(10, left_m=10 * PER_COUNT_M, right_m=20 * PER_COUNT_M)
    assert walk.measured.distance_m == pytest.approx(150 * PER_COUNT_M)
    assert walk.measured.left_m == pytest.approx(10 * PER_COUNT_M)
    assert walk.measured.right_m == pytest.approx(20 * PER_COUNT_M)
    assert walk.measured.wheel_turn_rad == pytest.approx(10 * PER_COUNT_M / 0.23)
    walk.step(10, left_m=-10 * PER_COUNT_M, right_m=-20 * PER_COUNT_M)
    assert walk.measured.distance_m == pytest.approx(0.0, abs=1e-9)
    assert walk.measured.travel_m == pytest.approx(300 * PER_COUNT_M)


def test_the_scale_of_the_estimate_counts() -> None:
    walk = Walk()
    walk.step(1, wheel_scale=1.5)
    walk.step(2, left_m=10 * PER_COUNT_M, right_m=10 * PER_COUNT_M, wheel_scale=1.5)
    assert walk.measured.distance_m == pytest.approx(30 * PER_COUNT_M)


def test_counts_wrap_at_16_bits_in_both_directions() -> None:
    walk = Walk()
    walk.left_m = walk.right_m = 0xFFFE * PER_COUNT_M
    walk.step(1)
    walk.step(1, left_m=5 * PER_COUNT_M, right_m=5 * PER_COUNT_M)
    assert walk.measured.distance_m == pytest.approx(5 * PER_COUNT_M)
    walk.step(1, left_m=-9 * PER_COUNT_M, right_m=-9 * PER_COUNT_M)
    assert walk.measured.distance_m == pytest.approx(-4 * PER_COUNT_M)


def test_the_turn_is_the_gyros() -> None:
    walk = Walk()
    walk.step(1, yaw_rate_rad_s=0.5)
    assert walk.measured.turn_rad == 0.0, "the motion before the first step is unknown"
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
    assert walk.measured.distance_m == walk.measured.turn_rad == walk.measured.slip_m_s == 0.0
    walk.time_s += 0.3 - STEP_S
    walk.step(1, left_m=100 * PER_COUNT_M, right_m=100 * PER_COUNT_M, yaw_rate_rad_s=1.0)
    assert walk.measured.step_s == pytest.approx(0.3), "0.3 s is the longest valid step"
    assert walk.measured.distance_m == pytest.approx(100 * PER_COUNT_M)
    assert walk.measured.turn_rad == pytest.approx(0.3)


def test_without_new_counts_there_is_no_path() -> None:
    walk = Walk()
    walk.step(2, encoders=None, left_m=0.01, right_m=0.01)
    assert walk.measured.distance_m == 0.0
    same = Encoders(5, 5)
    walk.step(1, encoders=same)
    walk.step(1, encoders=Encoders(25, 25))
    path_m = walk.measured.distance_m
    assert path_m == pytest.approx(20 * PER_COUNT_M)
    held = Encoders(45, 45)
    walk.step(3, encoders=held)
    assert walk.measured.distance_m == pytest.approx(path_m + 20 * PER_COUNT_M)
    assert walk.measured.left_m == walk.measured.right_m == walk.measured.wheel_turn_rad == 0.0


def test_slip_is_the_wheels_turn_minus_the_gyros_smoothed_over_0_3_s() -> None:
    walk = Walk()
    walk.step(1)
    walk.step(1, right_m=20 * PER_COUNT_M)
    rim_m_s = 20 * PER_COUNT_M / STEP_S
    assert walk.measured.slip_m_s == pytest.approx(rim_m_s * STEP_S / 0.3, rel=1e-6)
    walk.step(400, right_m=20 * PER_COUNT_M)
    assert walk.measured.slip_m_s == pytest.approx(rim_m_s, rel=1e-3)
    walk.step(400, right_m=20 * PER_COUNT_M, yaw_rate_rad_s=rim_m_s / 0.23)
    assert walk.measured.slip_m_s == pytest.approx(0.0, abs=1e-5), "the gyro measures the same turn"
    walk.step(400, left_m=20 * PER_COUNT_M)
    assert walk.measured.slip_m_s == pytest.approx(-rim_m_s, rel=1e-3)


@pytest.mark.parametrize("late_s", [-0.020, -0.010, 0.0, 0.010, 0.020])
def test_samples_that_come_late_are_no_slip(late_s: float) -> None:
    """A turn of 1.8 rad/s reverses at 5.5 rad/s². The counts lag the gyro by ``late_s``."""
    measured, slips = Measured(MODEL), []
    for seen in swing(late_s, slip_m_s=0.0):
        measured.step(seen)
        slips.append(measured.slip_m_s)
    assert max(map(abs, slips)) < 0.004, "a quarter of the rule's limit of 15 mm/s"


@pytest.mark.parametrize("slip_m_s", [0.03, -0.03])
def test_slip_is_detected_despite_late_samples(slip_m_s: float) -> None:
    measured = Measured(MODEL)
    for seen in swing(0.020, slip_m_s):
        measured.step(seen)
    assert measured.slip_m_s == pytest.approx(slip_m_s, abs=0.003)


def swing(late_s: float, slip_m_s: float) -> Iterator[RuleInputs]:
    """Yield a turn of 1.8 rad/s and then a reversed turn, which ends at a constant yaw rate."""
    fine_s, yaw_rate = 0.001, 0.0
    rates = [0.0] * 100
    for wanted, seconds in ((1.8, 0.9), (-0.6, 0.5), (-0.6, 1.5)):
        for _ in range(round(seconds / fine_s)):
            yaw_rate += min(max(wanted - yaw_rate, -5.5 * fine_s), 5.5 * fine_s)
            rates.append(yaw_rate)
    leads, lead_m = [], 0.0
    for rate in rates:
        lead_m += (rate * MODEL.wheel_base_m + slip_m_s) * fine_s
        leads.append(lead_m)
    for step in range(3, (len(rates) - 40) // 20):
        now = 20 * step
        lead = leads[min(now - round(late_s / fine_s), len(leads) - 1)]
        counts = round(0.5 * lead / PER_COUNT_M)
        encoders = Encoders(-counts & 0xFFFF, counts & 0xFFFF)
        yield _step(now * fine_s, encoders=encoders, yaw_rate_rad_s=rates[now])


def test_a_range_is_new_once() -> None:
    walk = Walk()
    first = reading(1.0)
    new = []
    for now in (first, first, reading(1.0)):
        walk.step(1, range=now)
        new.append(walk.measured.new_range)
    assert new == [True, False, True]


def test_restart_resets_the_state() -> None:
    walk = Walk()
    walk.step(5, left_m=0.004, right_m=0.006, yaw_rate_rad_s=1.0, range=reading(1.0))
    walk.measured.restart()
    m = walk.measured
    assert (m.distance_m, m.travel_m, m.turn_rad, m.slip_m_s, m.step_s) == (0.0,) * 5
    assert (m.left_m, m.right_m, m.wheel_turn_rad, m.new_range) == (0.0, 0.0, 0.0, False)
    walk.step(1, left_m=0.1)
    assert walk.measured.distance_m == 0.0, "a restart discards the reference counts"
    assert walk.measured.step_s == 0.0


def test_the_longest_step_that_counts_is_0_3_s() -> None:
    """The times begin at 0, so that the time differences are exact."""
    for limit_s, way in ((0.3, 40.0), (0.3000001, 0.0)):
        measured = Measured(MODEL)
        for time_s, counts in ((0.0, 0), (limit_s, 40)):
            measured.step(_step(time_s, encoders=Encoders(counts, counts), yaw_rate_rad_s=1.0))
        assert measured.distance_m == pytest.approx(way * PER_COUNT_M)
        assert measured.turn_rad == pytest.approx(0.3 if way else 0.0)


def test_counts_may_be_old_though_steps_are_not() -> None:
    """Repeated counts keep the time of their first arrival."""
    for steps, way in ((15, 30.0), (16, 0.0)):
        measured = Measured(MODEL)
        first = Encoders(0, 0)
        for step in range(steps):
            measured.step(_step(0.02 * step, encoders=first))
        measured.step(_step(0.02 * steps, encoders=Encoders(30, 30)))
        assert measured.distance_m == pytest.approx(way * PER_COUNT_M), steps


def test_a_step_without_counts_after_some() -> None:
    measured = Measured(MODEL)
    measured.step(_step(0.1, encoders=Encoders(5, 5)))
    measured.step(_step(0.12, encoders=Encoders(15, 15)))
    measured.step(_step(0.14, encoders=None))
    assert measured.left_m == measured.right_m == 0.0
    measured.step(_step(0.16, encoders=Encoders(18, 18)))
    assert measured.distance_m == pytest.approx(13 * PER_COUNT_M)


def test_jumping_counts_are_differenced_modulo_the_range() -> None:
    for leap in (20_000, -20_000, 32_767, -32_768):
        measured = Measured(MODEL)
        measured.step(_step(0.0, encoders=Encoders(40_000, 7)))
        measured.step(_step(0.02, encoders=Encoders((40_000 + leap) & 0xFFFF, (7 + leap) & 0xFFFF)))
        assert measured.distance_m == pytest.approx(leap * PER_COUNT_M)


def test_a_gap_ends_the_slip_that_was() -> None:
    walk = Walk()
    walk.step(50, right_m=20 * PER_COUNT_M)
    assert walk.measured.slip_m_s > 0.1
    walk.time_s += 0.5
    walk.step(1)
    assert walk.measured.slip_m_s == 0.0


def test_a_step_of_0_3_s_is_not_smoothed() -> None:
    """A step of 0.3 s equals the time constant of the smoothed slip."""
    measured = Measured(MODEL)
    measured.step(_step(0.0, encoders=Encoders(0, 0)))
    measured.step(_step(0.3, encoders=Encoders(0, 300)))
    assert measured.slip_m_s == pytest.approx(300 * PER_COUNT_M / 0.3)


def test_two_steps_at_one_time_are_no_step() -> None:
    measured = Measured(MODEL)
    for _ in range(2):
        measured.step(_step(5.0, encoders=Encoders(7, 7), yaw_rate_rad_s=1.0))
        assert (measured.step_s, measured.turn_rad, measured.slip_m_s) == (0.0, 0.0, 0.0)


def test_a_restart_resets_the_newness_of_a_range() -> None:
    walk = Walk()
    walk.step(1, range=reading(1.0))
    assert walk.measured.new_range
    walk.measured.restart()
    assert not walk.measured.new_range


def _step(time_s: float, *, encoders: Encoders | None, yaw_rate_rad_s: float = 0.0) -> RuleInputs:
    return RuleInputs(time_s, Pose2(0.0, 0.0, 0.0), 0.0, yaw_rate_rad_s, encoders=encoders)


@pytest.mark.parametrize("restarted", [False, True])
def test_a_steady_turn_from_the_start_is_no_swing(*, restarted: bool) -> None:
    """Late samples explain a lead only while the yaw rate changes."""
    walk = Walk()
    if restarted:
        walk.step(20, yaw_rate_rad_s=-1.0)
        walk.measured.restart()
    lead_m_s, turn_m = 0.005, MODEL.wheel_base_m * 1.0 * STEP_S
    count = 100  # the rounding of the counts is then below 1 mm/s
    walk.step(1, yaw_rate_rad_s=1.0, encoders=Encoders(0, 0))
    for k in range(1, count + 1):
        right_m = k * (turn_m + lead_m_s * STEP_S)
        walk.step(1, yaw_rate_rad_s=1.0, encoders=Encoders(0, round(right_m / PER_COUNT_M)))
    assert walk.measured.slip_m_s == pytest.approx(lead_m_s, abs=0.001)
