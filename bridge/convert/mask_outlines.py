"""Shapes of an imported map: outlines of a mask, simplification, and a start pose. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from bridge.evaluation.raster import Raster
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import Point, Polygon

_MAX_CELLS = 1_000_000
"""Maximum number of cells in the grid in which a start pose is searched."""
_Corner = tuple[int, int]


def outlines(mask: NDArray[np.bool_]) -> list[list[_Corner]]:
    """Return the outlines of a mask along its cells' edges, as (column, row) corners.

    The mask is on the left of each edge. If rows increase upwards, outlines are counter-clockwise
    and holes are clockwise.
    """
    padded = np.pad(mask, 1)
    following: dict[_Corner, list[_Corner]] = {}

    def edges(at: NDArray[np.bool_], begin: _Corner, end: _Corner) -> None:
        for row, column in np.argwhere(at).tolist():
            here = (column + begin[0], row + begin[1])
            following.setdefault(here, []).append((column + end[0], row + end[1]))

    edges(mask & ~padded[:-2, 1:-1], (0, 0), (1, 0))
    edges(mask & ~padded[1:-1, 2:], (1, 0), (1, 1))
    edges(mask & ~padded[2:, 1:-1], (1, 1), (0, 1))
    edges(mask & ~padded[1:-1, :-2], (0, 1), (0, 0))
    loops = []
    while following:
        begin = here = next(iter(following))
        came = (0, 0)
        loop: list[_Corner] = []
        while True:
            ahead = following[here]
            # If two cells meet only at a corner, turn left, so that each cell has its own outline.
            target = min(ahead, key=lambda to: _turn(came, (to[0] - here[0], to[1] - here[1])))
            ahead.remove(target)
            if not ahead:
                del following[here]
            step = (target[0] - here[0], target[1] - here[1])
            if step != came:
                loop.append(here)
            here, came = target, step
            if here == begin:
                break
        loops.append(loop)
    return loops


def _turn(came: _Corner, step: _Corner) -> int:
    """Return the rank of a turn: left, straight on, right."""
    return came[1] * step[0] - came[0] * step[1]


def simplified(polygon: Sequence[Point], tolerance_m: float) -> Polygon:
    """Remove corners within a tolerance of the remaining outline (Douglas and Peucker).

    If no area would remain, for example of a single cell, the polygon is not changed.
    """
    points = np.asarray(polygon, dtype=np.float64)
    whole = tuple((float(x), float(y)) for x, y in points)
    if tolerance_m <= 0.0 or len(points) < 4:  # noqa: PLR2004 - a triangle has no corner to spare
        return whole
    far = int(np.argmax(np.hypot(*(points - points[0]).T)))
    closed = np.vstack([points, points[:1]])
    kept = {0, far}
    for first, last in ((0, far), (far, len(points))):
        kept |= _kept(closed, first, last, tolerance_m)
    fewer = tuple(whole[i] for i in sorted(kept))
    return fewer if len(fewer) > 2 else whole  # noqa: PLR2004 - two corners enclose nothing


def _kept(points: NDArray[np.float64], first: int, last: int, tolerance_m: float) -> set[int]:
    found: set[int] = set()
    pieces = [(first, last)]
    while pieces:
        begin, end = pieces.pop()
        if end - begin < 2:  # noqa: PLR2004 - no element lies in between
            continue
        a, along = points[begin], points[end] - points[begin]
        between = points[begin + 1 : end] - a
        length = math.hypot(*along)
        off = (
            np.abs(along[0] * between[:, 1] - along[1] * between[:, 0]) / length
            if length
            else np.hypot(*between.T)
        )
        at = int(np.argmax(off))
        if off[at] > tolerance_m:
            middle = begin + 1 + at
            found.add(middle)
            pieces += [(begin, middle), (middle, end)]
    return found


def roomiest(walls: Polygon, obstacles: Sequence[Polygon]) -> Pose2:
    """Return the pose on the floor that is farthest from every wall, heading along x."""
    low, high = np.min(walls, axis=0), np.max(walls, axis=0)
    area = float(np.prod(high - low))
    raster = Raster((*low.tolist(), *high.tolist()), max(0.01, math.sqrt(area / _MAX_CELLS)))
    free = raster.polygon(walls)
    for obstacle in obstacles:
        free &= ~raster.polygon(obstacle)
    depth = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    x_m, y_m = float(raster.x[row, column]), float(raster.y[row, column])
    return Pose2(round(x_m, 3), round(y_m, 3), 0.0)
