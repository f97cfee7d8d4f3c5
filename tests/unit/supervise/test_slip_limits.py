"""The slip rule exactly at its limits, with measurements set by the test."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.slip import Slip, _lost
from bridge.supervise.settings import SlipRule
from support.watching import MODEL, reading


class Hand:
    """A slip rule with odometry that the test sets."""

    def __init__(self, share: float = 0.25) -> None:
        self.rule = Slip(SlipRule(difference_m_s=0.015, share=share))
        self.measured = Measured(MODEL)
        self.measured.new_range = True
        self.measured.step_s = 0.02

    def at(self, path_m: float, range_m: float, *, turn_rad: float = 0.0) -> bool:
        self.measured.distance_m, self.measured.turn_rad = path_m, turn_rad
        seen = reading(range_m)
        return self.rule.holds(
            RuleInputs(0.0, Pose2(0.0, 0.0, 0.0), 0.0, 0.0, range=seen), self.measured
        )

    def run(self, closing: float = 0.0, *, from_m: float = 2.0, turn_rad: float = 0.0) -> bool:
        """Send twelve readings over 0.3 m."""
        for number in range(12):
            path_m = 0.3 if number == 11 else 0.025 * number
            held = self.at(path_m, from_m - closing * path_m, turn_rad=turn_rad)
        return held


def test_no_single_finding_requires_the_second_reaction() -> None:
    hand = Hand()
    assert hand.rule.grave is False
    assert hand.run() is True
    assert hand.rule.grave is False


def test_a_range_that_does_not_close_at_all_lost_all_of_the_way() -> None:
    assert Hand(share=1.0).run(from_m=0.0) is False, "a lost share equal to the limit is allowed"
    hand = Hand(share=0.999)
    assert hand.run() is True
    text, data = hand.rule.evidence()
    assert text.startswith(
        "the range ahead decreases by 0 % of the wheel distance: the wheels slip, "
    )
    assert data == {"by": "ultrasonic", "lost_share": 1.0}
    hand = Hand()
    hand.run(closing=1 / 3)
    assert hand.rule.evidence()[1]["lost_share"] in {0.666, 0.667, 0.668}, "rounded to 0.001"


def test_a_gap_ends_the_run() -> None:
    hand = Hand()
    for number in range(30):
        hand.measured.step_s = 0.02 if number % 10 else 0.0
        assert not hand.at(0.025 * number, 2.0), number


def test_a_range_counts_up_to_3_5_m() -> None:
    assert Hand().run(from_m=3.5) is True
    assert Hand().run(from_m=3.501) is False


def test_a_run_may_bend_by_its_limit() -> None:
    for turn_rad, held in ((0.06, True), (-0.06, True), (0.0601, False)):
        hand = Hand()
        hand.at(0.0, 2.0)
        for number in range(1, 12):
            found = hand.at(0.3 if number == 11 else 0.025 * number, 2.0, turn_rad=turn_rad)
        assert found is held


def test_a_range_may_jump_by_3_cm_beyond_the_driven_path() -> None:
    """The range increases by the driven distance, and then by 0.53 m over 0.5 m."""
    for range_m, held in ((0.63, True), (0.631, False)):
        hand = Hand()
        for number in range(11):
            hand.at(number / 100, number / 100)
        assert hand.at(0.6, range_m) is held


def test_readings_at_rest_do_not_count_again() -> None:
    """42 readings at seven places are too few for a result."""
    hand = Hand()
    for number in range(7):
        for _ in range(6):
            assert not hand.at(0.05 * number, 2.0)


def test_a_run_is_of_the_last_0_3_m() -> None:
    """The range decreases correctly for 1 m, and then by half of the distance for 0.36 m."""
    hand = Hand()
    range_m, path_m, held = 2.5, 0.0, False
    for number in range(136):
        path_m += 0.01
        range_m -= 0.01 if number < 100 else 0.005
        held = hand.at(path_m, range_m) or held
    assert held


def test_a_fault_found_by_both_pairs_is_reported_by_the_gyro_only_beyond_its_limit() -> None:
    for slip_m_s, by in ((0.015, "ultrasonic"), (0.0151, "gyro"), (-0.015, "ultrasonic")):
        hand = Hand()
        hand.measured.slip_m_s = slip_m_s
        assert hand.run() is True
        assert hand.rule.evidence()[1]["by"] == by


@pytest.mark.parametrize(("slip_m_s", "side"), [(0.123456, "right"), (-0.123456, "left")])
def test_the_wheel_that_is_ahead_is_named(slip_m_s: float, side: str) -> None:
    hand = Hand()
    hand.measured.slip_m_s = slip_m_s
    assert hand.at(0.0, 1.0) is True
    text, data = hand.rule.evidence()
    assert text == (f"wheels and gyro differ by 12 cm/s: the {side} wheel leads the gyro's turn")
    assert data == {"by": "gyro", "difference_m_s": 0.1235 if side == "right" else -0.1235}


@pytest.mark.parametrize(
    ("half", "rest", "lost"),
    [
        # Values are in 1/32 m. In the first three cases the range at the end equals the range at
        # the start, so the whole distance is lost. In the halves, the range changes by 0.4 (the
        # limit), 0.486 and slightly less than 0.4 of the distance.
        *(([1, 1, 0, -1, 0, -1], None, 0.0), ([1, 1, 0, -1, -1, -1], None, 0.0)),
        ([1, 1, 0, -1, 0, -0.99], None, 1.0),
        # The range decreases by 0.7 of the distance in the first third, and not in the first half.
        ([1, 1, 0, -1, 1, 1.2], [0.0] * 6, 0.933),
    ],
)
def test_each_half_must_show_more_than_0_6_of_the_whole(
    half: list[float], rest: list[float] | None, lost: float
) -> None:
    ranges = half + (half[::-1] if rest is None else rest)
    points = [(way / 32, range_ / 32) for way, range_ in enumerate(ranges)]
    assert _lost(points) == pytest.approx(lost, abs=5e-4)
