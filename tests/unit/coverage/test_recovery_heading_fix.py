"""Heading fix: a run along a known wall when the heading is uncertain, and the path there."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pytest

from bridge.coverage.planner import Step
from bridge.coverage.recovery.behaviours.heading_fix import HeadingFix
from bridge.coverage.recovery.behaviours.transit import transit
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import Behaviours, RecoveryPlanner
from bridge.coverage.recovery.search import Choice, Chooser
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, Leg, LegResult, StopReason
from bridge.motion.observation import HALT
from bridge.motion.robot_model import RobotModel
from support.fast_world import FastWorld
from support.observed import AT_REST
from support.recovery import context_at
from tools.rooms.generator import generate_room

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import PlannerEvent
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.wall_segments import Start
    from bridge.floor_plan.floor_plan import FloorPlan

    Found = TypeVar("Found")

pytestmark = pytest.mark.slow

MODEL = RobotModel()
LEFT = 1
OFF_M = RecoveryOptions().fix_off_m
QUARTER = 0.5 * math.pi


def swept_lane(options: RecoveryOptions) -> EvidenceMap:
    """Return the map after a lane of 2 m."""
    memory = EvidenceMap(MODEL, options, Pose2(0.0, 0.0, 0.0))
    for k in range(101):
        pose = Pose2(0.02 * k, 0.0, 0.0)
        memory.update(AT_REST._replace(time_s=0.02 * k, pose=pose, v_m_s=0.2))
    return memory


def in_slices(search: Generator[None, None, Found]) -> tuple[Found, int]:
    """Return the result of a search, and its number of pauses."""
    pauses = 0
    while True:
        try:
            next(search)
        except StopIteration as stop:
            return stop.value, pauses
        pauses += 1


@pytest.mark.parametrize("slice_cells", [10**9, 300])
def test_the_shortest_path_to_one_of_several_points_is_found_in_slices(slice_cells: int) -> None:
    options = RecoveryOptions(slice_cells=slice_cells)
    chooser, memory, here = Chooser(options), swept_lane(options), Pose2(2.0, 0.0, 0.0)
    points = [(-3.0, 0.0), (0.0, 0.01), (0.4, 0.0)]
    found, pauses = in_slices(chooser.path_to(memory, here, points))
    assert found is not None
    k, path = found
    assert k == 2
    assert path[-1] == points[2], "the point itself"
    assert (pauses > 0) is (slice_cells < 10**6)
    nowhere, _ = in_slices(chooser.path_to(memory, here, points[:1]))
    assert nowhere is None, "nobody has been there"


def test_a_point_that_the_map_has_shut_since_is_left_out_and_so_is_one_too_far() -> None:
    options = RecoveryOptions(search_lengths_m=(0.4, 1.2))
    chooser, memory, here = Chooser(options), swept_lane(options), Pose2(2.0, 0.0, 0.0)
    beside = [(1.6, 0.3), (1.2, 0.0), (0.2, 0.0)]
    assert in_slices(chooser.path_to(memory, here, beside[:1]))[0] is not None
    memory.block(1.6, 0.3, 0.08)
    assert in_slices(chooser.path_to(memory, here, beside[:1]))[0] is None
    found, _ = in_slices(chooser.path_to(memory, here, beside))
    assert found is not None
    assert found[0] == 1
    memory = swept_lane(options)
    assert in_slices(chooser.path_to(memory, here, [(0.2, 0.0)]))[0] is None
    found, _ = in_slices(chooser.path_to(memory, here, [(0.2, 0.0), (1.2, 0.0)]))
    assert found is not None
    assert found[0] == 1


class CountedFix(HeadingFix):
    """Records whether each run along a wall took place."""

    def __init__(self, *, blocked: bool) -> None:
        """Set whether a person blocks the path to every wall."""
        super().__init__()
        self.blocked = blocked
        self.driven: list[bool] = []

    def drive_along(
        self, context: RecoveryContext, start: Start, path: tuple[tuple[float, float], ...]
    ) -> Generator[Leg, Step, float | None]:
        begun_rad = None
        if not self.blocked:
            begun_rad = yield from super().drive_along(context, start, path)
        self.driven.append(begun_rad is not None)
        return begun_rad


def followed(*poses: tuple[float, float], yaw_rate_rad_s: float = 0.0) -> RecoveryContext:
    """Return a plan that followed a wall on the left through places on a line, 1 cm at a time."""
    begun = Pose2(*poses[0], 0.0)
    context = context_at(AT_REST._replace(pose=begun, v_m_s=0.2))
    context.monitor.wall.side = LEFT
    time_s = 0.0
    for (x0, y0), (x1, y1) in pairwise(poses):
        steps = max(round(math.dist((x0, y0), (x1, y1)) / 0.01), 1) if y0 == y1 else 1
        for k in range(steps + 1):
            time_s += 0.05
            at = Pose2(x0 + k / steps * (x1 - x0), y0 + k / steps * (y1 - y0), 0.0)
            rate = yaw_rate_rad_s if abs(at.x_m - 0.6) < 0.02 else 0.0
            seen = AT_REST._replace(time_s=time_s, pose=at, v_m_s=0.2, yaw_rate_rad_s=rate)
            context.monitor.observe(seen._replace(ultrasonic_m=0.9, infrared_left_m=0.1))
    context.monitor.end_segment()
    return context


def test_a_pose_set_right_parts_a_stretch() -> None:
    forth, _ = followed((0.0, 0.0), (0.3, 0.0), (0.3, 0.03), (1.2, 0.03)).wall_segments.starts()
    assert forth.heading_rad == pytest.approx(0.0, abs=1e-6)
    assert forth.x_m == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize(("rate", "kept"), [(0.0, 1), (0.45, 1), (0.54, 2), (0.9, 2)])
def test_a_corner_gone_round_parts_a_stretch_and_a_wriggle_does_not(rate: float, kept: int) -> None:
    context = followed((0.0, 0.0), (1.2, 0.0), yaw_rate_rad_s=rate)
    assert len(context.wall_segments.starts()) == 2 * kept


@pytest.mark.parametrize(
    ("reason", "short_m", "there"),
    [
        (StopReason.RANGE, 0.02, True),
        (StopReason.RANGE, 0.10, True),
        (StopReason.STALLED, 0.10, True),
        (StopReason.CLIFF, 0.10, False),
        (StopReason.TIMEOUT, 0.10, False),
        (StopReason.RANGE, 0.30, False),
    ],
)
def test_a_contact_near_the_start_of_a_wall_is_that_wall(
    reason: StopReason, short_m: float, *, there: bool
) -> None:
    context = followed((0.0, 0.0), (1.2, 0.0))
    path = transit(context, Choice("heading-fix", ((2.2, 0.0),), QUARTER, 0.48))
    leg = next(path)
    assert isinstance(leg, Drive)
    pose = Pose2(2.2 - short_m, 0.0, 0.0)
    obs = AT_REST._replace(time_s=9.0, pose=pose, ultrasonic_m=0.04)
    context.monitor.observe(obs)
    result = LegResult(leg, reason, 1.0 - short_m, 5.0, pose)
    arrived = None
    try:
        leg = path.send(Step(result, obs))
        for _ in range(2 if reason is StopReason.CLIFF else 1):
            assert leg.purpose == "back-off"
            leg = path.send(Step(LegResult(leg, StopReason.DISTANCE, -0.015, 1.0, pose), obs))
    except StopIteration as ended:
        arrived = ended.value
    assert arrived is there


class Uncertain:
    """A robot whose heading uncertainty grows until it runs along a wall."""

    def __init__(  # noqa: PLR0913 - the errors of a robot
        self,
        plan: FloorPlan,
        *,
        cured_from: int = 0,
        cured_deg: float = 0.0,
        way_leaves_deg: float = math.inf,
        off_m: tuple[float, float] = (0.0, 0.0),
        deg_s: float = 0.01,
        max_time_s: float = 4000.0,
        apart_s: float = 20.0,
        blocked: bool = False,
    ) -> None:
        """Run to the end.

        ``cured_from``: number of the first run along a wall that reduces the uncertainty to
        ``cured_deg``, a tenth of a second after its end. ``way_leaves_deg``: maximum uncertainty
        after the path there. ``off_m``: error of the robot's own place. ``deg_s``: initial growth
        of the uncertainty.
        """
        self.fix = CountedFix(blocked=blocked)
        options = RecoveryOptions(heading_fix_apart_s=apart_s)
        self.planner = RecoveryPlanner(MODEL, options, Behaviours(heading_fix=lambda: self.fix))
        self.measurements: list[list[tuple[float, float, float]]] = []
        self.reported: list[tuple[float, PlannerEvent]] = []
        self.max_rad, self.max_starts = 0.0, 0
        self.waits_s: list[float] = []
        runner = PlanRunner(self.planner, MODEL)
        world = FastWorld(plan, MODEL)
        obs = world.step(HALT)
        uncertainty_rad, was, stood_s = 0.0, "", 0.0
        while not runner.finished and world.time_s < max_time_s:
            share = min(max(world.time_s - 80.0, 0.0) / 60.0, 1.0)  # its perimeters were right
            off_x, off_y = (share * o for o in off_m)
            pose = Pose2(obs.pose.x_m + off_x, obs.pose.y_m + off_y, obs.pose.theta_rad)
            obs = world.step(
                runner.step(obs._replace(heading_sigma_rad=uncertainty_rad, pose=pose))
            )
            uncertainty_rad += math.radians(deg_s) * 0.02
            state = self.planner.state.state
            if state == "heading-fix" and was != "heading-fix":
                self.measurements.append([])
            if state == "heading-fix":
                measurement = self.measurements[-1]
                measurement.append(world.poses[-1][1:])
                stood_s = stood_s + 0.02 if obs.v_m_s < 0.01 else 0.0
                whole = math.dist(measurement[0][:2], measurement[-1][:2]) > 0.4  # )
                if whole and stood_s > 0.1 and len(self.measurements) > cured_from:
                    uncertainty_rad = min(uncertainty_rad, math.radians(cured_deg))
            if state == "transit" and self.times("heading-fix"):
                uncertainty_rad = min(uncertainty_rad, math.radians(way_leaves_deg))
            if was == "heading-fix" != state:
                self.waits_s.append(self.fix.due_s - world.time_s)
            was = state
            self.max_rad = max(self.max_rad, uncertainty_rad)
            self.max_starts = max(self.max_starts, self.starts)
            self.reported += [(world.time_s, event) for event in runner.drain_events()]
        self.time_s, self.end = world.time_s, runner.finish_reason

    @property
    def starts(self) -> int:
        """Return the places where a run along a wall could begin."""
        return len(self.planner.context.wall_segments.starts())

    def times(self, kind: str) -> list[float]:
        return [time_s for time_s, event in self.reported if event.kind == kind]


def room() -> FloorPlan:
    return generate_room(32, np.random.default_rng(32), "box")


@pytest.fixture(scope="module")
def sure() -> float:
    runner, world = PlanRunner(RecoveryPlanner(MODEL), MODEL), FastWorld(room(), MODEL)
    obs = world.step(HALT)
    while not runner.finished:
        obs = world.step(runner.step(obs))
    assert "heading-fix" not in {event.kind for event in runner.drain_events()}
    return world.time_s


@pytest.mark.parametrize(
    "off_m", [(0.0, 0.0), (0.0, 0.04), (-0.06, -0.06), (0.06, 0.06), (0.07, -0.05)]
)
def test_an_uncertain_robot_follows_a_wall_and_sweeps_on(
    sure: float, off_m: tuple[float, float]
) -> None:
    run = Uncertain(room(), off_m=off_m)
    assert run.end is not None
    assert run.end.startswith("no reachable")
    assert len(run.fix.driven) == len(run.times("heading-fix"))
    assert len(run.measurements) == sum(run.fix.driven) >= 2
    assert all(run.fix.driven), "no way to a wall ends too far from it"
    assert run.max_rad < math.radians(1.6), "a doubt is not carried about for long"
    assert run.time_s < sure + 30.0 * len(run.measurements) + 500.0 * max(map(abs, off_m))
    edges = [(a, b) for a, b in room().edges() if a != b]
    for measurement in run.measurements:
        assert math.dist(measurement[0][:2], measurement[-1][:2]) > 0.4
        # the whole way beside one wall, and along it
        theta = measurement[-1][2]
        (ax, ay), (bx, by) = min(edges, key=lambda edge: _farthest_m(edge, measurement))
        assert abs(math.sin(math.atan2(by - ay, bx - ax) - theta)) < 0.06
        for at in measurement:
            off = off_wall_m(((ax, ay), (bx, by)), *at[:2])
            assert (
                MODEL.radius_m - 1e-3 < off < MODEL.radius_m + OFF_M + max(map(abs, off_m)) + 0.03
            )


def test_uncertainty_that_no_wall_reduces_does_not_delay_the_robot(sure: float) -> None:
    run = Uncertain(room(), cured_from=99)
    assert run.end is not None
    assert run.end.startswith("no reachable")
    begun = run.times("heading-fix")
    assert 2 <= len(begun) <= 8
    assert all(b - a > 20.0 * 2 ** (k + 1) for k, (a, b) in enumerate(pairwise(begun)))
    assert run.time_s < sure + 30.0 * len(begun)


def test_a_wall_that_was_fruitless_twice_is_not_visited_again() -> None:
    run = Uncertain(room(), cured_from=99, deg_s=0.1, apart_s=0.01)
    assert len(run.measurements) >= 6
    assert run.starts < run.max_starts
    assert run.end is not None


@pytest.mark.parametrize(
    ("way_leaves_deg", "cured_deg", "credited"),
    [
        (0.7, math.inf, False),  # the path's information is not the wall's
        (2.0, 1.8, False),
        (2.0, 1.2, True),
        (0.65, 0.55, True),  # a small part of a small uncertainty, and enough
    ],
)
def test_a_wall_is_credited_with_its_own_run(
    way_leaves_deg: float, cured_deg: float, *, credited: bool
) -> None:
    run = Uncertain(
        room(), cured_deg=cured_deg, way_leaves_deg=way_leaves_deg, deg_s=0.08, max_time_s=400.0
    )
    assert len(run.measurements) >= 4
    assert (run.starts == run.max_starts) is credited


def test_a_blocked_path_does_not_count_against_the_wall() -> None:
    run = Uncertain(room(), deg_s=0.1, max_time_s=200.0, apart_s=0.01, blocked=True)
    assert len(run.times("heading-fix")) >= 6
    assert run.measurements == []
    assert run.starts == run.max_starts > 0


def test_after_one_that_helped_the_next_is_due_as_soon_as_ever() -> None:
    run = Uncertain(room(), cured_from=1, deg_s=0.08, max_time_s=290.0)
    assert run.waits_s[0] == pytest.approx(40.0, abs=0.5), "the first gave nothing"
    assert run.waits_s[1:] == pytest.approx([20.0] * (len(run.waits_s) - 1), abs=0.5)
    assert abs(len(run.waits_s) - len(run.measurements)) <= 1, "the run may end in either"
    first, second = run.times("heading-fix")[:2]
    assert second - first > 40.0
    assert len(run.measurements) > 2


@pytest.mark.parametrize(("left_deg", "enough"), [(0.0, True), (0.59, True), (0.61, False)])
def test_a_path_that_gives_the_heading_is_enough(left_deg: float, *, enough: bool) -> None:
    """A path that ends with at most three quarters of the threshold makes the fix needless."""
    run = Uncertain(room(), way_leaves_deg=left_deg, deg_s=0.03, max_time_s=190.0)
    uncertainties = [
        float(event.data["uncertainty_deg"])
        for _, event in run.reported
        if event.kind == "heading-fix"
    ]
    assert len(uncertainties) >= 1
    assert max(uncertainties) > 1.5, "of which 0.61 is less than half"
    assert len(run.measurements) == (0 if enough else len(uncertainties))


def test_a_robot_that_has_swept_all_does_not_ask_for_its_heading() -> None:
    kinds = [event.kind for _, event in Uncertain(room()).reported]
    last = max(k for k, kind in enumerate(kinds) if kind == "heading-fix")
    assert {"lane", "perimeter"} & set(kinds[last:])


def off_wall_m(edge: tuple[tuple[float, float], tuple[float, float]], x: float, y: float) -> float:
    (ax, ay), (bx, by) = edge
    length2 = (bx - ax) ** 2 + (by - ay) ** 2
    t = min(max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length2, 0.0), 1.0)
    return math.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay))


def _farthest_m(
    edge: tuple[tuple[float, float], tuple[float, float]],
    measurement: list[tuple[float, float, float]],
) -> float:
    """Return the largest distance of a measurement's poses from a wall, m."""
    return max(off_wall_m(edge, x, y) for x, y, _ in measurement)
