"""Compiled loops over the cells of a raster: shapes, connected pieces and distances."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
import numpy as np

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import (
        FloatBlock,
        FloatGrid,
        IntGrid,
        Layer,
        LongGrid,
    )

if TYPE_CHECKING:
    from numpy.typing import NDArray

_EDGE = cython.declare(cython.double, -1e-12)
"""Tolerance with which a point on the edge of a triangle counts as inside."""


def capsule(  # noqa: PLR0913, PLR0917 - a kernel takes numbers
    mask: Layer,
    xs: FloatGrid,
    ys: FloatGrid,
    row0: cython.int,
    row1: cython.int,
    col0: cython.int,
    col1: cython.int,
    ax: cython.double,
    ay: cython.double,
    ex: cython.double,
    ey: cython.double,
    radius: cython.double,
) -> None:
    """Set the points within ``radius`` of the segment from (ax, ay) to (ax + ex, ay + ey).

    The half-open ranges ``row0`` to ``row1`` and ``col0`` to ``col1`` must contain these points.
    """
    row: cython.int
    col: cython.int
    square = ex * ex + ey * ey
    for row in range(row0, row1):
        for col in range(col0, col1):
            x, y = xs[row, col] - ax, ys[row, col] - ay
            if square > 0.0:
                along = min(max((x * ex + y * ey) / square, 0.0), 1.0)
                x -= along * ex
                y -= along * ey
            if x * x + y * y <= radius * radius:
                mask[row, col] = 1


def sweep(  # noqa: PLR0913, PLR0917 - a kernel takes numbers
    times: FloatGrid,
    xs: FloatGrid,
    ys: FloatGrid,
    row0: cython.int,
    row1: cython.int,
    col0: cython.int,
    col1: cython.int,
    corners: FloatGrid,
    edges: FloatBlock,
    time_s: cython.double,
) -> None:
    """Store a time for the points in one of two triangles, if they have no earlier time.

    Rows and columns have the same meaning as in :func:`capsule`. ``corners`` has one row for each
    triangle: x and y of its three corners, in either orientation. ``edges`` is a work array of
    shape (2, 3, 4).
    """
    row: cython.int
    col: cython.int
    t: cython.int
    k: cython.int
    for t in range(2):
        ax, ay = corners[t, 0], corners[t, 1]
        area = (corners[t, 2] - ax) * (corners[t, 5] - ay)
        area -= (corners[t, 3] - ay) * (corners[t, 4] - ax)
        sign = 1.0 if area >= 0.0 else -1.0
        for k in range(3):
            px, py = corners[t, 2 * k], corners[t, 2 * k + 1]
            qx, qy = corners[t, (2 * k + 2) % 6], corners[t, (2 * k + 3) % 6]
            edges[t, k, 0], edges[t, k, 1] = px, py
            edges[t, k, 2], edges[t, k, 3] = sign * (qx - px), sign * (qy - py)
    for row in range(row0, row1):
        for col in range(col0, col1):
            if times[row, col] <= time_s:
                continue
            for t in range(2):
                inside = True
                for k in range(3):
                    dx, dy = xs[row, col] - edges[t, k, 0], ys[row, col] - edges[t, k, 1]
                    if edges[t, k, 2] * dy - edges[t, k, 3] * dx < _EDGE:
                        inside = False
                        break
                if inside:
                    times[row, col] = time_s
                    break


def pieces(mask: NDArray[np.bool_], reach: int) -> tuple[NDArray[np.int32], int]:
    """Assign numbers from 1 to the connected pieces of a mask, in the order of their first cells.

    If ``reach`` is 1, cells with a common side are connected. If it is 2, cells with a common
    corner are connected too.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    stack = np.empty((mask.size, 2), dtype=np.int32)
    return labels, number_pieces(_bytes_of(mask), reach, labels, stack)


def _bytes_of(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(mask).view(np.uint8)


def number_pieces(mask: Layer, reach: cython.int, labels: IntGrid, stack: IntGrid) -> cython.int:
    """Compiled part of :func:`pieces`. ``labels`` must be zero; ``stack`` is a work array."""
    rows: cython.int = mask.shape[0]
    columns: cython.int = mask.shape[1]
    row0: cython.int
    col0: cython.int
    row: cython.int
    col: cython.int
    r: cython.int
    c: cython.int
    top: cython.Py_ssize_t
    count: cython.int = 0
    for row0 in range(rows):
        for col0 in range(columns):
            if not mask[row0, col0] or labels[row0, col0]:
                continue
            count += 1
            labels[row0, col0] = count
            stack[0, 0], stack[0, 1] = row0, col0
            top = 1
            while top:
                top -= 1
                row, col = stack[top, 0], stack[top, 1]
                for down in range(-1, 2):
                    for right in range(-1, 2):
                        r, c = row + down, col + right
                        if (
                            abs(down) + abs(right) <= reach
                            and 0 <= r < rows
                            and 0 <= c < columns
                            and mask[r, c]
                            and not labels[r, c]
                        ):
                            labels[r, c] = count
                            stack[top, 0], stack[top, 1] = r, c
                            top += 1
    return count


def deepest(mask: NDArray[np.bool_]) -> float:
    """Return the maximum distance, in cells, from a cell in the mask to the nearest cell outside.

    The result is exact (algorithm with two passes: Meijster, Roerdink, Hesselink 2000). Points
    outside the raster count as outside the mask.
    """
    rows, columns = mask.shape
    down = np.zeros((rows + 2, columns + 2), dtype=np.int64)
    return math.sqrt(deepest_square(_bytes_of(mask), down))


def deepest_square(mask: Layer, down: LongGrid) -> cython.longlong:
    """Return the square of :func:`deepest` (compiled). ``down`` has a border of zeros."""
    rows: cython.int = mask.shape[0]
    columns: cython.int = mask.shape[1]
    row: cython.int
    col: cython.int
    side: cython.int
    other: cython.int
    reach: cython.longlong
    square: cython.longlong
    step: cython.longlong
    d: cython.longlong
    deepest: cython.longlong = 0
    for col in range(1, columns + 1):
        for row in range(1, rows + 1):
            down[row, col] = down[row - 1, col] + 1 if mask[row - 1, col - 1] else 0
        for row in range(rows, 0, -1):
            down[row, col] = min(down[row, col], down[row + 1, col] + 1)
    for row in range(1, rows + 1):
        for col in range(1, columns + 1):
            reach = down[row, col]
            square = reach * reach
            if square <= deepest:
                continue  # its distance cannot exceed the maximum so far
            step = 1
            while step * step < square:
                for side in range(2):
                    other = col + step if side else col - step
                    if 0 <= other <= columns + 1:
                        d = down[row, other]
                        square = min(square, d * d + step * step)
                step += 1
            deepest = max(deepest, square)
    return deepest
