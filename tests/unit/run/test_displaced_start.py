"""Comparison of the walls that the robot measures with the walls of the room file."""

from __future__ import annotations

import math
import random

import pytest

from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.run.displaced_start import MeasuredWall, RoomCheck

WALLS = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.5), (2.4, 2.5), (2.4, 3.4), (0.0, 3.4))
CUPBOARD = ((1.0, 1.2), (1.9, 1.2), (1.9, 1.8), (1.0, 1.8))
START = Pose2(0.5, 0.4, 0.3)
PLAN = FloorPlan("ell", WALLS, (CUPBOARD,), START)


def measured(start: Pose2, *edges: int, shorter_m: float = 0.15) -> list[MeasuredWall]:
    """Return the walls that a robot measures if it starts at ``start`` but assumes START."""
    turn = wrap_angle(START.theta_rad - start.theta_rad)
    c, s = math.cos(turn), math.sin(turn)
    rng = random.Random(5)

    def seen(x: float, y: float) -> tuple[float, float]:
        dx, dy = x - start.x_m, y - start.y_m
        error = rng.gauss(0.0, 0.005)
        return START.x_m + c * dx - s * dy + error, START.y_m + s * dx + c * dy + error

    found = []
    for edge in edges:
        (ax, ay), (bx, by) = WALLS[edge], WALLS[(edge + 1) % len(WALLS)]
        length = math.dist((ax, ay), (bx, by))
        ux, uy = (bx - ax) / length, (by - ay) / length
        first = seen(ax + shorter_m * ux, ay + shorter_m * uy)
        last = seen(bx - shorter_m * ux, by - shorter_m * uy)
        found.append(MeasuredWall(*first, *last))
    return found


def test_walls_from_the_right_start_fit() -> None:
    fit = RoomCheck(PLAN).fit(measured(START, 0, 1, 5))
    assert fit is not None
    assert (fit.share, fit.start) == (1.0, None)
    assert fit.off(START) == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(12))
def test_another_start_is_found_from_two_walls(seed: int) -> None:
    rng = random.Random(seed)
    start = Pose2(rng.uniform(0.3, 2.0), rng.uniform(0.3, 1.0), rng.uniform(-3.0, 3.0))
    fit = RoomCheck(PLAN).fit(measured(start, 0, 1, 5))
    assert fit is not None
    assert fit.share < 0.5
    assert fit.start is not None
    assert fit.start.distance_m(start) < 0.1
    assert abs(wrap_angle(fit.start.theta_rad - start.theta_rad)) < math.radians(3.0)
    off_m, off_rad = fit.off(START)
    assert off_m == pytest.approx(start.distance_m(START), abs=0.1)
    assert off_rad == pytest.approx(wrap_angle(start.theta_rad - START.theta_rad), abs=0.06)


def test_too_few_walls_give_no_result() -> None:
    assert RoomCheck(PLAN).fit([]) is None
    assert RoomCheck(PLAN).fit(measured(Pose2(1.0, 0.5, 1.0), 3)) is None


def test_furniture_that_the_file_lacks_is_no_other_start() -> None:
    box = [
        MeasuredWall(3.0, 1.0, 3.5, 1.0),
        MeasuredWall(3.5, 1.0, 3.5, 1.5),
        MeasuredWall(3.5, 1.5, 3.0, 1.5),
    ]
    fit = RoomCheck(PLAN).fit([*measured(START, 0), *box])
    assert fit is not None
    assert fit.start is None
    assert fit.share > 0.5


def test_another_room_is_reported_only_after_a_long_way() -> None:
    zigzag = [
        MeasuredWall(0.0, 0.0, 1.0, 0.3),
        MeasuredWall(1.0, 0.3, 0.7, 1.4),
        MeasuredWall(0.7, 1.4, 1.9, 2.6),
    ]
    check = RoomCheck(PLAN)
    assert check.fit(zigzag) is None
    more = [*zigzag, MeasuredWall(1.9, 2.6, 0.6, 3.3), MeasuredWall(0.6, 3.3, -0.5, 1.9)]
    fit = check.fit(more)
    assert fit is not None
    assert fit.start is None
    assert fit.share < 0.5
    known = check.fit(zigzag, seek=False)
    assert known is not None
    assert known.start is None
