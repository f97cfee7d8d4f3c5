"""The results of a simulated run, computed again from its log without the project's code.

The MCAP library reads the true poses with the schema in the file. The areas are exact polygons. The
robot's dimensions are typed in by hand.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
import shapely
from shapely.geometry import LineString, MultiPoint, Point, Polygon

from support.cli import Recorded, attachments, case_1, decoded, summary, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

    from shapely.geometry.base import BaseGeometry

pytestmark = pytest.mark.slow

RADIUS_M, HALF_MOUTH_M = 0.16, 0.08
HALF_A_POINT = 0.005

Pose = tuple[float, float, float, float]


class Figures(NamedTuple):
    """Results computed by this file."""

    body_free: float
    body_reachable: float
    mouth_free: float
    mouth_sweepable: float
    path_m: float
    free_m2: float
    mouth_m2: float


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return case_1(tmp_path_factory)


@pytest.fixture(scope="module")
def reported(recorded: Recorded) -> dict[str, Any]:
    return recorded.done.json


@pytest.fixture(scope="module")
def poses(recorded: Recorded) -> list[Pose]:
    return _poses(recorded)


def _poses(run: Recorded) -> list[Pose]:
    """Return time (s), x (m), y (m) and theta (rad) of the true poses."""
    found = []
    for plain, value in decoded(run.log, "/truth/pose"):
        position, turn = value.pose.position, value.pose.orientation
        theta = 2.0 * math.atan2(turn.z, turn.w)
        found.append((plain.log_ns / 1e9, position.x, position.y, theta))
    return found


class Areas(NamedTuple):
    """Areas of a room, from its room file."""

    free: BaseGeometry
    reachable: BaseGeometry
    sweepable: BaseGeometry


def _areas(run: Recorded) -> Areas:
    room = json.loads(attachments(run.log)["room.json"])
    free: BaseGeometry = Polygon(room["walls"])
    for obstacle in room["obstacles"]:
        free = free.difference(Polygon(obstacle))
    shapely.prepare(free)
    centres = free.buffer(-RADIUS_M, quad_segs=32)
    start = Point(room["start"][:2])
    pieces = centres.geoms if hasattr(centres, "geoms") else [centres]
    mine = next(piece for piece in pieces if piece.buffer(1e-6).contains(start))
    reachable = mine.buffer(RADIUS_M, quad_segs=32).intersection(free)
    return Areas(free, reachable, mine.buffer(HALF_MOUTH_M, quad_segs=32).intersection(free))


@pytest.fixture(scope="module")
def figures(recorded: Recorded, poses: list[Pose]) -> Figures:
    free, reachable, sweepable = _areas(recorded)
    path = LineString([(x, y) for _, x, y, _ in poses]).simplify(1e-4)
    body = path.buffer(RADIUS_M, quad_segs=32).intersection(free)
    strokes = _strokes(poses)
    mouth = shapely.union_all([area for _, area in strokes]).intersection(free)
    return Figures(
        body.area / free.area,
        body.intersection(reachable).area / reachable.area,
        mouth.area / free.area,
        mouth.intersection(sweepable).area / sweepable.area,
        sum(math.dist(a[1:3], b[1:3]) for a, b in pairwise(poses)),
        free.area,
        mouth.area,
    )


def _mouth(pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
    _, x, y, theta = pose
    dx, dy = -HALF_MOUTH_M * math.sin(theta), HALF_MOUTH_M * math.cos(theta)
    return (x + dx, y + dy), (x - dx, y - dy)


def _strokes(poses: list[Pose]) -> list[tuple[float, BaseGeometry]]:
    """Return the swept area: for each two consecutive poses, the hull of the mouth's two places."""
    strokes: list[tuple[float, BaseGeometry]] = []
    last = poses[0]
    for pose in poses[1:]:
        turned = abs(math.remainder(pose[3] - last[3], math.tau))
        if math.dist(pose[1:3], last[1:3]) < 0.01 and turned < 0.02:
            continue
        strokes.append((pose[0], MultiPoint([*_mouth(last), *_mouth(pose)]).convex_hull))
        last = pose
    return strokes


def _passed_s(
    strokes: list[tuple[float, BaseGeometry]], sweepable: BaseGeometry, share: float
) -> float:
    """Return the time at which a share of the area was swept, by bisection."""
    low, high = 0, len(strokes)
    while high - low > 1:
        middle = (low + high) // 2
        swept = shapely.union_all([area for _, area in strokes[:middle]]).intersection(sweepable)
        low, high = (low, middle) if swept.area >= share * sweepable.area else (middle, high)
    return strokes[high - 1][0]


