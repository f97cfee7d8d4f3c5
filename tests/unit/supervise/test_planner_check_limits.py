"""The check of the device's planner exactly at its limits, with measurements set by the test."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.planner_check import PlannerCheck
from bridge.supervise.settings import DisagreementRule
from protocol.messages.device import PlannerState, Range
from protocol.messages.values import Contact, PlannerPhase
from support.watching import MODEL, planner, reading

LANE, TURN, STEP, PAUSED = (
    PlannerPhase.LANE,
    PlannerPhase.TURN,
    PlannerPhase.STEP,
    PlannerPhase.PAUSED,
)
if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

START = Pose2(0.0, 0.0, 0.0)


class Hand:
    """A planner check with odometry that the test sets."""

    def __init__(
        self,
        onboard: str = "paper",
        *,
        model: RobotModel = MODEL,
        motion_s: float = 8.0,
        distance_m: float = 0.03,
        equal_m: float = 0.02,
    ) -> None:
        rule = DisagreementRule(distance_m=distance_m, equal_m=equal_m, motion_s=motion_s)
        self.planner_check = PlannerCheck(rule, model)
        self.measured = Measured(MODEL)
        self.onboard = onboard

    def at(
        self,
        time_s: float,
        reported: PlannerState | None,
        pose: Pose2 = START,
        *,
        contacts: int | None = None,
    ) -> bool:
        seen: Range | None = None if contacts is None else reading(contacts=contacts)
        inputs = RuleInputs(
            *(time_s, pose, 0.0, 0.0), planner=reported, onboard=self.onboard, range=seen
        )
        return self.planner_check.holds(inputs, self.measured)

    def lane(self, path_m: float, after: PlannerState, before: PlannerState | None = None) -> bool:
        """Drive a lane that starts at an odometry of 0; the estimated pose does not move."""
        turn, lane = (
            PlannerState(phase, *tuple(before or planner(LANE))[1:]) for phase in (TURN, LANE)
        )
        self.at(0.0, turn)
        self.at(0.25, lane)
        self.measured.distance_m = path_m
        self.at(0.5, lane)
        return self.at(0.75, after)


def test_nothing_is_grave_and_nothing_held_without_a_planner() -> None:
    hand = Hand()
    assert hand.planner_check.grave is False
    assert hand.at(0.0, None) is False
    hand.onboard = ""
    assert hand.at(0.0, planner(LANE)) is False
    assert hand.planner_check.evidence() == ("", {})


@pytest.mark.parametrize(("path_m", "found"), [(1.0, False), (1.0001, True)])
def test_d_may_be_off_by_its_limit(path_m: float, *, found: bool) -> None:
    """The limit is 0.125 m, and the device reports 0.875 m."""
    hand = Hand(distance_m=0.125)
    after = planner(TURN, distance=875, previous=875, case=1)
    assert hand.lane(path_m, after) is found
    if found:
        assert hand.planner_check.evidence() == (
            "the device reports D = 0.875 m, odometry is 1.000 m",
            {"D_m": 0.875, "odometry_m": 1.0, "for_s": 0.75},
        )


def test_the_evidence_is_in_millimetres_and_hundredths() -> None:
    hand = Hand()
    hand.at(1.0, planner(TURN))
    hand.at(1.126, planner(LANE))
    hand.measured.distance_m = 1.23456
    hand.at(1.313, planner(TURN, distance=1000, previous=1000, case=1))
    assert hand.planner_check.evidence()[1] == {"D_m": 1.0, "odometry_m": 1.235, "for_s": 0.31}
    hand.planner_check.restart()
    assert hand.at(1.4, planner(LANE)) is False


def test_a_lane_begins_where_the_odometry_was() -> None:
    hand = Hand()
    hand.measured.distance_m = 5.0
    hand.at(0.0, planner(TURN))
    hand.at(0.25, planner(LANE))
    hand.measured.distance_m = 6.0
    assert hand.at(0.5, planner(TURN, distance=1000, previous=1000, case=1)) is False
    hand.at(0.75, planner(LANE, distance=1000, previous=1000, case=1))
    hand.measured.distance_m = 7.1
    assert hand.at(1.0, planner(TURN, distance=1000, previous=1000, case=1)) is True
    assert hand.planner_check.evidence()[1]["odometry_m"] == 1.1


def test_the_estimated_path_is_along_any_heading() -> None:
    """The robot moves 0.5 m along the lane (0.3 m in x, 0.4 m in y). Lateral motion is ignored."""
    hand = Hand()
    start = Pose2(2.0, 3.0, 0.9272952180016122)  # atan2(4, 3)
    hand.at(0.0, planner(TURN), start)
    hand.at(0.25, planner(LANE), start)
    hand.at(0.3, planner(LANE), Pose2(2.3 - 0.08, 3.4 + 0.06, 0.0))
    hand.at(0.4, planner(LANE), Pose2(2.2, 3.2, 0.0))
    assert hand.at(0.5, planner(TURN, distance=520, previous=520, case=1), start) is False
    hand.at(0.75, planner(LANE, distance=520, previous=520, case=1), start)
    hand.at(0.9, planner(LANE, distance=520, previous=520, case=1), Pose2(2.3, 3.4, 0.0))
    assert hand.at(1.0, planner(TURN, distance=540, previous=540, case=1), start) is True
    assert hand.planner_check.evidence()[1]["odometry_m"] == 0.5


@pytest.mark.parametrize(
    ("slip_m_s", "contacts", "found"),
    [
        *((0.012, None, True), (0.0121, None, True), (0.25, None, False), (-0.25, None, False)),
        *((0.0, int(Contact.BUMPER_LEFT), False), (0.0, int(Contact.CLIFF), True)),
    ],
)
def test_slip_and_push_make_part_of_the_path_uncertain(
    slip_m_s: float, contacts: int | None, *, found: bool
) -> None:
    """D is wrong by 9 cm, and 3 cm are allowed. Slip for 0.25 s or a push adds up to 6.25 cm."""
    hand = Hand()
    hand.at(0.0, planner(TURN))
    hand.at(0.25, planner(LANE))
    measured = hand.measured
    measured.distance_m, measured.slip_m_s, measured.step_s = 1.0, slip_m_s, 0.25
    measured.left_m = measured.right_m = 0.0625
    hand.at(0.5, planner(LANE), contacts=contacts)
    measured.slip_m_s = measured.left_m = measured.right_m = 0.0
    assert hand.at(0.75, planner(TURN, distance=910, previous=910, case=1)) is found


def test_a_slip_inflates_from_its_limit_on() -> None:
    """Slip of 12 mm/s for 2 s (2.4 cm) is ignored; slightly more slip makes D uncertain."""
    for slip_m_s, found in ((0.012, True), (0.01201, False)):
        hand = Hand()
        hand.at(0.0, planner(TURN))
        hand.at(0.25, planner(LANE))
        hand.measured.distance_m, hand.measured.slip_m_s, hand.measured.step_s = 1.0, slip_m_s, 2.0
        hand.at(0.5, planner(LANE))
        hand.measured.slip_m_s = 0.0
        assert hand.at(0.75, planner(TURN, distance=950, previous=950, case=1)) is found


def test_a_push_inflates_by_the_wheels_mean() -> None:
    """One wheel turns 8 cm and the other none, so the mean is 4 cm."""
    for off_mm, found in ((65, False), (75, True)):
        hand = Hand()
        hand.at(0.0, planner(TURN))
        hand.at(0.25, planner(LANE))
        hand.measured.distance_m, hand.measured.left_m = 1.0, 0.08
        hand.at(0.5, planner(LANE), contacts=int(Contact.BUMPER_RIGHT))
        hand.measured.left_m = 0.0
        reported = 1000 - off_mm
        assert hand.at(0.75, planner(TURN, distance=reported, previous=reported, case=1)) is found


def test_a_state_may_be_0_7_s_late() -> None:
    for gap_s, found in ((0.7, True), (0.7001, False)):
        hand = Hand()
        hand.at(-0.25, planner(TURN))
        hand.at(0.0, planner(LANE))
        assert hand.at(gap_s, planner(TURN, distance=500, previous=500, case=1)) is found


def test_a_finding_is_held_for_two_seconds() -> None:
    hand = Hand()
    assert hand.lane(1.0, planner(TURN, distance=500, previous=500, case=1))
    state = planner(TURN, distance=500, previous=500, case=1)
    assert hand.at(2.75, state) is True
    assert hand.at(2.7501, state) is False


@pytest.mark.parametrize(
    "before",
    [
        planner(LANE, distance=1000),
        planner(LANE, distance=1000, case=1),
        planner(LANE, distance=1000, turns=1),
    ],
)
def test_a_lane_after_another_is_not_the_first(before: PlannerState) -> None:
    hand = Hand()
    turns = before.turn_count
    after = planner(TURN, turns=turns, distance=500, previous=500, case=2)
    assert hand.lane(0.5, after, before) is False
    hand = Hand()
    after = planner(TURN, turns=turns, distance=500, previous=500, case=1)
    assert hand.lane(0.5, after, before) is True


@pytest.mark.parametrize("before", [planner(LANE, case=2), planner(LANE, turns=1)])
def test_a_lane_after_one_of_no_length_is_not_the_first(before: PlannerState) -> None:
    hand = Hand()
    turns = before.turn_count
    after = planner(TURN, turns=turns, distance=500, previous=0, case=3, length=8 * turns)
    assert hand.lane(0.5, after, before) is False


@pytest.mark.parametrize(
    ("distance", "cases"),
    [
        # Φ is 0.32 m. D is rounded to a millimetre, so both cases are valid up to 0.321 m.
        *((680, {0, 2}), (679, {0, 2}), (678, {2}), (682, {0})),
        *((1320, {0, 3}), (1321, {0, 3}), (1322, {3}), (1318, {0})),
        *((1020, {0, 1}), (1021, {0, 1}), (1022, {0}), (1018, {1})),
    ],
)
def test_every_limit_of_a_case(distance: int, cases: set[int]) -> None:
    before = planner(LANE, turns=1, distance=1000, previous=1000, case=1)
    for case in range(4):
        hand = Hand()
        after = planner(TURN, turns=1, distance=distance, previous=distance, case=case, length=8)
        assert hand.lane(distance / 1000, after, before) is (case not in cases), case
        if case not in cases:
            assert hand.planner_check.evidence()[1]["expected"] == min(cases)


@pytest.mark.parametrize(("equal_m", "cases"), [(0.25, {0, 1}), (0.2489, {0})])
def test_equal_may_differ_by_its_limit(equal_m: float, cases: set[int]) -> None:
    """The distances differ by 0.25 m. Rounding may account for 1 mm of the difference."""
    before = planner(LANE, turns=1, distance=1000, previous=1000, case=1)
    for case in (0, 1):
        hand = Hand(equal_m=equal_m)
        after = planner(TURN, turns=1, distance=750, previous=750, case=case)
        assert hand.lane(0.75, after, before) is (case not in cases)


@pytest.mark.parametrize(
    ("width_m", "length", "found"),
    [
        # Length is reported in steps of 2 cm. 3 · 0.15 m = 0.45 m is between two steps, and
        # 3 · 0.1234 m = 0.3702 m is near a step.
        *((0.15, 22, False), (0.15, 23, False), (0.15, 24, True), (0.15, 21, True)),
        *((0.1234, 19, False), (0.1234, 18, False), (0.1234, 20, True)),
    ],
)
def test_length_is_measured_to_half_a_step(width_m: float, length: int, *, found: bool) -> None:
    hand = Hand(model=replace(MODEL, cleaning_width_m=width_m))
    before = planner(LANE, turns=3, distance=1000, previous=1000, case=1)
    after = planner(TURN, turns=3, distance=1500, previous=1500, case=3, length=length)
    assert hand.lane(1.5, after, before) is found
    if found:
        assert hand.planner_check.evidence()[1]["expected_m"] == (0.45 if width_m == 0.15 else 0.37)


def test_planners_without_lanes_may_bend() -> None:
    for onboard, found in (("paper", True), ("u-shape", True), ("recovery", False)):
        hand = Hand(onboard, motion_s=2.0)
        hand.at(0.0, reported := planner(LANE))
        hand.measured.turn_rad = 3.0
        assert hand.at(2.0, reported) is found


@pytest.mark.parametrize(
    ("phase", "path_m", "turn_rad", "wrong"),
    [
        # Limits in 2 s: 6 cm and 0.3 rad at rest, 12 cm in a turn, 1.2 rad in a lane.
        *((PAUSED, 0.06, 0.3, ""), (PAUSED, 0.0601, 0.0, "moves"), (PAUSED, 0.0, 0.301, "moves")),
        *((PAUSED, 0.0, -0.301, "moves"), (TURN, 0.12, 3.0, ""), (TURN, 0.1201, 3.0, "drives")),
        *((LANE, 0.4, 1.2, ""), (LANE, 0.4, -1.201, "turns"), (STEP, 0.1, 1.201, "turns")),
    ],
)
def test_tolerance_of_a_claim(phase: int, path_m: float, turn_rad: float, wrong: str) -> None:
    hand = Hand(motion_s=2.0)
    hand.at(0.0, reported := planner(phase))
    hand.measured.travel_m, hand.measured.turn_rad = path_m, turn_rad
    assert hand.at(1.999, reported) is False
    assert hand.at(2.0, reported) is bool(wrong)
    text, data = hand.planner_check.evidence()
    assert wrong in text
    if wrong:
        assert data["for_s"] == 2.0


@pytest.mark.parametrize(
    ("onboard", "path_m", "turn_rad", "found"),
    [
        # In 2 s, 12 cm plus an arc of 2 rad on the radius 0.16 m (W): 44 cm.
        *(("recovery", 0.4399, 2.0, False), ("recovery", 0.4401, 2.0, True)),
        *(("recovery", 0.4399, -2.0, False), ("recovery", 0.1201, 0.0, True)),
        *(("paper", 0.1201, 2.0, True), ("u-shape", 0.1201, 2.0, True)),
    ],
)
def test_only_planners_without_lanes_may_turn_on_an_arc(
    onboard: str, path_m: float, turn_rad: float, *, found: bool
) -> None:
    hand = Hand(onboard, motion_s=2.0)
    hand.at(0.0, reported := planner(TURN))
    hand.measured.travel_m, hand.measured.turn_rad = path_m, turn_rad
    assert hand.at(2.0, reported) is found


def test_a_longer_time_between_tests_allows_more() -> None:
    """12 cm are allowed in 4 s at rest. A tested interval does not count again."""
    hand = Hand(motion_s=2.0)
    hand.at(0.0, reported := planner(PAUSED))
    hand.measured.travel_m = 0.12
    assert hand.at(4.0, reported) is False
    hand.measured.travel_m, hand.measured.turn_rad = 0.18, 0.3
    assert hand.at(6.0, reported) is False
    hand.measured.travel_m, hand.measured.turn_rad = 0.30456, 0.61239
    assert hand.at(8.126, reported) is True
    assert hand.planner_check.evidence() == (
        "the device reports paused, but it moves: 12 cm and 0.31 rad in 2.1 s",
        {"phase": "paused", "path_m": 0.125, "turn_rad": 0.312, "for_s": 2.13},
    )


def test_a_new_claim_is_tested_from_its_beginning() -> None:
    hand = Hand(motion_s=2.0)
    hand.at(0.0, planner(LANE))
    hand.measured.travel_m, hand.measured.turn_rad = 0.5, 1.0
    assert hand.at(1.5, reported := planner(PAUSED)) is False
    assert hand.at(3.4, reported) is False
    assert hand.at(3.5, reported) is False, "the robot stands still since it reports a pause"
    assert hand.at(5.5, planner(PAUSED)) is False
