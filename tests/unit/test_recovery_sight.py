"""A known wall gone along where the heading is in doubt: what is kept of walls, and the runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.recovery.choice import Chooser
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.recovery.stretches import OFF_M, SIGHT_M, Start, Stretches
from bridge.coverage.room_generator import generate_room
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2
from bridge.motion.observation import HALT, Observation
from bridge.motion.robot_model import RobotModel
from support.fast_world import FastWorld

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.floorplan import FloorPlan

    Way = tuple[tuple[float, float], ...]

MODEL = RobotModel()
LEFT, RIGHT = 1, -1
QUARTER = 0.5 * math.pi


def follow(stretches: Stretches, side: int, *poses: tuple[float, float, float]) -> None:
    for pose in poses:
        stretches.follow(Pose2(*pose), side, straight=True)


def close(start: Start | None, x: float, y: float, heading: float, side: int) -> bool:
    return start is not None and start.side == side and start[:3] == pytest.approx((x, y, heading))


def test_a_stretch_is_begun_from_either_end_a_little_off_the_wall() -> None:
    stretches = Stretches()
    assert stretches.nearest(Pose2(0.0, 0.0, 0.0)) is None
    follow(stretches, LEFT, (1.0, 2.0, 0.0), (1.5, 2.0, 0.0), (2.0, 2.0, 0.0))
    stretches.end(Pose2(2.0, 2.0, 0.0), LEFT)
    # the wall is above: off it is below, whichever way it is gone along
    assert close(stretches.nearest(Pose2(0.0, 2.0, 0.0)), 1.0, 2.0 - OFF_M, 0.0, LEFT)
    assert close(stretches.nearest(Pose2(3.0, 2.0, 0.0)), 2.0, 2.0 - OFF_M, -math.pi, RIGHT)


def test_a_wall_on_the_right_is_kept_off_on_the_left() -> None:
    stretches = Stretches()
    follow(stretches, RIGHT, (0.0, 0.0, QUARTER))
    stretches.end(Pose2(0.0, 1.0, QUARTER), RIGHT)
    assert close(stretches.nearest(Pose2(0.0, 0.0, 0.0)), -OFF_M, 0.0, QUARTER, RIGHT)


def test_short_and_bent_ones_are_not_kept_and_a_corner_parts_two() -> None:
    stretches = Stretches()
    follow(stretches, LEFT, (0.0, 0.0, 0.0), (0.4, 0.0, 0.0))
    stretches.end(Pose2(0.4, 0.0, 0.0), LEFT)
    assert stretches.nearest(Pose2(0.0, 0.0, 0.0)) is None
    # round a column of 1 m: never straight on for half a metre
    for k in range(100):
        at = 0.1 * k
        stretches.follow(Pose2(math.cos(at), math.sin(at), at + QUARTER), LEFT, straight=True)
    assert stretches.nearest(Pose2(0.0, 0.0, 0.0)) is None
    stretches.end(Pose2(9.0, 9.0, 0.0), LEFT)
    stretches = Stretches()
    follow(stretches, LEFT, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    stretches.follow(Pose2(1.0, 0.1, 0.7), LEFT, straight=False)
    follow(stretches, LEFT, (1.0, 0.2, QUARTER), (1.0, 1.2, QUARTER))
    stretches.end(Pose2(1.0, 1.2, QUARTER), LEFT)
    corner = stretches.nearest(Pose2(1.2, 1.4, 0.0))
    assert close(corner, 1.0 + OFF_M, 1.2, -QUARTER, RIGHT)


def test_the_longest_are_kept_and_what_gave_nothing_is_dropped() -> None:
    stretches = Stretches()
    for k in range(60):
        follow(stretches, LEFT, (0.0, float(k), 0.0))
        stretches.end(Pose2(0.6 + 0.01 * k, float(k), 0.0), LEFT)
    far = stretches.nearest(Pose2(0.0, 0.0, 0.0))
    assert far is not None
    assert far.y_m == pytest.approx(60 - 24 - OFF_M), "the 24 longest"
    stretches.drop(far)
    after = stretches.nearest(Pose2(0.0, 0.0, 0.0))
    assert after is not None
    assert after.y_m == pytest.approx(60 - 23 - OFF_M), "neither of its ends is left"


def swept_lane(options: RecoveryOptions) -> EvidenceMap:
    """A lane of 2 m."""
    memory = EvidenceMap(MODEL, options, Pose2(0.0, 0.0, 0.0))
    for k in range(101):
        pose = Pose2(0.02 * k, 0.0, 0.0)
        memory.update(
            Observation(*(0.02 * k, pose, 0.2, 0.0, None, None, None, False, False, False))
        )
    return memory


def in_slices(search: Generator[None, None, Way | None]) -> tuple[Way | None, int]:
    """What a search found, and how often it paused."""
    pauses = 0
    while True:
        try:
            next(search)
        except StopIteration as stop:
            return stop.value, pauses
        pauses += 1


@pytest.mark.parametrize("slice_cells", [10**9, 300])
def test_the_way_to_a_point_is_found_in_slices_or_there_is_none(slice_cells: int) -> None:
    options = RecoveryOptions(slice_cells=slice_cells)
    chooser, memory, here = Chooser(options), swept_lane(options), Pose2(2.0, 0.0, 0.0)
    way, pauses = in_slices(chooser.way_to(memory, here, 0.0, 0.01))
    assert way is not None
    assert way[-1] == (0.0, 0.01), "the point itself"
    assert (pauses > 0) is (slice_cells < 10**6)
    nowhere, _ = in_slices(chooser.way_to(memory, here, -3.0, 0.0))
    assert nowhere is None, "nobody has been there"


class Doubting:
    """A robot in a room that doubts its heading more and more, until it went along a wall."""

    def __init__(self, plan: FloorPlan, *, cured: bool) -> None:
        self.planner = RecoveryPlanner(MODEL)
        self.sights: list[list[tuple[float, float, float]]] = []
        self.reasons: list[str] = []
        self.most_rad = 0.0
        runner = PlanRunner(self.planner, MODEL)
        world = FastWorld(plan, MODEL)
        obs = world.step(HALT)
        doubt_rad, sighting = 0.0, False
        while not runner.finished and world.time_s < 4000.0:
            obs = world.step(runner.step(obs._replace(heading_doubt_rad=doubt_rad)))
            now_sighting = self.planner.state.state == "sight"
            if now_sighting and not sighting:
                self.sights.append([])
            if now_sighting:
                self.sights[-1].append(world.poses[-1][1:])
            elif sighting and cured:
                doubt_rad = 0.0
            sighting = now_sighting
            doubt_rad += math.radians(0.01) * 0.02
            self.most_rad = max(self.most_rad, doubt_rad)
            self.reasons += [e.kind for e in runner.drain_events()]
        self.time_s, self.end = world.time_s, runner.finish_reason


def room() -> FloorPlan:
    return generate_room(31, np.random.default_rng(31), "box")


@pytest.fixture(scope="module")
def sure() -> float:
    runner, world = PlanRunner(RecoveryPlanner(MODEL), MODEL), FastWorld(room(), MODEL)
    obs = world.step(HALT)
    while not runner.finished:
        obs = world.step(runner.step(obs))
    assert "sight" not in {event.kind for event in runner.drain_events()}
    return world.time_s


def test_a_doubtful_robot_goes_along_a_wall_and_sweeps_on(sure: float) -> None:
    run = Doubting(room(), cured=True)
    assert run.end is not None
    assert run.end.startswith("no reachable")
    assert len(run.sights) >= 2
    assert run.most_rad < math.radians(1.4), "a doubt is not carried about for long"
    assert run.time_s < sure + 30.0 * len(run.sights)
    edges = [(a, b) for a, b in room().edges() if a != b]
    for sight in run.sights:
        assert math.dist(sight[0][:2], sight[-1][:2]) > 0.8 * SIGHT_M
        # the whole way beside one wall, and along it
        x, y, theta = sight[-1]
        (ax, ay), (bx, by) = min(edges, key=lambda edge: off_m(edge, x, y))
        assert abs(math.sin(math.atan2(by - ay, bx - ax) - theta)) < 0.05
        for at in sight:
            assert off_m(((ax, ay), (bx, by)), *at[:2]) < MODEL.radius_m + 3.0 * OFF_M


def test_a_doubt_that_no_wall_takes_does_not_hold_the_robot_up(sure: float) -> None:
    run = Doubting(room(), cured=False)
    assert run.end is not None
    assert run.end.startswith("no reachable")
    assert 2 <= len(run.sights) <= 24
    assert run.time_s < sure + 30.0 * len(run.sights)


def off_m(edge: tuple[tuple[float, float], tuple[float, float]], x: float, y: float) -> float:
    (ax, ay), (bx, by) = edge
    length2 = (bx - ax) ** 2 + (by - ay) ** 2
    t = min(max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length2, 0.0), 1.0)
    return math.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay))