@pytest.mark.parametrize("key", ["body_free", "body_reachable", "mouth_free", "mouth_sweepable"])
def test_coverage(figures: Figures, reported: dict[str, Any], key: str) -> None:
    assert reported["coverage"][key] == pytest.approx(getattr(figures, key), abs=HALF_A_POINT)


def test_path(figures: Figures, reported: dict[str, Any]) -> None:
    # the log continues until the robot is at rest
    assert reported["path_m"] == pytest.approx(figures.path_m, abs=0.02)


def test_time_to_nine_tenths(tmp_path: Path) -> None:
    """The paper's algorithm sweeps more than nine tenths of this room."""
    log = tmp_path / "run.mcap"
    done = sweepctl("simulate", "case-2", "--planner", "paper", "--json", "--out", log)
    run = Recorded(log, done)
    poses = _poses(run)
    begin_s = next(b[0] for a, b in pairwise(poses) if math.dist(a[1:3], b[1:3]) > 1e-5)
    passed_s = _passed_s(_strokes(poses), _areas(run).sweepable, 0.9)
    assert done.json["t90_s"] == pytest.approx(passed_s - begin_s, abs=10.0)


def test_repeat_ratio(figures: Figures, reported: dict[str, Any]) -> None:
    repeated = figures.path_m * 2 * HALF_MOUTH_M / figures.mouth_m2 - 1.0
    assert reported["repeat_ratio"] == pytest.approx(repeated, abs=0.01)


def test_equation_8(recorded: Recorded, figures: Figures, reported: dict[str, Any]) -> None:
    """The planner reports the lanes by its own odometry."""
    lanes = [
        json.loads(value.data_json)["distance_m"]
        for _, value in decoded(recorded.log, "/events")
        if value.source == "planner" and value.kind in {"lane", "recovery-lane"}
    ]
    share = sum(lanes) * 2 * HALF_MOUTH_M / figures.free_m2
    assert reported["coverage"]["eq8"] == pytest.approx(share, abs=HALF_A_POINT)


def test_duration(recorded: Recorded, reported: dict[str, Any]) -> None:
    phases = {
        value.text: plain.log_ns / 1e9
        for plain, value in decoded(recorded.log, "/events")
        if value.kind == "phase"
    }
    assert reported["duration_s"] == pytest.approx(
        phases["run is ending"] - phases["run is driving"], abs=0.03
    )


def test_pose_error(recorded: Recorded, poses: list[Pose], reported: dict[str, Any]) -> None:
    """Estimate and truth of the same time are compared, as far as the log's stamps allow."""
    truth = {round(t * 50): (x, y) for t, x, y, _ in poses}
    errors = []
    for plain, value in decoded(recorded.log, "/pose"):
        moment = round(plain.log_ns / 1e9 * 50)
        if moment in truth:
            position = value.pose.position
            errors.append(math.dist(truth[moment], (position.x, position.y)))
    # two control periods at cruise speed are 8 mm
    assert len(errors) > 5000
    assert max(errors) == pytest.approx(reported["pose_error_m"]["max"], abs=0.01)
    assert errors[-1] == pytest.approx(reported["pose_error_m"]["end"], abs=0.01)


def test_wire(recorded: Recorded, reported: dict[str, Any]) -> None:
    bytes_by = {"rx": 0, "tx": 0}
    for plain, value in decoded(recorded.log, "/raw/uart/rx", "/raw/uart/tx"):
        bytes_by[plain.topic[-2:]] += len(value.data)
    assert reported["wire"]["bytes"] == bytes_by


def test_the_papers_case(reported: dict[str, Any]) -> None:
    assert reported["outcome"] == "complete"
    assert 0.90 <= reported["coverage"]["body_free"] <= 0.97
    assert reported["pose_error_m"]["max"] < 0.08


@pytest.mark.nightly
def test_the_papers_case_by_three_seeds(reported: dict[str, Any]) -> None:
    runs = [reported, *(summary("case-1", "paper", seed) for seed in (2, 3))]
    assert [run["outcome"] for run in runs] == ["complete"] * 3
    for run in runs:
        assert 0.90 <= run["coverage"]["body_free"] <= 0.97
        assert run["pose_error_m"]["max"] < 0.08
    assert len({run["path_m"] for run in runs}) == 3, "seeds differ"


@pytest.mark.parametrize("room", ["case-2", pytest.param("studio-flat", marks=pytest.mark.nightly)])
def test_every_room_ends_by_itself(room: str) -> None:
    run = summary(room, "u-shape", 1)
    assert run["outcome"] == "complete"
    assert run["reason"]
    assert run["duration_s"] < 1200.0
    assert run["path_m"] > 1.0
