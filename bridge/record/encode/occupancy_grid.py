"""Conversion of a floor plan to an occupancy grid."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.session.records import CoverageRecord

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan, Polygon

FREE, OCCUPIED, UNKNOWN = 0, 100, -1

_RESOLUTION_M = 0.02
_MARGIN_CELLS = 2
_MAX_CELLS = 1_000_000
"""Maximum number of cells. In a large hall the cells are larger, so that a message stays small."""


def rasterise(plan: FloorPlan, log_ns: int) -> CoverageRecord:
    """Return the grid: free floor 0, obstacles and cells at walls 100, outside unknown (-1)."""
    x_min, y_min, x_max, y_max = plan.bounds()
    width_m, height_m = x_max - x_min, y_max - y_min
    resolution_m = max(_RESOLUTION_M, math.sqrt(width_m * height_m / _MAX_CELLS))
    columns = math.ceil(width_m / resolution_m) + 2 * _MARGIN_CELLS
    rows = math.ceil(height_m / resolution_m) + 2 * _MARGIN_CELLS
    origin_x_m = x_min - _MARGIN_CELLS * resolution_m
    origin_y_m = y_min - _MARGIN_CELLS * resolution_m
    xs = origin_x_m + (np.arange(columns) + 0.5) * resolution_m
    ys = origin_y_m + (np.arange(rows) + 0.5) * resolution_m
    floor = _inside(plan.walls, xs, ys)
    cells = np.full((rows, columns), UNKNOWN, dtype=np.int8)
    cells[_rim(floor)] = OCCUPIED
    cells[floor] = FREE
    for obstacle in plan.obstacles:
        cells[_inside(obstacle, xs, ys) & floor] = OCCUPIED
    return CoverageRecord(log_ns, cells, origin_x_m, origin_y_m, resolution_m)


def _inside(
    polygon: Polygon, xs: NDArray[np.floating], ys: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """Return a mask of cells whose centre is inside, by the even-odd rule: (rows, columns)."""
    inside = np.zeros((len(ys), len(xs)), dtype=bool)
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        crossed = (ay > ys) != (by > ys)
        if crossed.any():
            at = (bx - ax) * (ys[crossed] - ay) / (by - ay) + ax
            inside[crossed] ^= xs[None, :] < at[:, None]
    return inside


def _rim(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells next to the floor, in eight directions.

    They lie inside the grid's margin.
    """
    grown = floor.copy()
    for axis in (0, 1):
        grown |= np.roll(grown, 1, axis) | np.roll(grown, -1, axis)
    rim: NDArray[np.bool_] = grown & ~floor
    return rim
