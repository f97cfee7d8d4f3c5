"""Evidence from a bump: the obstacle, the forbidden positions of the axle, and their duration."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.planner import Finish, Step
from bridge.coverage.recovery.behaviours.perimeter import follow_perimeter
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import Behaviours, RecoveryPlanner
from bridge.motion.geometry import Pose2
from bridge.motion.legs import FollowWall, LegResult, StopReason, Turn
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from support.recovery import context_at, kinds

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.legs import Leg

MODEL = RobotModel()
OPTIONS = RecoveryOptions()
HERE = Pose2(0.0, 0.0, 0.0)


def empty() -> EvidenceMap:
    return EvidenceMap(MODEL, OPTIONS, HERE)


def standing(memory: EvidenceMap, bearing_deg: float, gap_m: float = 0.004) -> None:
    """Put a known obstacle in front of the footprint's rim, at a bearing from ``HERE``."""
    far, bearing = MODEL.radius_m + gap_m, math.radians(bearing_deg)
    memory.add_point(far * math.cos(bearing), far * math.sin(bearing))


def at(memory: EvidenceMap, x_m: float, y_m: float) -> tuple[int, int]:
    column, row = memory.to_cells(x_m, y_m)
    return int(row), int(column)


def test_one_bumper_switch_alone_blocks_cells_until_its_guess_is_cleared() -> None:
    memory = empty()
    memory.add_bump(HERE, left=True, right=False)
    assert memory.blocked[at(memory, 0.05, 0.02)]  # the obstacle is at the left bumper switch
    assert not memory.blocked[at(memory, 0.05, -0.06)]
    middle = math.radians(38.5)
    guessed = at(memory, 0.165 * math.cos(middle), 0.165 * math.sin(middle))
    assert np.argwhere(memory.wall).tolist() == [list(guessed)]
    assert memory.inflated.any()
    assert memory.clear_bumps(0.2)
    assert not memory.wall.any()
    assert not memory.inflated.any()


def test_a_second_bump_there_does_not_confirm_a_guess() -> None:
    memory = empty()
    memory.add_bump(HERE, left=True, right=False)
    memory.add_bump(Pose2(0.002, 0.0, 0.0), left=True, right=False)
    assert memory.wall.sum() == 4
    assert memory.clear_bumps(0.2)
    assert not memory.wall.any()


def test_both_bumper_switches_mean_an_obstacle_ahead() -> None:
    memory = empty()
    memory.add_bump(HERE, left=True, right=True)
    assert np.argwhere(memory.wall).tolist() == [list(at(memory, 0.165, 0.0))]
    assert memory.clear_bumps(0.2)
    assert memory.wall.any()


@pytest.mark.parametrize("bearing_deg", [-5.0, 20.0, 40.0, 80.0])
def test_evidence_at_the_rim_counts_as_contact(bearing_deg: float) -> None:
    memory = empty()
    standing(memory, bearing_deg)
    before = int(memory.wall.max())
    memory.add_bump(HERE, left=True, right=False)
    assert memory.wall.max() > before
    assert (memory.wall > 0).sum() <= 2
    found = math.degrees(memory.contact_rad(HERE, left=True, right=False))
    assert found == pytest.approx(bearing_deg, abs=5.0)


def test_evidence_on_the_other_side_does_not_count() -> None:
    memory = empty()
    standing(memory, -40.0)
    assert memory.contact_rad(HERE, left=True, right=False) == pytest.approx(math.radians(38.5))


def test_a_followed_wall_is_not_the_contact() -> None:
    """The followed convex wall is abeam on the right. An unknown obstacle is ahead to the right."""
    memory = empty()
    standing(memory, -75.0, 0.002)
    met = memory.contact_rad(HERE, left=False, right=True)
    assert math.degrees(met) == pytest.approx(-75.0, abs=5.0)
    followed = memory.contact_rad(HERE, left=False, right=True, beside=-1)
    assert math.degrees(followed) == pytest.approx(-25.0)
    standing(memory, -45.0)
    followed = memory.contact_rad(HERE, left=False, right=True, beside=-1)
    assert math.degrees(followed) == pytest.approx(-45.0, abs=5.0)
    assert memory.contact_rad(HERE, left=False, right=True, beside=1) != followed
    standing(memory, 75.0, 0.002)
    followed = memory.contact_rad(HERE, left=True, right=False, beside=1)
    assert math.degrees(followed) == pytest.approx(25.0)


def test_clearing_bumps_keeps_observed_evidence() -> None:
    memory = empty()
    memory.add_point(0.5, 0.5)
    standing(memory, 0.0)
    memory.abandon(0.2, 0.0, 0.05)
    memory.abandon(1.5, 1.5, 0.05)
    memory.add_bump(HERE, left=True, right=True)
    walls = memory.wall.copy()
    assert memory.clear_bumps(0.2)
    assert not memory.blocked.any()
    assert (memory.wall == walls).all()
    assert not memory.attempts[at(memory, 0.2, 0.0)]  # near the bump, one more try is allowed
    assert memory.attempts[at(memory, 1.5, 1.5)] == 1
    assert not memory.clear_bumps(0.2)


