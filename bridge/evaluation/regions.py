"""Regions of a floor plan, the reference of coverage: free, reachable and sweepable floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from bridge.evaluation.raster import Raster, crosses

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bridge.evaluation.raster import Floats, Mask
    from bridge.floor_plan.floor_plan import FloorPlan, Polygon
    from bridge.motion.robot_model import RobotModel

_BOUNDARY_STEP_M = 0.001
"""Spacing of the points on a boundary curve, m."""
_SLACK_M = 1e-6
"""Tolerance of a distance, m. Centres on the boundary touch a wall and count as free."""


@dataclass(frozen=True, slots=True)
class Regions:
    """Regions of one floor plan for one robot, as masks over one raster."""

    raster: Raster
    free: Mask
    """Floor inside the walls minus the obstacles and the cliffs."""
    centres: Mask
    """Collision-free positions of the axle's centre that are connected to the start."""
    reachable: Mask
    """Floor that the footprint can cover from the start."""
    sweepable: Mask
    """Floor that the mouth can reach while the footprint is free of collision."""
    passing: Mask
    """Floor that the mouth can reach while the robot drives forwards, at any heading. If the mouth
    is on the axle, this is equal to ``sweepable``. A mouth ahead of the axle reaches more floor in
    a turn towards a wall, which does not count here."""


def find_regions(plan: FloorPlan, model: RobotModel, resolution_m: float) -> Regions:
    """Return the regions of a floor plan for a robot.

    C is the region of collision-free centres. Its boundary consists of lines parallel to the edges
    and of arcs about the corners, both at the footprint's radius. These curves are computed
    exactly, in steps of 1 mm, not in the raster. The dilation of C is C plus all points within the
    given distance of its boundary, so walls have no error of half a cell. A passage is open if its
    width is at least the footprint's diameter Φ.
    """
    plan = replace(plan, obstacles=plan.obstacles + plan.cliffs)
    raster = Raster(plan.bounds(), resolution_m)
    free = raster.polygon(plan.walls)
    for obstacle in plan.obstacles:
        free &= ~raster.polygon(obstacle)
    edges = [(a, b) for a, b in plan.edges() if a != b]
    radius = model.radius_m
    blocked = raster.empty()
    for a, b in edges:
        raster.stamp_capsule(blocked, a, b, radius)
    centres = free & ~blocked
    curves = _boundary(plan, np.array(edges, dtype=np.float64).reshape(-1, 4), radius)
    centres, curves = _connected(raster, centres, curves, (plan.start.x_m, plan.start.y_m))
    half_width = 0.5 * model.cleaning_width_m
    reachable, sweepable, passing = centres.copy(), centres.copy(), centres.copy()
    for curve in curves:
        polyline = _simplified(curve)
        raster.stamp_path(reachable, polyline, radius)
        raster.stamp_path(passing, polyline, half_width)
        raster.stamp_path(sweepable, polyline, model.mouth_reach_m)
    return Regions(raster, free, centres, reachable & free, sweepable & free, passing & free)


def _boundary(plan: FloorPlan, edges: Floats, radius: float) -> list[Floats]:
    """Return the boundary curves of C: arrays of shape (n, 2), n ≥ 1, in order along the curve."""
    candidates: list[Floats] = []
    for ax, ay, bx, by in edges:
        length = math.hypot(bx - ax, by - ay)
        nx, ny = -(by - ay) / length, (bx - ax) / length
        share = np.linspace(0.0, 1.0, max(math.ceil(length / _BOUNDARY_STEP_M), 1) + 1)
        line = np.stack([ax + share * (bx - ax), ay + share * (by - ay)], axis=1)
        candidates.extend(line + side * radius * np.array([nx, ny]) for side in (1.0, -1.0))
    count = math.ceil(2.0 * math.pi * radius / _BOUNDARY_STEP_M)
    angle = np.linspace(0.0, 2.0 * math.pi, count + 1)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    candidates.extend(corner + circle for corner in {(e[0], e[1]) for e in edges.tolist()})
    runs: list[Floats] = []
    boxes = [_box(np.array(obstacle)) for obstacle in plan.obstacles]
    for points in candidates:
        low, high = _box(points)
        near = [
            obstacle
            for obstacle, (begin, end) in zip(plan.obstacles, boxes, strict=True)
            if (begin <= high).all() and (end >= low).all()
        ]
        good = _clear(points, edges, radius - _SLACK_M) & _on_floor(points, plan.walls, near)
        starts = np.flatnonzero(good & ~np.concatenate([[False], good[:-1]]))
        ends = np.flatnonzero(good & ~np.concatenate([good[1:], [False]])) + 1
        runs.extend(points[i:j] for i, j in zip(starts, ends, strict=True))
    return runs


