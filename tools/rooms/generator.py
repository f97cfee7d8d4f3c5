"""Random floor plans that resemble the rooms of homes.

A plan has outer walls (box, L, corridor with rooms), inner walls with doors, and furniture (boxes
at and off walls, rotated boxes, columns, table legs, pockets). Equal generators give equal rooms.
The rooms do not depend on any planner.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.floor_plan.floor_plan import FloorPlan, Point, Polygon, contains
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.baselines.random_bounce import RandomSource

KINDS = ("box", "ell", "turned", "columns", "legs", "pockets", "corridor", "flat")
"""Kinds of room of ``generate_room``."""

_WALL_M = 0.1
"""Thickness of an inner wall, m."""
_START_GAP_M = 0.02
"""Minimum gap between footprint and walls or obstacles at the start, m."""
_CLEAR_M = 0.16 + _START_GAP_M
"""Minimum distance of the start to walls and obstacles for the paper's robot, m."""
_TRIES = 400
"""Maximum number of random start positions that are tried."""
_ORTHOGONAL_SHARE = 0.5
"""Probability that the heading at the start is along an axis."""
_AT_WALL = (0.25, 0.5)
"""Cumulative probabilities that a box stands at the left wall, and at the left or upper wall."""
_LEG_MARGIN_M = 0.05
"""Minimum distance of a table leg's centre to the walls, m."""


def generate_room(
    seed: int, rng: RandomSource, kind: str | None = None, radius_m: float = 0.0
) -> FloorPlan:
    """Return a random room.

    Args:
        seed: number in the room's name; it does not affect the room.
        rng: source of randomness.
        kind: one of ``KINDS``; None: a random one.
        radius_m: radius of the footprint, m; a radius larger than that of the paper's robot moves
            the start.

    Raises:
        KeyError: ``kind`` is not one of ``KINDS``.

    """
    if kind is None:
        kind = KINDS[_whole(rng, 0, len(KINDS) - 1)]
    walls, obstacles = _MAKERS[kind](rng)
    start = _start(rng, walls, obstacles, max(_CLEAR_M, radius_m + _START_GAP_M))
    return FloorPlan(f"{kind}-{seed}", walls, tuple(obstacles), start)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """Return the corners of a rectangle, m, counter-clockwise, rounded to a millimetre."""
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return tuple((round(x, 3), round(y, 3)) for x, y in corners)


