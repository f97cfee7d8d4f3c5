"""What of a floor can be reached: the areas that coverage is measured against."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bridge.evaluation.raster import Raster
from bridge.evaluation.raster_kernel import pieces

if TYPE_CHECKING:
    from bridge.evaluation.raster import Floats, Mask
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_BOUNDARY_STEP_M = 0.001
_SLACK_M = 1e-6
"""Centres on the boundary touch a wall: they count as free to rounding."""


@dataclass(frozen=True, slots=True)
class Regions:
    """Masks over one raster."""

    raster: Raster
    free: Mask
    """Floor inside the walls less the obstacles and the cliffs."""
    centres: Mask
    """Where the axle's centre can be, connected to the start."""
    reachable: Mask
    """What the body's disc can cover from the start."""
    sweepable: Mask
    """What the mouth can reach with the body free of collision."""
    passing: Mask
    """What the mouth reaches as the robot passes with any heading along its motion: the same for a
    mouth on the axle. A mouth ahead of the axle reaches more only by turning towards a wall."""


def find_regions(plan: FloorPlan, model: RobotModel, resolution_m: float) -> Regions:
    """The areas of a floor plan for a robot.

    The centre's region C is bounded by parallels of the edges and arcs about the corners at
    the body's radius. Those curves are followed exactly (1 mm steps), not taken from the raster:
    dilating C is then C and all within the distance of its boundary, with no loss of a
    half cell along every wall. Passages are open from a width of Φ.
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
    reach = math.hypot(model.mouth_offset_m, half_width)
    reachable, sweepable, passing = centres.copy(), centres.copy(), centres.copy()
    for curve in curves:
        pieces = _simplified(curve)
        raster.stamp_path(reachable, pieces, radius)
        raster.stamp_path(passing, pieces, half_width)
        raster.stamp_path(sweepable, pieces, reach)
    return Regions(raster, free, centres, reachable & free, sweepable & free, passing & free)


def _boundary(plan: FloorPlan, edges: Floats, radius: float) -> list[Floats]:
    """Runs of boundary points of C, each of shape (n, 2), n ≥ 1, in order along the curve."""
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
    for points in candidates:
        good = _clear(points, edges, radius - _SLACK_M) & _on_floor(points, plan)
        starts = np.flatnonzero(good & ~np.concatenate([[False], good[:-1]]))
        ends = np.flatnonzero(good & ~np.concatenate([good[1:], [False]])) + 1
        runs.extend(points[i:j] for i, j in zip(starts, ends, strict=True))
    return runs


def _clear(points: Floats, edges: Floats, least: float) -> Mask:
    """Which points are at least ``least`` away from every edge."""
    good = np.ones(len(points), dtype=np.bool_)
    low, high = points.min(axis=0) - least, points.max(axis=0) + least
    for ax, ay, bx, by in edges:
        if max(ax, bx) < low[0] or min(ax, bx) > high[0]:
            continue
        if max(ay, by) < low[1] or min(ay, by) > high[1]:
            continue
        x, y = points[:, 0] - ax, points[:, 1] - ay
        ex, ey = bx - ax, by - ay
        along = np.clip((x * ex + y * ey) / (ex * ex + ey * ey), 0.0, 1.0)
        good &= np.hypot(x - along * ex, y - along * ey) >= least
    return good


def _on_floor(points: Floats, plan: FloorPlan) -> Mask:
    """Which points are inside the walls and outside the obstacles."""

    def inside(corners: tuple[tuple[float, float], ...]) -> Mask:
        found = np.zeros(len(points), dtype=np.bool_)
        x, y = points[:, 0], points[:, 1]
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
            if ay != by:
                found ^= ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
        return found

    floor = inside(plan.walls)
    for obstacle in plan.obstacles:
        floor &= ~inside(obstacle)
    return floor


def _connected(
    raster: Raster,
    centres: Mask,
    curves: list[Floats],
    start: tuple[float, float],
) -> tuple[Mask, list[Floats]]:
    """The part of C, and of its boundary, that is connected to the start.

    Cells that the boundary runs through belong to C as well: a passage narrower than a
    cell has no sample point in it, but its two boundary curves. A start whose body touches a
    wall is taken to the nearest place where it does not.
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
    labels, _ = pieces(joined, 2)
    distance = np.where(joined, np.hypot(raster.x - start[0], raster.y - start[1]), np.inf)
    mine = labels == labels[np.unravel_index(int(np.argmin(distance)), raster.shape)]
    kept = [
        curve
        for curve, (row, col) in zip(curves, rows_cols, strict=True)
        if mine[int(row[0]), int(col[0])]
    ]
    return centres & mine, kept


def _simplified(curve: Floats) -> list[tuple[float, float]]:
    """Few corners for a run: its ends if straight, else a corner per 3° of arc."""
    first, last = curve[0], curve[-1]
    chord = last - first
    middle = curve[len(curve) // 2] - first
    bend = abs(chord[0] * middle[1] - chord[1] * middle[0])
    straight = bend <= _SLACK_M * max(float(np.hypot(*chord)), _SLACK_M)
    closed = float(np.hypot(*chord)) < _SLACK_M and len(curve) > 2  # noqa: PLR2004
    if straight and not closed:
        picked = [0, len(curve) - 1]
    else:
        # 8 mm of a 16 cm arc are 3°: the sagitta is 0.05 mm
        picked = [*range(0, len(curve) - 1, 8), len(curve) - 1]
    return [(float(curve[i, 0]), float(curve[i, 1])) for i in picked]
