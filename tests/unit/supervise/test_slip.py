"""The slip rule at its limits: wheels compared with the gyro and with the range ahead."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.slip import Slip
from bridge.supervise.settings import SlipRule
from support.watching import MODEL, STEP_S, Walk, reading


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


def run_towards(  # noqa: PLR0913 - one parameter per option of a run
    walk: Walk,
    closing: float,
    *,
    path_m: float = 0.6,
    from_m: float = 2.0,
    speed_m_s: float = 0.2,
    turn_rad: float = 0.0,
    bend: float = 0.0,
) -> bool:
    """Drive ahead. The range, measured at 25 Hz, decreases by ``closing`` times the path."""
    ever = False
    made_m = 0.0
    step_m = speed_m_s * STEP_S
    now = reading(from_m)
    count = round(path_m / step_m)
    for index in range(count):
        made_m += step_m
        if index % 2:
            share = closing + bend * (made_m / path_m - 0.5)
            now = reading(from_m - share * made_m)
        rate = turn_rad / (count * STEP_S)
        # The wheels turn as the gyro does; otherwise the turn would count as slip.
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
        _, data = rule.evidence()
        assert data["by"] == "ultrasonic"
        assert data["lost_share"] == pytest.approx(1.0 - closing, abs=0.02)


def test_a_run_that_is_too_short_reports_nothing() -> None:
    assert not run_towards(Walk(slip()), 0.5, path_m=0.28)
    assert run_towards(Walk(slip()), 0.5, path_m=0.34)


def test_a_run_needs_a_dozen_readings() -> None:
    walk = Walk(slip())
    for index in range(12):  # 5 cm between two readings
        assert not walk.held
        walk.step(1, left_m=0.05, right_m=0.05, range=reading(2.0 - 0.025 * index))
    assert walk.held


def test_a_bend_is_no_straight_run() -> None:
    assert not run_towards(Walk(slip()), 0.5, path_m=0.6, turn_rad=0.3)
    assert run_towards(Walk(slip()), 0.5, path_m=0.6, turn_rad=0.05)
    assert not run_towards(Walk(slip()), 0.5, path_m=0.6, turn_rad=-0.3)


def test_an_echo_moving_over_a_round_object_is_no_slip() -> None:
    assert not run_towards(Walk(slip()), 0.7, bend=1.2)


def test_no_echo_and_a_far_one_have_no_effect() -> None:
    walk = Walk(slip())
    for _ in range(200):
        walk.step(1, left_m=0.004, right_m=0.004, range=reading(None))
    assert not walk.held
    assert not run_towards(Walk(slip()), 0.5, from_m=3.95, path_m=0.6)
    assert run_towards(Walk(slip()), 0.5, from_m=3.4, path_m=0.6)


def test_a_missed_echo_restarts_the_run() -> None:
    walk = Walk(slip())
    assert run_towards(walk, 0.5, path_m=0.4)
    walk.step(1, range=reading(None))
    assert not walk.held
    assert not run_towards(walk, 0.5, path_m=0.28)


def test_another_obstacle_ahead_restarts_the_run() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, path_m=0.25, from_m=2.0)
    assert not run_towards(walk, 0.5, path_m=0.25, from_m=1.0)
    assert not run_towards(walk, 0.5, path_m=0.25, from_m=2.0)


@pytest.mark.parametrize(("jump_m", "same"), [(0.029, True), (0.045, False)])
def test_how_far_a_range_may_jump(jump_m: float, *, same: bool) -> None:
    for sign in (1.0, -1.0):
        walk = Walk(slip())
        assert not run_towards(walk, 0.5, path_m=0.2)
        after_m = 2.0 - 0.1 + sign * jump_m
        assert run_towards(walk, 0.5, path_m=0.2, from_m=after_m) is same


def test_driving_back_restarts_the_run() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, path_m=0.25)
    walk.step(5, left_m=-0.001, right_m=-0.001, range=reading(1.88))
    walk.step(1, range=reading(1.88))
    assert not run_towards(walk, 0.5, path_m=0.25, from_m=1.88)


def test_standing_neither_ends_a_run_nor_counts() -> None:
    walk = Walk(slip())
    assert not run_towards(walk, 0.5, path_m=0.2)
    for _ in range(40):
        walk.step(1, range=reading(1.9))
    assert run_towards(walk, 0.5, path_m=0.2, from_m=1.9)


def test_slip_restarts() -> None:
    walk = Walk(rule := slip())
    assert run_towards(walk, 0.5, path_m=0.4)
    rule.restart()
    assert not walk.step(1, range=None)
    assert not run_towards(walk, 0.5, path_m=0.28)


def test_no_rule_holds_exactly_at_its_limit() -> None:
    """A value equal to the limit is allowed. The test sets the measured values."""
    rule = slip()
    inputs = RuleInputs(0.0, Pose2(0.0, 0.0, 0.0), 0.0, 0.0)
    for slip_m_s, found in ((0.015, False), (-0.015, False), (0.01501, True), (-0.01501, True)):
        measured = Measured(MODEL)
        measured.slip_m_s = slip_m_s
        assert rule.holds(inputs, measured) is found


@pytest.mark.parametrize(("turn_rad", "straight"), [(0.065, True), (0.08, False)])
def test_how_much_a_run_may_bend(turn_rad: float, *, straight: bool) -> None:
    for sign in (1.0, -1.0):
        walk = Walk(slip())
        walk.step(40, left_m=-0.002, right_m=0.002, yaw_rate_rad_s=0.87)  # a turn before the run
        assert run_towards(walk, 0.5, path_m=0.36, turn_rad=sign * turn_rad) is straight


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
        assert ever is found, rule.evidence()


@pytest.mark.parametrize("restarted", [False, True])
def test_a_restart_discards_the_run_towards_an_object(*, restarted: bool) -> None:
    rule = slip()
    walk = Walk(rule)
    assert not run_towards(walk, 0.0, path_m=0.2), "too short for a comparison"
    if restarted:
        rule.restart()
    assert run_towards(walk, 0.0, path_m=0.2) is not restarted
