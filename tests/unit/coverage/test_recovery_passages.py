"""Narrow doors: the robot follows an obstacle after it was blocked there twice."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.planner import Finish, Step
from bridge.coverage.recovery.behaviours.perimeter import follow_perimeter
from bridge.coverage.recovery.behaviours.transit import transit
from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import Behaviours, RecoveryPlanner
from bridge.coverage.recovery.search import Choice, Chooser
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, FollowWall, Leg, LegResult, StopReason, Turn
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST
from support.recovery import choose, context_at, kinds

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import PlannerEvent
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.observation import Observation

MODEL = RobotModel()
OPTIONS = RecoveryOptions()
GEOMETRY = PlannerGeometry.from_model(MODEL, OPTIONS)
HERE = Pose2(0.0, 0.0, 0.0)
BEYOND = (1.0, 0.0)
MIDDLE_DEG = 38.5
"""Bearing of the middle of a bumper switch, °; an unknown contact is assumed there."""


def seen(pose: Pose2 = HERE, v_m_s: float = 0.0) -> Observation:
    return AT_REST._replace(pose=pose, v_m_s=v_m_s)


class AtDoor:
    """A robot 1 m before a door with floor behind it; the floor on this side is swept."""

    def __init__(self) -> None:
        self.context = context_at(seen())
        self.map = self.context.evidence_map
        self.map.swept[:] = 1
        self.stand(HERE)

    def stand(self, pose: Pose2, wall_m: float = 0.6) -> None:
        """Stand at a pose, with this length of wall known ahead, but not at the rim."""
        self.context.monitor.obs = seen(pose)
        for k in range(round(wall_m / GEOMETRY.cell_m)):
            self.map.add_point(*pose.transform(0.25, 0.5 * wall_m - k * GEOMETRY.cell_m))

    def goes(
        self,
        reason: StopReason = StopReason.BUMPER,
        *,
        left: bool = False,
        right: bool = False,
        new_m2: float = 0.1,
    ) -> tuple[list[Leg], list[str]]:
        """Drive towards the floor beyond until blocked; return the legs and the decisions."""
        script = transit(self.context, Choice("lane", (BEYOND,), 0.0, 0.5, new_m2=new_m2))
        legs: list[Leg] = [next(script)]
        pose = self.context.pose
        while not isinstance(leg := legs[-1], FollowWall):
            ahead = isinstance(leg, Drive) and (leg.distance_m or 0.0) > 0.0
            if ahead:
                result = LegResult(leg, reason, 0.0, 1.0, pose, left, right)
            else:
                result = LegResult(leg, StopReason.DONE, 0.0, 1.0, pose)
            try:
                legs.append(script.send(Step(result, self.context.obs)))
            except StopIteration:
                break
        return legs, kinds(self.context)

    def blames(self, choice: Choice) -> bool:
        """Return whether it abandons the place after a path that did not arrive there."""
        self.context.stuck.take(choice, 0, self.context.pose, arrived=False)
        return kinds(self.context) == ["abandon"]

    def follows(self, min_m: float) -> float:
        """Return how far it follows a swept wall on its right, in steps of 1 cm."""
        next(follow_perimeter(self.context, left=False, min_m=min_m))
        return self.closed_m()

    def goes_on(self, followed_m: float) -> bool:
        """Return whether it continues after a bump at this distance along a swept wall."""
        script = follow_perimeter(self.context, left=False, min_m=0.4)
        leg = next(script)
        self.context.monitor.wall.distance_m = followed_m
        bumped = LegResult(leg, StopReason.BUMPER, followed_m, 1.0, HERE, bumper_right=True)
        for _ in range(9):
            try:
                leg = script.send(Step(bumped, self.context.obs))
            except StopIteration:
                return False
        return True

    def closed_m(self) -> float:
        """Return how far it follows from here on."""
        for k in range(200):
            if self.context.monitor.observe(seen(Pose2(0.01 * k, 0.0, 0.0), 0.1)):
                return 0.01 * k
        return math.inf


@pytest.mark.parametrize("left", [True, False])
def test_an_obstacle_that_blocks_twice_is_followed_on_the_side_of_contact(*, left: bool) -> None:
    planner = AtDoor()
    legs, reported = planner.goes(left=left, right=not left)
    assert not any(isinstance(leg, FollowWall) for leg in legs)
    assert "passage-sought" not in reported
    legs, reported = planner.goes(left=left, right=not left)
    assert reported[-2:] == ["passage-sought", "perimeter-begin"]
    turn, follow = legs[-2:]
    assert isinstance(turn, Turn)
    away = MIDDLE_DEG - 90.0
    assert math.degrees(turn.heading_rad) == pytest.approx(away if left else -away, abs=5.0)
    assert isinstance(follow, FollowWall)
    assert (follow.left, follow.touching) == (left, True)


def test_a_perpendicular_or_visible_wall_gives_no_bearing() -> None:
    planner = AtDoor()
    for _ in range(4):
        assert "passage-sought" not in planner.goes(left=True, right=True)[1]
    planner = AtDoor()
    for _ in range(4):
        assert "passage-sought" not in planner.goes(StopReason.RANGE)[1]
    planner = AtDoor()
    for _ in range(4):
        assert "passage-sought" not in planner.goes(StopReason.STALLED, left=True)[1]


def test_a_sliver_is_not_worth_it() -> None:
    planner = AtDoor()
    for _ in range(4):
        assert "passage-sought" not in planner.goes(left=True, new_m2=0.02)[1]
    assert "passage-sought" in planner.goes(left=True, new_m2=0.04)[1]


def test_a_leg_leads_only_round_itself() -> None:
    planner = AtDoor()
    planner.map.wall[:] = 0
    planner.stand(HERE, 0.16)
    for _ in range(4):
        assert "passage-sought" not in planner.goes(left=True)[1]
    planner.stand(HERE, 0.4)
    assert "passage-sought" in planner.goes(left=True)[1]


def test_occupied_cells_are_counted_about_a_point() -> None:
    memory = EvidenceMap(MODEL, OPTIONS, HERE)
    for x_m, y_m in ((1.0, 1.0), (1.0, 1.1), (1.1, 1.0), (1.15, 1.15), (-1.0, 1.0)):
        memory.add_point(x_m + 0.01, y_m + 0.01)
    memory.add_point(1.05, 1.05, weight=1)  # not certain
    assert memory.count_occupied(1.01, 1.01, 0.15) == 3
    assert memory.count_occupied(1.01, 1.01, 0.25) == 4
    assert memory.count_occupied(0.0, 0.0, 0.5) == 0


def test_a_swept_wall_is_followed_farther_if_it_may_lead_to_a_passage() -> None:
    assert AtDoor().follows(0.25) == pytest.approx(0.3, abs=0.03)
    assert AtDoor().follows(0.4) == pytest.approx(0.45, abs=0.03)
    planner = AtDoor()
    planner.goes(left=False, right=True)
    planner.goes(left=False, right=True)
    assert planner.closed_m() == pytest.approx(0.45, abs=0.03)
    # the next perimeter is an ordinary one
    assert planner.follows(0.25) == pytest.approx(0.3, abs=0.03)


def test_a_bump_during_the_transit_does_not_end_it_early() -> None:
    for followed_m, goes_on in ((0.3, True), (0.5, False)):
        assert AtDoor().goes_on(followed_m) is goes_on


def parted(cells: int) -> EvidenceMap:
    """Return a map in which the robot came through a line forbidden by bumps, ``cells`` wide."""
    memory = EvidenceMap(MODEL, OPTIONS, HERE)
    row, column = (int(v) for v in memory.to_cells(0.0, 0.0)[::-1])
    memory.swept[:] = 1
    memory.visited[row, column - 10 - cells : column - 10] = 1
    memory.blocked[:, column - 8] = 1
    x_m, _ = memory.to_metres(column - 10 - cells, row)
    memory.include(x_m, 0.0)  # as if driven there
    return memory


def test_evidence_that_separates_the_robot_from_its_past_encloses_it() -> None:
    for cells, enclosed in ((60, True), (40, False)):
        chooser = Chooser(OPTIONS)
        assert choose(chooser, parted(cells), HERE, 0.0) is None
        assert chooser.enclosed is enclosed
    memory = parted(60)
    memory.blocked[:] = 0
    chooser = Chooser(OPTIONS)
    assert choose(chooser, memory, HERE, 0.0) is None
    assert not chooser.enclosed


def test_a_trail_along_a_wall_seen_later_does_not_count() -> None:
    """The robot's place was wrong there: only a true visit makes it passable."""
    for layer in ("inflated", "blocked"):
        memory = parted(60)
        getattr(memory, layer)[memory.visited > 0] = 1
        chooser = Chooser(OPTIONS)
        assert choose(chooser, memory, HERE, 0.0) is None
        assert not chooser.enclosed