def turned(x: float, y: float, width: float, depth: float, angle_rad: float) -> Polygon:
    """Return the corners of a rotated box with its centre at (x, y), m."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return tuple(
        (
            round(x + 0.5 * (i * width * c - j * depth * s), 4),
            round(y + 0.5 * (i * width * s + j * depth * c), 4),
        )
        for i, j in signs
    )


def column(x: float, y: float, radius: float, corners: int = 24) -> Polygon:
    """Return a round column as a polygon, m."""
    return tuple(
        (
            round(x + radius * math.cos(math.tau * k / corners), 4),
            round(y + radius * math.sin(math.tau * k / corners), 4),
        )
        for k in range(corners)
    )


def distance_m(polygon: Polygon, x: float, y: float) -> float:
    """Return the distance of a point to the edges of a polygon, m."""
    best = math.inf
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        ex, ey = bx - ax, by - ay
        t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        t = min(max(t, 0.0), 1.0)
        best = min(best, math.hypot(x - ax - t * ex, y - ay - t * ey))
    return best


def _whole(rng: RandomSource, low: int, high: int) -> int:
    return min(int(rng.uniform(low, high + 1)), high)


def _start(rng: RandomSource, walls: Polygon, obstacles: list[Polygon], clear_m: float) -> Pose2:
    """Return a random pose at least ``clear_m`` from walls and obstacles, m."""
    xs, ys = [p[0] for p in walls], [p[1] for p in walls]
    for _ in range(_TRIES):
        x, y = rng.uniform(min(xs), max(xs)), rng.uniform(min(ys), max(ys))
        if not contains(walls, x, y) or any(contains(o, x, y) for o in obstacles):
            continue
        if all(distance_m(polygon, x, y) > clear_m for polygon in (walls, *obstacles)):
            heading = rng.uniform(-math.pi, math.pi)
            if rng.uniform(0.0, 1.0) < _ORTHOGONAL_SHARE:
                heading = round(heading / (0.5 * math.pi)) * 0.5 * math.pi
            return Pose2(round(x, 3), round(y, 3), round(heading, 4))
    raise ValueError("no free place for the robot in this room")


def _box_corners(rng: RandomSource, min_m: float = 1.8) -> tuple[float, float, Polygon]:
    width, depth = round(rng.uniform(min_m, 4.5), 3), round(rng.uniform(min_m, 4.5), 3)
    return width, depth, rectangle(0.0, 0.0, width, depth)


def _boxes(
    rng: RandomSource, count: int, area: tuple[float, float, float, float], *, angled: bool = False
) -> list[Polygon]:
    """Return random boxes in an area, some of them at its walls; the boxes may overlap."""
    x0, y0, x1, y1 = area
    boxes: list[Polygon] = []
    for _ in range(count):
        width = min(rng.uniform(0.2, 1.2), 0.45 * (x1 - x0))
        depth = min(rng.uniform(0.2, 1.0), 0.45 * (y1 - y0))
        x, y = rng.uniform(x0, x1 - width), rng.uniform(y0, y1 - depth)
        if angled:
            angle = rng.uniform(0.1, 1.45)
            boxes.append(turned(x + 0.5 * width, y + 0.5 * depth, width, depth, angle))
            continue
        place = rng.uniform(0.0, 1.0)
        if place < _AT_WALL[0]:
            x = x0
        elif place < _AT_WALL[1]:
            y = y1 - depth
        boxes.append(rectangle(x, y, x + width, y + depth))
    return boxes


def _box(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    width, depth, walls = _box_corners(rng)
    return walls, _boxes(rng, _whole(rng, 0, 4), (0.0, 0.0, width, depth))


def _ell(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    width, depth = rng.uniform(2.6, 4.6), rng.uniform(2.6, 4.6)
    cut_x, cut_y = rng.uniform(0.35, 0.7) * width, rng.uniform(0.35, 0.7) * depth
    corners: tuple[Point, ...] = (
        (0.0, 0.0),
        (width, 0.0),
        (width, cut_y),
        (cut_x, cut_y),
        (cut_x, depth),
        (0.0, depth),
    )
    walls = tuple((round(x, 3), round(y, 3)) for x, y in corners)
    return walls, _boxes(rng, _whole(rng, 0, 2), (0.0, 0.0, cut_x, cut_y))


def _turned(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    width, depth, walls = _box_corners(rng, 2.4)
    area = (0.2, 0.2, width - 0.2, depth - 0.2)
    return walls, _boxes(rng, _whole(rng, 1, 3), area, angled=True)


def _columns(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    width, depth, walls = _box_corners(rng, 2.4)
    obstacles = [
        column(
            rng.uniform(0.4, width - 0.4),
            rng.uniform(0.4, depth - 0.4),
            rng.uniform(0.08, 0.4),
        )
        for _ in range(_whole(rng, 1, 3))
    ]
    return walls, obstacles + _boxes(rng, 1, (0.0, 0.0, width, depth))


def _legs(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    width, depth, walls = _box_corners(rng, 2.4)
    obstacles: list[Polygon] = []
    for _ in range(_whole(rng, 1, 3)):
        across, along = rng.uniform(0.4, 1.2), rng.uniform(0.4, 0.9)
        x = rng.uniform(0.2, max(width - across - 0.2, 0.21))
        y = rng.uniform(0.2, max(depth - along - 0.2, 0.21))
        leg = rng.uniform(0.03, 0.05)
        angle = rng.uniform(0.0, 0.4)
        c, s = math.cos(angle), math.sin(angle)
        for i in (0.0, across):
            for j in (0.0, along):
                px, py = x + i * c - j * s, y + i * s + j * c
                if (
                    _LEG_MARGIN_M < px < width - _LEG_MARGIN_M
                    and _LEG_MARGIN_M < py < depth - _LEG_MARGIN_M
                ):
                    obstacles.append(turned(px, py, leg, leg, angle))
    return walls, obstacles


def _pockets(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    """Return cupboards in a row along a wall, with gaps of 22 to 70 cm between them."""
    width, depth, walls = _box_corners(rng, 2.4)
    obstacles: list[Polygon] = []
    x, height = rng.uniform(0.0, 0.5), rng.uniform(0.4, 0.9)
    while x < width - 0.3:
        across = min(rng.uniform(0.2, 0.7), width - x)
        obstacles.append(rectangle(x, depth - height, x + across, depth))
        x += across + rng.uniform(0.22, 0.7)
    return walls, obstacles


def _corridor(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    """Return a corridor with rooms on one side."""
    count = _whole(rng, 2, 3)
    room, hall = rng.uniform(1.8, 2.6), rng.uniform(0.7, 1.3)
    depth = rng.uniform(1.8, 2.8)
    width = count * room + (count - 1) * _WALL_M
    obstacles: list[Polygon] = []
    for k in range(count):
        x0 = k * (room + _WALL_M)
        door, at = rng.uniform(0.45, 0.9), rng.uniform(0.1, 0.5)
        left = x0 + at * (room - door)
        if left > x0:
            obstacles.append(rectangle(x0, hall, left, hall + _WALL_M))
        obstacles.append(rectangle(left + door, hall, x0 + room, hall + _WALL_M))
        if k:
            obstacles.append(rectangle(x0 - _WALL_M, hall, x0, hall + _WALL_M + depth))
        area = (x0, hall + _WALL_M + 0.5, x0 + room, hall + _WALL_M + depth)
        obstacles.extend(_boxes(rng, _whole(rng, 0, 1), area))
    return rectangle(0.0, 0.0, width, hall + _WALL_M + depth), obstacles


def _flat(rng: RandomSource) -> tuple[Polygon, list[Polygon]]:
    """Return four furnished rooms around a cross of walls with doors."""
    width, depth = rng.uniform(5.0, 8.0), rng.uniform(4.5, 7.5)
    x, y = rng.uniform(0.4, 0.6) * width, rng.uniform(0.4, 0.6) * depth
    half = 0.5 * _WALL_M
    obstacles: list[Polygon] = []
    for low, high in ((0.0, x - half), (x + half, width)):
        door, at = rng.uniform(0.6, 1.0), rng.uniform(0.1, 0.6)
        left = low + at * (high - low - door)
        obstacles.append(rectangle(low, y - half, left, y + half))
        obstacles.append(rectangle(left + door, y - half, high, y + half))
    is_lower = rng.uniform(0.0, 1.0) < 0.5  # noqa: PLR2004 - the door is in either half
    low, high = (0.0, y - half) if is_lower else (y + half, depth)
    door, at = rng.uniform(0.6, 1.0), rng.uniform(0.1, 0.6)
    left = low + at * (high - low - door)
    obstacles.append(rectangle(x - half, low, x + half, left))
    obstacles.append(rectangle(x - half, left + door, x + half, high))
    other = (y + half, depth) if low == 0.0 else (0.0, y - half)
    obstacles.append(rectangle(x - half, other[0], x + half, other[1]))
    obstacles.append(rectangle(x - half, y - half, x + half, y + half))
    for x0, x1 in ((0.0, x - half), (x + half, width)):
        for y0, y1 in ((0.0, y - half), (y + half, depth)):
            obstacles.extend(
                _boxes(rng, _whole(rng, 0, 2), (x0 + 0.2, y0 + 0.5, x1 - 0.2, y1 - 0.5))
            )
    return rectangle(0.0, 0.0, width, depth), obstacles


_MAKERS: dict[str, Callable[[RandomSource], tuple[Polygon, list[Polygon]]]] = {
    "box": _box,
    "ell": _ell,
    "turned": _turned,
    "columns": _columns,
    "legs": _legs,
    "pockets": _pockets,
    "corridor": _corridor,
    "flat": _flat,
}