def _clear(points: Floats, edges: Floats, min_m: float) -> Mask:
    """Return a mask of the points with a distance of at least ``min_m`` metres from every edge."""
    good = np.ones(len(points), dtype=np.bool_)
    low, high = _box(points)
    begins, ends = edges[:, :2], edges[:, 2:]
    near = (np.maximum(begins, ends) >= low - min_m) & (np.minimum(begins, ends) <= high + min_m)
    for ax, ay, bx, by in edges[near.all(axis=1)]:
        x, y = points[:, 0] - ax, points[:, 1] - ay
        ex, ey = bx - ax, by - ay
        along = np.clip((x * ex + y * ey) / (ex * ex + ey * ey), 0.0, 1.0)
        good &= np.hypot(x - along * ex, y - along * ey) >= min_m
    return good


def _box(points: Floats) -> tuple[Floats, Floats]:
    """Return the lowest and the highest coordinates of points."""
    return points.min(axis=0), points.max(axis=0)


def _on_floor(points: Floats, walls: Polygon, obstacles: Iterable[Polygon]) -> Mask:
    """Return a mask of the points inside the walls and outside the obstacles."""

    def inside(corners: tuple[tuple[float, float], ...]) -> Mask:
        found = np.zeros(len(points), dtype=np.bool_)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if a[1] != b[1]:
                found ^= crosses(points[:, 0], points[:, 1], a, b)
        return found

    floor = inside(walls)
    for obstacle in obstacles:
        floor &= ~inside(obstacle)
    return floor


def _connected(
    raster: Raster,
    centres: Mask,
    curves: list[Floats],
    start: tuple[float, float],
) -> tuple[Mask, list[Floats]]:
    """Return the part of C, and of its boundary, that is connected to the start.

    Cells that contain boundary points also belong to C. A passage narrower than a cell may contain
    no sample point, but it contains its two boundary curves. If the footprint touches a wall at the
    start, the nearest collision-free position is used as the start.
    """
    joined = centres.copy()
    rows_cols: list[tuple[Floats, Floats]] = []
    for curve in curves:
        col = np.clip((curve[:, 0] - raster.x_min_m) // raster.resolution_m, 0, raster.shape[1] - 1)
        row = np.clip((curve[:, 1] - raster.y_min_m) // raster.resolution_m, 0, raster.shape[0] - 1)
        rows_cols.append((row, col))
        joined[row.astype(np.intp), col.astype(np.intp)] = True
    if not joined.any():
        return centres, []
    labels, _ = ndimage.label(joined, np.ones((3, 3)))  # cells that touch by a corner are joined
    distance = np.where(joined, np.hypot(raster.x - start[0], raster.y - start[1]), np.inf)
    mine = labels == labels[np.unravel_index(int(np.argmin(distance)), raster.shape)]
    kept = [
        curve
        for curve, (row, col) in zip(curves, rows_cols, strict=True)
        if mine[int(row[0]), int(col[0])]
    ]
    return centres & mine, kept


def _simplified(curve: Floats) -> list[tuple[float, float]]:
    """Return a polyline with few points: the ends of a straight curve, else one point every 3°."""
    first, last = curve[0], curve[-1]
    chord = last - first
    middle = curve[len(curve) // 2] - first
    bend = abs(chord[0] * middle[1] - chord[1] * middle[0])
    straight = bend <= _SLACK_M * max(float(np.hypot(*chord)), _SLACK_M)
    closed = float(np.hypot(*chord)) < _SLACK_M and len(curve) > 2  # noqa: PLR2004
    if straight and not closed:
        picked = [0, len(curve) - 1]
    else:
        # On an arc with a radius of 16 cm, 8 mm are 3°. The chord's maximum distance from the arc
        # is 0.05 mm.
        picked = [*range(0, len(curve) - 1, 8), len(curve) - 1]
    return [(float(curve[i, 0]), float(curve[i, 1])) for i in picked]
