"""Coordinates of flat surfaces, and the position errors that surfaces seen again tell."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.motion.wall_position import (
    HITS,
    MAX_REFERENCES,
    PositionFix,
    SurfaceTracker,
    WallPosition,
)

MODEL = RobotModel()
FRONT, LEFT, RIGHT = MODEL.ultrasonic, MODEL.infrared_left, MODEL.infrared_right
SURE = (0.0, 0.0, 0.0)
DOUBT = (0.03**2, 0.0, 0.03**2)
DEGREE = math.radians(1.0)
Tracked = tuple[int, float, float]


def sights(readings: list[tuple[Pose2, float | None]], grid_rad: float = 0.0) -> list[Tracked]:
    tracker = SurfaceTracker(FRONT)
    found = [tracker.add(pose, range_m, grid_rad) for pose, range_m in readings]
    return [sight for sight in found if sight is not None]


def approach(wall_m: float, count: int) -> list[tuple[Pose2, float | None]]:
    """Driving at a wall ahead."""
    return [(Pose2(0.01 * i, 0, 0), wall_m - 0.01 * i - FRONT.x_m) for i in range(count)]


# ---- one sight -------------------------------------------------------------------------


def test_a_sight_is_the_coordinate_of_the_wall() -> None:
    (sight,) = sights(approach(1.0, HITS))
    assert sight[:2] == (0, 0.0)
    assert sight[2] == pytest.approx(1.0)
    assert len(sights(approach(1.0, 3 * HITS))) == 3
    assert sights(approach(1.0, HITS - 1)) == []


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_each_direction_has_its_own_coordinate(quarter: int) -> None:
    heading = quarter * math.pi / 2
    (sight,) = sights([(Pose2(0.3, -0.2, heading), 0.5)] * HITS)
    position = 0.3 * math.cos(heading) - 0.2 * math.sin(heading)
    assert sight[0] == quarter
    assert sight[2] == pytest.approx(position + FRONT.x_m + 0.5)


def test_the_grid_may_be_askew() -> None:
    grid = 0.4
    readings: list[tuple[Pose2, float | None]] = [(Pose2(0.0, 0.0, grid), 0.5)] * HITS
    (sight,) = sights(readings, grid)
    assert sight[1] == pytest.approx(grid)
    assert sights(readings, 0.0) == [], "not square to this one"


def test_only_square_looks_count() -> None:
    for degrees, count in ((0.0, 1), (2.9, 1), (-2.9, 1), (3.1, 0), (45.0, 0)):
        readings: list[tuple[Pose2, float | None]]
        readings = [(Pose2(0, 0, degrees * DEGREE), 0.5)] * HITS
        assert len(sights(readings)) == count


def test_nothing_seen_begins_anew() -> None:
    first, rest = approach(1.0, HITS - 1), approach(1.0, HITS - 1)
    assert sights([*first, (Pose2(0, 0, 0), None), *rest]) == []


def test_an_edge_is_no_surface() -> None:
    """Readings that jump are never averaged to a surface between the two."""
    near, far = approach(1.0, 4), approach(1.3, HITS)
    assert [sight[2] for sight in sights([*near, *far])] == [pytest.approx(1.3)]
    slanting: list[tuple[Pose2, float | None]] = [
        (Pose2(0, 0, 0), 0.5 + 0.005 * i) for i in range(40)
    ]
    assert sights(slanting) == []


def test_turning_to_another_wall_begins_anew() -> None:
    readings = approach(1.0, HITS - 1)
    readings += [(Pose2(0, 0, math.pi / 2), 1.0 - FRONT.x_m)] * (HITS - 1)
    assert sights(readings) == []


# ---- surfaces seen again ---------------------------------------------------------------


class Room:
    """Looks at surfaces straight ahead and at both sides."""

    def __init__(self) -> None:
        self.walls = WallPosition((FRONT, LEFT, RIGHT))

    def look(
        self,
        pose: Pose2,
        front_m: float | None = None,
        left_m: float | None = None,
        right_m: float | None = None,
        covariance: tuple[float, float, float] = DOUBT,
    ) -> list[PositionFix]:
        ranges = (front_m, left_m, right_m)
        return [
            fix for _ in range(HITS) for fix in self.walls.update(pose, 0.0, ranges, covariance)
        ]


def test_the_first_sight_is_the_reference() -> None:
    room = Room()
    assert room.look(Pose2(0, 0, 0), 0.5, 0.1, 0.2, SURE) == []
    again = room.look(Pose2(0, 0, 0), 0.5, 0.1, 0.2, SURE)
    assert [fix.error_m for fix in again] == [pytest.approx(0.0)] * 3


@pytest.mark.parametrize("error_m", [-0.04, -0.01, 0.01, 0.04])
def test_drift_is_told_along_each_direction(error_m: float) -> None:
    room = Room()
    room.look(Pose2(0, 0, 0), 0.5, 0.1, 0.2, SURE)
    fixes = room.look(Pose2(error_m, 0, 0), 0.5, None, None)
    assert [tuple(fix)[:2] for fix in fixes] == [(1.0, 0.0)]
    assert fixes[0].error_m == pytest.approx(error_m)
    left, right = room.look(Pose2(0, error_m, 0), None, 0.1, 0.2)
    assert left.direction_y == pytest.approx(1.0)
    assert left.error_m == pytest.approx(error_m)
    assert right.direction_y == pytest.approx(-1.0)
    assert right.error_m == pytest.approx(-error_m)


def test_the_gate() -> None:
    room = Room()
    room.look(Pose2(0, 0, 0), 0.5, covariance=SURE)
    assert room.look(Pose2(0.03, 0, 0), 0.5, covariance=SURE) == [], "it cannot have drifted so"
    assert room.look(Pose2(0.06, 0, 0), 0.5, covariance=DOUBT) == [], "too far for one seen again"
    assert len(room.look(Pose2(0.03, 0, 0), 0.5, covariance=DOUBT)) == 1


def test_what_is_near_but_not_the_same_is_passed_over() -> None:
    room = Room()
    room.look(Pose2(0, 0, 0), 0.5, covariance=SURE)
    assert room.look(Pose2(0, 0, 0), 0.58) == []
    assert room.look(Pose2(0, 0, 0), 0.58) == [], "and is no reference afterwards"
    assert room.look(Pose2(0, 0, 0), 0.75) == []
    assert len(room.look(Pose2(0, 0, 0), 0.75)) == 1, "this one is"


def test_opposite_walls_at_one_coordinate_are_two() -> None:
    room = Room()
    room.look(Pose2(0, 0, 0), 0.5, covariance=SURE)
    # looking back from beyond, at the other face of a thin screen
    x = 0.5 + FRONT.x_m + 0.5 + FRONT.x_m
    assert room.look(Pose2(x, 0, -math.pi), 0.5) == []


def test_a_surface_does_not_follow_slow_drift() -> None:
    room = Room()
    room.look(Pose2(0, 0, 0), 0.5, covariance=SURE)
    errors = [fix.error_m for i in range(1, 40) for fix in room.look(Pose2(0.001 * i, 0, 0), 0.5)]
    assert len(errors) == 39
    assert all(b > a for a, b in pairwise(errors))


def test_a_reference_taken_in_doubt_is_worth_less() -> None:
    sure, unsure = Room(), Room()
    sure.look(Pose2(0, 0, 0), 0.5, covariance=SURE)
    unsure.look(Pose2(0, 0, 0), 0.5, covariance=DOUBT)
    (good,) = sure.look(Pose2(0, 0, 0), 0.5)
    (poor,) = unsure.look(Pose2(0, 0, 0), 0.5)
    assert poor.variance > 10 * good.variance


def test_surfaces_are_bounded() -> None:
    room = Room()
    rng = random.Random(3)
    for _ in range(500):
        room.look(Pose2(rng.uniform(-50, 50), 0, 0), 0.5)
    assert len(room.walls._surfaces) <= MAX_REFERENCES  # noqa: SLF001 - a bound on memory
