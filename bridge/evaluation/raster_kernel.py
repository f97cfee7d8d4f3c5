"""Loops over the cells of a raster, compiled: shapes stamped on it, pieces, and distances."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]
    Labels = NDArray[np.int32]
    Wide = NDArray[np.int64]

_EDGE = -1e-12
"""A point on a triangle's edge is in it, to rounding."""


@compiled
def capsule(  # noqa: PLR0913, PLR0917 - a kernel takes numbers
    mask: Mask,
    xs: Floats,
    ys: Floats,
    row0: int,
    row1: int,
    col0: int,
    col1: int,
    ax: float,
    ay: float,
    ex: float,
    ey: float,
    radius: float,
) -> None:
    """Set the points within ``radius`` of the segment from (ax, ay) on by (ex, ey).

    Rows and columns from 0 up to 1, half open, hold all that can be.
    """
    square = ex * ex + ey * ey
    for row in range(row0, row1):
        for col in range(col0, col1):
            x, y = xs[row, col] - ax, ys[row, col] - ay
            if square > 0.0:
                along = min(max((x * ex + y * ey) / square, 0.0), 1.0)
                x -= along * ex
                y -= along * ey
            if x * x + y * y <= radius * radius:
                mask[row, col] = True


@compiled
def sweep(  # noqa: PLR0913, PLR0917 - a kernel takes numbers
    times: Floats,
    xs: Floats,
    ys: Floats,
    row0: int,
    row1: int,
    col0: int,
    col1: int,
    corners: Floats,
    edges: Floats,
    time_s: float,
) -> None:
    """Note a time for the points in either of two triangles that have a later one or none.

    Rows and columns are as in :func:`capsule`; ``corners`` has a row for each triangle: x, y of
    its three corners, in either orientation; ``edges``, (2, 3, 4), is room.
    """
    for t in range(2):
        a = corners[t]
        area = (a[2] - a[0]) * (a[5] - a[1]) - (a[3] - a[1]) * (a[4] - a[0])
        sign = 1.0 if area >= 0.0 else -1.0
        for k in range(3):
            px, py, qx, qy = a[2 * k], a[2 * k + 1], a[(2 * k + 2) % 6], a[(2 * k + 3) % 6]
            edges[t, k, 0], edges[t, k, 1] = px, py
            edges[t, k, 2], edges[t, k, 3] = sign * (qx - px), sign * (qy - py)
    for row in range(row0, row1):
        for col in range(col0, col1):
            if times[row, col] <= time_s:
                continue
            for t in range(2):
                inside = True
                for k in range(3):
                    e = edges[t, k]
                    if e[2] * (ys[row, col] - e[1]) - e[3] * (xs[row, col] - e[0]) < _EDGE:
                        inside = False
                        break
                if inside:
                    times[row, col] = time_s
                    break


def pieces(mask: Mask, reach: int) -> tuple[Labels, int]:
    """Number the connected pieces of a mask from 1, in the order of their first cells.

    ``reach`` 1: cells that share a side are connected; 2: those that share a corner as well.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    stack = np.empty((mask.size, 2), dtype=np.int32)
    return labels, number_pieces(np.ascontiguousarray(mask), reach, labels, stack)


@compiled
def number_pieces(mask: Mask, reach: int, labels: Labels, stack: Labels) -> int:
    """Do what :func:`pieces` says; ``labels`` begins with zeros, ``stack`` is room."""
    rows, columns = mask.shape
    count = 0
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
                row, col = stack[top]
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


def deepest(mask: Mask) -> float:
    """Greatest distance (cells) of a cell of the mask from the nearest outside it.

    Exact, in two passes (Meijster, Roerdink, Hesselink 2000); what is beyond the raster counts
    as outside.
    """
    rows, columns = mask.shape
    down = np.zeros((rows + 2, columns + 2), dtype=np.int64)
    return math.sqrt(deepest_square(np.ascontiguousarray(mask), down))


@compiled
def deepest_square(mask: Mask, down: Wide) -> int:
    """Do what :func:`deepest` says, squared; ``down`` has a rim of zeros around the mask's size."""
    rows, columns = mask.shape
    for col in range(1, columns + 1):
        for row in range(1, rows + 1):
            down[row, col] = down[row - 1, col] + 1 if mask[row - 1, col - 1] else 0
        for row in range(rows, 0, -1):
            down[row, col] = min(down[row, col], down[row + 1, col] + 1)
    most = 0
    for row in range(1, rows + 1):
        for col in range(1, columns + 1):
            reach = down[row, col]
            square = reach * reach
            if square <= most:
                continue  # no nearer cell beside it can make this one the deepest
            step = 1
            while step * step < square:
                for other in (col - step, col + step):
                    if 0 <= other <= columns + 1:
                        d = down[row, other]
                        square = min(square, d * d + step * step)
                step += 1
            most = max(most, square)
    return most
