"""Compiled loops over the points of a raster: shapes that the robot sweeps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatBlock, FloatGrid, Layer

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