class Following:
    """A perimeter pass with the wall on the right, and repeated bumps at one position."""

    def __init__(self, bearing_deg: float = 0.0, *, model: RobotModel = MODEL) -> None:
        self.context = context_at(AT_REST._replace(pose=HERE), model)
        if bearing_deg:
            standing(self.context.evidence_map, -75.0, 0.002)  # the followed wall
            standing(self.context.evidence_map, bearing_deg)

    def speed_limit_m_s(self, side: int, v_m_s: float, yaw_rate_rad_s: float) -> float:
        """Return the speed limit at an observation along a wall on a side."""
        monitor = self.context.monitor
        monitor.wall.side = side
        seen = AT_REST._replace(time_s=5.0, pose=HERE)
        monitor.observe(seen._replace(v_m_s=v_m_s, yaw_rate_rad_s=yaw_rate_rad_s))
        return monitor.speed_limit_m_s

    def turns_deg(self, path_m: float, count: int) -> list[float]:
        """Return the turns away from the wall, with a bump after each path of this length."""
        turns: list[float] = []
        monitor = self.context.monitor
        script = follow_perimeter(self.context, left=False)
        leg = next(script)
        while len(turns) < count:
            bumped = False
            if isinstance(leg, FollowWall):
                monitor.wall.distance_m += path_m
                bumped = True
            elif isinstance(leg, Turn):
                turns.append(math.degrees(leg.heading_rad))
            reason = StopReason.BUMPER if bumped else StopReason.DISTANCE
            result = LegResult(leg, reason, path_m, 1.0, HERE, bumper_right=bumped)
            leg = script.send(Step(result, monitor.obs))
        return turns


@pytest.mark.parametrize(
    ("side", "yaw_rad_s", "speed_limit_m_s"),
    [(-1, 0.0, 0.3), (-1, 0.29, 0.3), (-1, -0.31, 0.2), (1, 0.6, 0.2), (0, 0.6, 0.3)],
)
def test_along_a_bend_it_is_slower_than_along_a_straight_wall(
    side: int, yaw_rad_s: float, speed_limit_m_s: float
) -> None:
    limit_m_s = Following().speed_limit_m_s(side, 0.2, yaw_rad_s)
    assert limit_m_s == pytest.approx(speed_limit_m_s)


def test_a_bend_is_followed_no_faster_than_the_robot_cruises() -> None:
    slow = replace(MODEL, cruise_speed_m_s=0.1)
    assert Following(model=slow).speed_limit_m_s(-1, 0.1, 0.5) == pytest.approx(0.1)


def test_a_straight_wall_is_followed_a_little_faster_than_the_robot_cruises() -> None:
    for model, speed_m_s in ((MODEL, 0.24), (replace(MODEL, cruise_speed_m_s=0.1), 0.12)):
        leg = next(follow_perimeter(Following(model=model).context, left=True))
        assert isinstance(leg, FollowWall)
        assert leg.speed_m_s == pytest.approx(speed_m_s)


def test_the_first_contact_may_be_a_corner_of_the_followed_wall_the_second_not() -> None:
    assert Following(-45.0).turns_deg(0.3, 2) == pytest.approx([15.0, 15.0], abs=5.0)
    assert Following(-45.0).turns_deg(0.03, 2) == pytest.approx([15.0, 45.0], abs=5.0)


def test_repeated_contact_turns_farther_each_time() -> None:
    turns = Following(-57.0).turns_deg(0.03, 5)
    assert turns[:2] == pytest.approx([15.0, 33.0], abs=5.0)
    assert turns[3:] == pytest.approx([48.0, 60.0])
    assert max(Following(-57.0).turns_deg(0.03, 20)) == pytest.approx(90.0)
    assert Following(-57.0).turns_deg(0.1, 5)[3:] == pytest.approx(turns[:1] * 2)


def goes_on(context: RecoveryContext) -> bool:
    """Return whether it chooses again before the end, and reports this."""
    again = context.stuck.clear_bumps()
    assert kinds(context) == ["clear"] * again
    return again


def test_before_the_end_bumps_are_cleared_once_and_again_after_new_floor() -> None:
    assert not goes_on(context_at())  # no bump, nothing to clear
    context = context_at()
    context.evidence_map.add_bump(HERE, left=True, right=True)
    assert goes_on(context)
    context.evidence_map.add_bump(HERE, left=True, right=True)
    assert not goes_on(context)
    context.evidence_map.new_cells += 249
    assert not goes_on(context)
    context.evidence_map.new_cells += 1
    assert goes_on(context)


def bump(context: RecoveryContext) -> Generator[Leg, Step]:
    context.evidence_map.add_bump(HERE, left=True, right=True)
    yield from ()


def nothing(_context: RecoveryContext) -> Generator[Leg, Step, Choice | None]:
    yield from ()
    return None


def test_a_plan_does_not_end_before_it_chose_again() -> None:
    planner = RecoveryPlanner(MODEL, behaviours=Behaviours(approach=bump, choose=nothing))
    assert isinstance(planner.start(AT_REST._replace(pose=HERE)), Finish)
    assert [event.kind for event in planner.drain_events()] == ["start", "clear", "finish"]
