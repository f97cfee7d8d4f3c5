"""The check of the device's planner: the decisions that it must and must not report."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.rules.planner_check import PlannerCheck
from bridge.supervise.settings import DisagreementRule
from protocol.messages.values import Contact
from support.sweeping_device import (
    BACK,
    CRUISE_M,
    IDLE,
    LANE,
    STEP,
    TURN,
    Device,
    started,
    swept,
)
from support.watching import MODEL, Walk, planner

# ---- D -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reported", "found"), [(1.028, False), (0.972, False), (1.034, True), (0.966, True)]
)
def test_d_is_compared_with_the_odometry(reported: float, *, found: bool) -> None:
    device = started()
    mm = round(reported * 1000)
    device.lane(1.0, planner(TURN, distance=mm, previous=mm, case=1))
    assert bool(device.found) is found
    if found:
        assert device.data["D_m"] == pytest.approx(reported)
        assert device.data["odometry_m"] == pytest.approx(1.0, abs=0.005)


def test_d_is_checked_at_the_furthest_point_not_after_backing_off() -> None:
    device = started()
    device.emit_state(planner(LANE))
    device.go(250, CRUISE_M)
    device.go(20, -CRUISE_M)
    device.emit_state(planner(TURN, distance=1000, previous=1000, case=1))
    device.go(10)
    assert device.found == []
    device = started()
    device.emit_state(planner(LANE))
    device.go(250, CRUISE_M)
    device.go(20, -CRUISE_M)
    device.emit_state(planner(TURN, distance=920, previous=920, case=1))
    device.go(10)
    assert len(device.found) == 1


def test_each_lane_counts_from_its_own_beginning() -> None:
    device = swept(1.0)
    device.lane(0.8, planner(TURN, turns=1, distance=800, previous=800, case=0))
    assert device.found == []
    device = swept(1.0)
    device.lane(0.8, planner(TURN, turns=1, distance=900, previous=900, case=0))
    assert len(device.found) == 1


def test_the_estimate_may_be_right_where_the_wheels_are_not() -> None:
    """After a bump the wheels still turn. D agrees with the estimate, which ignores this motion."""
    device = started()
    device.emit_state(planner(LANE))
    device.go(200, CRUISE_M)
    device.follow_pose = False
    device.go(25, CRUISE_M)
    device.follow_pose = True
    device.emit_state(planner(TURN, distance=800, previous=800, case=1))
    device.go(10)
    assert device.found == []
    device.emit_state(planner(LANE, distance=800, previous=800, case=1))
    device.go(100, CRUISE_M)
    device.emit_state(planner(TURN, distance=500, previous=500, case=0))
    device.go(10)
    assert len(device.found) == 1, "wheels and estimate both give 0.4 m"


def test_the_estimated_path_is_along_the_lane() -> None:
    device = started()
    device.pose = Pose2(3.0, 1.0, 0.0)
    device.go(10)
    device.emit_state(planner(LANE))
    device.follow_pose = False
    device.go(200, CRUISE_M)
    device.pose = Pose2(3.5, 1.7, 0.0)  # 0.86 m away, 0.5 m along
    device.go(10)
    device.emit_state(planner(TURN, distance=860, previous=860, case=1))
    device.go(10)
    assert len(device.found) == 1
    assert device.data["odometry_m"] == pytest.approx(0.8, abs=0.005)


def test_a_lane_that_slipped_or_pushed_is_uncertain() -> None:
    device = started()
    device.emit_state(planner(LANE))
    device.go(250, CRUISE_M, lead_m=0.0012)
    device.go(30)
    device.emit_state(planner(TURN, distance=900, previous=900, case=1))
    device.go(20)
    assert device.found == [], "a wheel slips by 6 cm/s for 5 s"
    device = started()
    device.emit_state(planner(LANE))
    device.go(225, CRUISE_M)
    device.contacts = int(Contact.BUMPER_LEFT)
    device.go(25, CRUISE_M)
    device.contacts = 0
    device.follow_pose = False
    device.emit_state(planner(TURN, distance=900, previous=900, case=1))
    device.go(10)
    assert device.found == [], "the robot pushes an obstacle over the last 10 cm"
    device = started()
    device.emit_state(planner(LANE))
    device.contacts = int(Contact.CLIFF)
    device.go(250, CRUISE_M, lead_m=0.0001)
    device.emit_state(planner(TURN, distance=900, previous=900, case=1))
    device.go(10)
    assert len(device.found) == 1, "a cliff is not a push; 5 mm/s is not slip"


def test_uncertainty_belongs_to_one_lane() -> None:
    device = started()
    device.emit_state(planner(LANE))
    device.go(250, CRUISE_M, lead_m=0.0012)
    device.emit_state(planner(TURN, distance=900, previous=900, case=1))
    device.go(60)
    device.lane(1.0, planner(TURN, distance=920, previous=920, case=1))
    assert len(device.found) == 1


# ---- unobserved decisions are not checked --------------------------------------------------


def test_d_is_not_checked_for_a_lane_with_an_unobserved_start() -> None:
    device = Device()
    device.emit_state(planner(LANE))
    device.go(100, CRUISE_M)
    device.emit_state(planner(TURN, distance=1500, previous=1500, case=1))
    device.go(20)
    assert device.found == []


def test_after_a_gap_the_devices_figures_are_taken_over() -> None:
    device = swept(1.0)
    device.emit_state(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    held = device.state
    for _ in range(40):  # 0.8 s without a planner state
        device.walk.step(1, planner=held, onboard="paper", pose=device.pose)
    device.emit_state(planner(TURN, turns=5, distance=1700, previous=1700, case=2))
    device.go(20, rate=0.8)
    assert device.found == []
    device.emit_state(planner(LANE, turns=5, distance=1700, previous=1700, case=2))
    device.go(425, CRUISE_M)
    device.emit_state(planner(TURN, turns=5, distance=1700, previous=1700, case=1))
    device.go(20, rate=0.8)
    assert device.found == [], "the next lane is valid"


def test_a_gap_within_a_lane_leaves_its_beginning_unknown() -> None:
    device = swept(1.0)
    device.emit_state(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    held = device.state
    for _ in range(40):
        device.walk.step(1, planner=held, onboard="paper", pose=device.pose)
    device.go(50, CRUISE_M)
    device.emit_state(planner(TURN, turns=1, distance=1010, previous=1010, case=1))
    device.go(20, rate=0.8)
    assert device.found == []


def test_restart_resets_the_lane() -> None:
    device = swept(1.0)
    device.emit_state(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    device.planner_check.restart()
    device.go(50, CRUISE_M)
    device.emit_state(planner(TURN, turns=1, distance=990, previous=990, case=1))
    device.go(20, rate=0.8)
    assert device.found == []


@pytest.mark.parametrize("onboard", ["recovery", "random", ""])
def test_lane_checks_do_not_apply_to_planners_without_lanes(onboard: str) -> None:
    device = started(onboard)
    device.lane(1.0, planner(TURN, distance=300, previous=77, case=3, length=9, turns=7))
    assert device.found == []


def test_u_shape_reports_no_cases() -> None:
    device = started("u-shape")
    device.lane(1.0, planner(TURN, distance=1000, previous=1000, case=0))
    device.lane(0.4, planner(TURN, distance=400, previous=1000, case=0))
    assert device.found == []
    device.lane(0.4, planner(TURN, distance=500, previous=400, case=0))
    assert len(device.found) == 1


def test_the_host_plans_nothing_is_held() -> None:
    walk = Walk(PlannerCheck(DisagreementRule(), MODEL))
    assert not walk.step(100, left_m=0.004, right_m=0.004, planner=planner(IDLE), onboard="")
    assert not walk.step(100, left_m=0.004, right_m=0.004, planner=None, onboard="paper")


# ---- Prev-D, case, Length, T ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("previous", "found"), [(1000, False), (1005, False), (1100, True), (999, True), (0, True)]
)
def test_prev_d_is_this_lane_or_the_one_before(previous: int, *, found: bool) -> None:
    device = swept(1.0)
    device.lane(1.005, planner(TURN, turns=1, distance=1005, previous=previous, case=1))
    assert bool(device.found) is found
    if found:
        assert device.data == {"Prev_D_m": previous / 1000, "D_before_m": 1.0}


@pytest.mark.parametrize(
    ("distance", "case"),
    [
        *[(1000, 1), (1018, 1), (982, 1), (1023, 0), (977, 0), (1300, 0), (700, 0)],
        *[(1322, 3), (1600, 3), (678, 2), (400, 2)],
    ],
)
def test_the_case_follows_from_d_prev_d_and_phi(distance: int, case: int) -> None:
    for reported in range(4):
        device = swept(1.0)
        state = planner(
            TURN, turns=1, distance=distance, previous=distance, case=reported, length=8
        )
        device.lane(distance / 1000, state)
        assert bool(device.found) is (reported != case), f"reported {reported} after {distance}"
        if reported != case:
            assert device.data["case"] == reported
            assert device.data["expected"] == case
            assert device.data["Prev_D_m"] == 1.0


@pytest.mark.parametrize("distance", [1020, 980, 1021, 979])
def test_at_a_limit_either_case_may_be_right(distance: int) -> None:
    """Both distances are rounded to a millimetre, so the limit is uncertain."""
    for reported in (0, 1):
        device = swept(1.0)
        device.lane(
            distance / 1000,
            planner(TURN, turns=1, distance=distance, previous=distance, case=reported),
        )
        assert device.found == []


def test_the_first_lane_is_case_1() -> None:
    device = started()
    device.lane(1.0, planner(TURN, distance=1000, previous=1000, case=2))
    assert device.data["expected"] == 1
    device = swept(0.0)
    device.lane(1.0, planner(TURN, turns=1, distance=1000, previous=1000, case=3, length=8))
    assert device.found == [], "a lane with D = 0 counts as the previous lane"


@pytest.mark.parametrize(
    ("turns", "length", "found"),
    [(3, 24, False), (3, 25, True), (3, 23, True), (0, 0, False), (0, 1, True), (40, 255, False)],
)
def test_length_is_w_times_t(turns: int, length: int, *, found: bool) -> None:
    """W is 0.16 m. The message has steps of 0.02 m, and 255 means 5.1 m or more."""
    device = swept(1.0, turns=turns and 1)
    for now in range(2, turns + 1):
        device.emit_state(planner(TURN, turns=now, distance=1000, previous=1000, case=1))
        device.go(11, rate=0.8)
    device.lane(
        1.5, planner(BACK, turns=turns, distance=1500, previous=1500, case=3, length=length)
    )
    assert bool(device.found) is found
    if found:
        assert device.data["expected_m"] == pytest.approx(0.16 * turns)
        assert device.data["Length_m"] == pytest.approx(0.02 * length)
        assert device.data["T"] == turns


@pytest.mark.parametrize(
    ("after", "found"), [(1, False), (2, False), (0, False), (3, True), (9, True)]
)
def test_t_grows_by_one_at_a_time(after: int, *, found: bool) -> None:
    device = swept(1.0)
    device.emit_state(planner(STEP, turns=after, distance=1000, previous=1000, case=1))
    device.go(20, CRUISE_M)
    assert bool(device.found) is found
    if found:
        assert device.data == {"T": after, "T_before": 1}


def test_a_finding_is_held_for_two_seconds_and_reported_once() -> None:
    device = started()
    device.lane(1.0, planner(TURN, distance=1100, previous=1100, case=1))
    held = [device.walk.held]
    for steps in (70, 20):
        device.go(steps, rate=0.8)
        held.append(device.walk.held)
    assert held == [True, True, False]
    assert device.planner_check.evidence() == ("", {})
    assert len(device.found) == 1