def test_a_past_separation_is_not_reported_for_the_next_search() -> None:
    chooser = Chooser(OPTIONS)
    choose(chooser, parted(60), HERE, 0.0)
    assert chooser.unreachable_at is not None
    assert choose(chooser, EvidenceMap(MODEL, OPTIONS, HERE), HERE, 0.0) is not None
    assert chooser.unreachable_at is None


class Enclosed:
    """Separated from its past, 70 cells of it to the left, by a line 50 cm away."""

    def __init__(self, layer: str) -> None:
        self.layer = layer

    def approach(self, context: RecoveryContext) -> Generator[Leg, Step]:
        """Find the line, and no wall."""
        memory = context.evidence_map
        row, column = (int(v) for v in memory.to_cells(0.0, 0.0)[::-1])
        memory.swept[:] = 1
        memory.visited[row, column - 110 : column - 40] = 1
        memory.include(*memory.to_metres(column - 110, row))  # as if driven there
        if self.layer == "blocked":
            memory.blocked[:, column - 25] = 1
        else:
            for y in range(memory.shape[0]):
                memory.add_point(*memory.to_metres(column - 25 + 0.5, y + 0.5))
        yield from ()

    def run(self) -> tuple[str, list[PlannerEvent]]:
        """Return why it ended, and its decisions."""
        planner = RecoveryPlanner(MODEL, behaviours=Behaviours(self.approach))
        end = planner.start(seen())
        assert isinstance(end, Finish)
        return end.reason, planner.drain_events()[:-1]


