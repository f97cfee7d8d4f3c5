"""The coverage metrics, compared with closed forms and with exact geometry of a library."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union

from bridge.evaluation.metrics import CoverageMeter
from bridge.evaluation.raster import Raster
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from bridge.floor_plan.floor_plan import Polygon as Corners

MODEL = RobotModel()
Track = list[tuple[float, float, float, float]]


def box(x0: float, y0: float, x1: float, y1: float) -> Corners:
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


CASE_1 = FloorPlan(
    "case-1",
    box(0, 0, 2.06, 2.057),
    (box(0.66, 0.78, 1.46, 1.28),),
    Pose2(0.18, 0.18, 0.0),
)
HALL = FloorPlan("hall", box(0, 0, 3, 2), (), Pose2(1.5, 1.0, 0.0))


def straight(x0: float, y0: float, x1: float, y1: float, t0: float = 0.0) -> Track:
    """Return the poses of a lane at 0.2 m/s, sampled at 50 Hz."""
    length = math.hypot(x1 - x0, y1 - y0)
    count = max(round(length / 0.004), 1)
    heading = math.atan2(y1 - y0, x1 - x0)
    return [
        (t0 + 0.02 * k, x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count, heading)
        for k in range(count + 1)
    ]


def spin(x: float, y: float, angle: float, t0: float = 0.0) -> Track:
    count = max(round(abs(angle) / 0.03), 1)
    return [(t0 + 0.02 * k, x, y, angle * k / count) for k in range(count + 1)]


def exact_floor(plan: FloorPlan) -> BaseGeometry:
    return Polygon(plan.walls).difference(unary_union([Polygon(o) for o in plan.obstacles]))


def exact_centres(plan: FloorPlan) -> BaseGeometry:
    inner = exact_floor(plan).buffer(-MODEL.radius_m, quad_segs=90)
    parts: list[BaseGeometry] = list(getattr(inner, "geoms", [inner]))
    start = Point(plan.start.x_m, plan.start.y_m)
    return min(parts, key=lambda part: part.distance(start))


def test_areas_of_case_1() -> None:
    meter = CoverageMeter(CASE_1, MODEL)
    assert meter.free_m2 == pytest.approx(2.06 * 2.057 - 0.4, rel=1e-4)
    # The disc cannot reach the four corners of the room; each corner has (1 - π/4) R².
    corners = 4 * (1 - math.pi / 4) * 0.16**2
    assert meter.reachable_m2 == pytest.approx(2.06 * 2.057 - 0.4 - corners, rel=3e-4)
    # This is the share of the floor that a mouth on the axle can reach.
    assert meter.sweepable_m2 / meter.free_m2 == pytest.approx(0.774, abs=0.0005)


@pytest.mark.parametrize("offset", [0.0, 0.08, 0.13])
def test_areas_against_exact_geometry(offset: float) -> None:
    angle = affinity.rotate(Polygon(box(0.9, 0.8, 1.6, 1.2)), 25)
    corners = tuple((x, y) for x, y, *_ in angle.exterior.coords)[:-1]
    plan = replace(HALL, obstacles=(corners,), start=Pose2(0.3, 0.3, 0))
    model = replace(MODEL, mouth_offset_m=offset)
    meter = CoverageMeter(plan, model)
    floor, centres = exact_floor(plan), exact_centres(plan)
    reach = math.hypot(offset, 0.08)
    reachable = centres.buffer(0.16, quad_segs=90).intersection(floor).area
    sweepable = centres.buffer(reach, quad_segs=90).intersection(floor).area
    assert meter.free_m2 == pytest.approx(floor.area, rel=2e-4)
    assert meter.reachable_m2 == pytest.approx(reachable, rel=3e-4)
    assert meter.sweepable_m2 == pytest.approx(sweepable, rel=3e-4)


@pytest.mark.parametrize(("gap", "open_"), [(0.316, False), (0.322, True), (0.40, True)])
def test_a_door_is_passable_from_the_body_s_width_on(gap: float, *, open_: bool) -> None:
    wall = (box(1.45, 0.0, 1.55, 1.0 - gap / 2), box(1.45, 1.0 + gap / 2, 1.55, 2.0))
    plan = replace(HALL, obstacles=wall, start=Pose2(0.5, 1.0, 0.0))
    meter = CoverageMeter(plan, MODEL)
    half = 1.45 * 2.0 - 4 * (1 - math.pi / 4) * 0.16**2
    if open_:
        assert meter.reachable_m2 > 1.95 * half
    else:
        assert meter.reachable_m2 < 1.05 * half


def test_a_straight_run() -> None:
    report = CoverageMeter(HALL, MODEL).measure(straight(0.5, 1.0, 2.5, 1.0), lane_length_m=2.0)
    free = 6.0
    assert report.coverage.mouth_free * free == pytest.approx(2.0 * 0.16, rel=2e-3)
    capsule = 2.0 * 0.32 + math.pi * 0.16**2
    assert report.coverage.body_free * free == pytest.approx(capsule, rel=1e-3)
    assert report.coverage.eq8 == pytest.approx(2.0 * 0.16 / 6.0, rel=1e-3)
    assert report.path_m == pytest.approx(2.0)
    assert report.repeat_ratio == pytest.approx(0.0, abs=3e-3)
    assert report.duration_s == pytest.approx(10.0)


@pytest.mark.parametrize("shift", [0.0, 0.00125, 0.0025, 0.004])
def test_a_lane_has_its_width_wherever_it_lies_on_the_grid(shift: float) -> None:
    """A metric that counts cell centres would change the width in jumps of 3 %."""
    report = CoverageMeter(HALL, MODEL).measure(straight(0.5, 1.0 + shift, 2.5, 1.0 + shift))
    assert report.coverage.mouth_free * 6.0 == pytest.approx(0.32, rel=3e-3)


@pytest.mark.parametrize(("offset", "turn"), [(0.0, math.pi), (0.0, math.tau), (0.1, math.tau)])
def test_turning_in_place_sweeps_a_disc_or_a_ring(offset: float, turn: float) -> None:
    model = replace(MODEL, mouth_offset_m=offset)
    report = CoverageMeter(HALL, model).measure(spin(1.5, 1.0, turn))
    outer = math.hypot(offset, 0.08)
    assert report.coverage.mouth_free * 6.0 == pytest.approx(
        math.pi * (outer**2 - offset**2), rel=6e-3
    )
    assert report.coverage.body_free * 6.0 == pytest.approx(math.pi * 0.16**2, rel=2e-3)
    assert report.path_m == 0.0
    assert report.repeat_ratio == pytest.approx(-1.0)


def test_ideal_lanes_sweep_all_that_is_sweepable() -> None:
    track: Track = []
    for k in range(12):
        y = min(0.16 + 0.16 * k, 2.0 - 0.16)
        ends = (0.16, 2.84) if k % 2 == 0 else (2.84, 0.16)
        t0 = track[-1][0] + 1.0 if track else 0.0
        track += straight(ends[0], y, ends[1], y, t0)
        track += [(track[-1][0] + 1.0, ends[1], y, math.pi / 2)]
    report = CoverageMeter(HALL, MODEL).measure(track)
    # the rest is quarter discs at the lanes' ends, of which turning sweeps a part
    assert report.coverage.mouth_sweepable > 0.93
    assert report.coverage.body_reachable > 0.985
    assert report.t90_s is not None
    assert 0.8 * report.duration_s < report.t90_s < report.duration_s
    assert report.path_ratio == pytest.approx(report.path_m * 0.16 / report.sweepable_m2)


def test_sweeping_twice_is_a_repeat_of_one() -> None:
    track = straight(0.5, 1.0, 2.5, 1.0)
    track += straight(2.5, 1.0, 0.5, 1.0, track[-1][0] + 1.0)
    report = CoverageMeter(HALL, MODEL).measure(track)
    assert report.repeat_ratio == pytest.approx(1.0, abs=0.03)


def test_times_are_those_of_the_first_pass() -> None:
    meter = CoverageMeter(HALL, MODEL)
    track = straight(0.5, 1.0, 2.5, 1.0, 100.0)
    track += straight(2.5, 1.0, 0.5, 1.0, track[-1][0] + 1.0)
    report = meter.measure(track)
    row, _, column, _ = meter.regions.raster.window(1.5, 1.0, 1.5, 1.0)
    assert report.first_swept_s[row, column] == pytest.approx(5.0, abs=0.3)
    shares = meter.share_at(report, [-1.0, 5.0, 10.0, 1e9])
    assert shares[0] == 0.0
    assert shares[1] == pytest.approx(0.5 * shares[2], rel=0.06)
    assert shares[3] == report.coverage.mouth_sweepable
    assert report.t90_s is None


def test_largest_hole_and_its_inradius() -> None:
    track: Track = []
    for y in [*(0.16 + 0.1 * k for k in range(7)), *(1.24 + 0.1 * k for k in range(7))]:
        track += straight(0.1, y, 2.9, y, 20.0 * len(track))
    # lanes end at y = 0.76 + 0.08 and begin again at 1.24 - 0.08; the jump between is not swept
    report = CoverageMeter(HALL, MODEL).measure(track)
    assert report.hole_inradius_m == pytest.approx(0.16, abs=0.004)
    # with the 2 cm on both sides at the lanes' ends, which are connected with it
    area = 0.32 * 2.84 + 2 * 0.02 * (1.84 - 0.32)
    assert report.largest_hole_cm2 == pytest.approx(area * 1e4, rel=0.01)
    assert report.path_m == pytest.approx(14 * 2.8, rel=1e-3)


def test_everything_swept_leaves_no_hole() -> None:
    plan = FloorPlan("cell", box(0, 0, 0.33, 0.33), (), Pose2(0.165, 0.165, 0.0))
    model = replace(MODEL, cleaning_width_m=0.30)
    report = CoverageMeter(plan, model).measure(
        spin(0.165, 0.165, math.pi) + straight(0.16, 0.165, 0.17, 0.165, 10.0)
    )
    assert report.coverage.mouth_sweepable > 0.9
    assert report.hole_inradius_m < 0.01


def test_no_poses_and_one_pose() -> None:
    meter = CoverageMeter(HALL, MODEL)
    nothing = meter.measure([])
    assert nothing.coverage.mouth_sweepable == nothing.coverage.body_free == 0.0
    assert nothing.coverage.eq8 is None
    assert nothing.repeat_ratio is None
    assert nothing.t90_s is None
    one = meter.measure([(5.0, 1.5, 1.0, 0.0)])
    assert one.coverage.mouth_free == 0.0
    assert one.coverage.body_free * 6.0 == pytest.approx(math.pi * 0.16**2, rel=2e-3)


def test_figures_of_a_wandering_run_against_exact_geometry() -> None:
    rng = random.Random(7)
    x, y, heading, track = 0.4, 0.4, 0.2, []
    for k in range(3000):
        turn = rng.gauss(0, 0.06)
        nx, ny = x + 0.004 * math.cos(heading), y + 0.004 * math.sin(heading)
        if 0.17 < nx < 1.89 and 0.17 < ny < 1.88:
            x, y = nx, ny
        else:
            turn += 0.1
        heading += turn
        track.append((0.02 * k, x, y, heading))
    report = CoverageMeter(CASE_1, MODEL).measure(track)
    floor = exact_floor(CASE_1)
    body = LineString([p[1:3] for p in track]).buffer(0.16, quad_segs=45).intersection(floor)
    assert report.coverage.body_free == pytest.approx(body.area / floor.area, abs=3e-4)
    bars = []
    for _, px, py, th in track:
        c, s = 0.08 * math.cos(th), 0.08 * math.sin(th)
        bars.append(((px - s, py + c), (px + s, py - c)))
    quads = [shapely.MultiPoint([*a, *b]).convex_hull for a, b in itertools.pairwise(bars)]
    # a hull is the swept quadrilateral without the sliver of a bar that turns about itself
    mouth = unary_union(quads).intersection(floor)
    assert report.coverage.mouth_free == pytest.approx(mouth.area / floor.area, abs=6e-4)


def test_scattered_points_measure_better_than_centres() -> None:
    raster = Raster((0.0, 0.0, 2.0, 2.0), 0.01)
    centred = Raster((0.0, 0.0, 2.0, 2.0), 0.01)
    rows, columns = np.indices(centred.shape, dtype=np.float64)
    centred.x, centred.y = 0.01 * (columns + 0.5), 0.01 * (rows + 0.5)
    corners = box(0.2051, 0.2051, 1.7951, 1.7951)
    area = 1.59**2
    assert raster.area_m2(raster.polygon(corners)) == pytest.approx(area, rel=2e-4)
    assert abs(centred.area_m2(centred.polygon(box(0.2049, 0.2049, 1.7951, 1.7951))) - area) > 0.01


def test_a_mouth_ahead_of_the_axle_reaches_more_by_turning_than_in_passing() -> None:
    side = 2.0
    plan = FloorPlan("s", ((0, 0), (side, 0), (side, side), (0, side)), (), Pose2(0.5, 1.0, 0.0))
    ahead = CoverageMeter(plan, replace(RobotModel(), mouth_offset_m=0.1), 0.01).regions
    on_axle = CoverageMeter(plan, RobotModel(), 0.01).regions
    assert (ahead.passing == on_axle.sweepable).all()
    assert (on_axle.passing == on_axle.sweepable).all()
    assert ahead.sweepable.sum() > 1.05 * ahead.passing.sum()