def test_evidence_of_bumps_alone_is_cleared_first() -> None:
    why, reported = Enclosed("blocked").run()
    assert [event.kind for event in reported] == ["start", "clear"]
    assert why == "no reachable unswept piece is worth its time"


def test_evidence_that_separates_the_robot_from_its_past_place_is_cleared() -> None:
    why, reported = Enclosed("wall").run()
    assert [event.kind for event in reported] == ["start", "clear"]
    assert reported[1].data["x_m"] == pytest.approx(-0.81, abs=0.03)
    assert reported[1].data["y_m"] == pytest.approx(0.0, abs=0.03)
    assert why == "no reachable unswept piece is worth its time"


def test_a_place_is_followed_once_on_a_side_until_there_is_new_floor() -> None:
    planner = AtDoor()

    def sought(*, left: bool = False, right: bool = False) -> bool:
        return "passage-sought" in planner.goes(left=left, right=right)[1]

    assert [sought(left=True) for _ in range(4)] == [False, True, False, False]
    assert sought(right=True)
    assert not sought(right=True)
    planner.stand(Pose2(0.3, 0.0, 0.0))  # another place
    assert [sought(left=True) for _ in range(3)] == [False, True, False]
    planner.stand(HERE)
    assert not sought(left=True)
    planner.map.new_cells += 249
    assert not sought(left=True)
    planner.map.new_cells += 1
    assert sought(left=True)


def test_a_target_is_rated_from_the_place_of_the_block() -> None:
    choice = Choice("lane", (BEYOND,), 0.0, 0.5, new_m2=0.06)
    for blocked_m, walked_m, blamed in ((0.0, 0.95, False), (0.9, 0.05, True)):
        planner = AtDoor()
        planner.stand(Pose2(blocked_m, 0.0, 0.0))
        for _ in range(2):
            planner.goes(left=True)
        planner.stand(Pose2(walked_m, 0.0, 0.0))
        assert planner.blames(choice) is blamed
        planner.goes(left=True, new_m2=0.02)  # blocked, without following
        planner.stand(Pose2(walked_m, 0.0, 0.0))
        assert planner.blames(choice) is not blamed
