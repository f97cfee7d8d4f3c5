"""Update of the evidence map with one observation, compiled.

Each layer is an array with one byte per cell and the shape (rows, columns), so y is before x:

- ``swept``: the mouth has passed the cell's centre.
- ``wall``: number of contacts and echoes in the cell, minus the number of beams that passed through
  the cell. The cell counts as occupied if this value is ``SURE`` or more.
- ``inflated``: number of occupied cells within the footprint's radius. If it is not 0, the axle
  cannot be in the cell.
- ``blocked``: a bump showed that the axle cannot be in the cell.
- ``visited``: the axle was in the cell. This overrides ``inflated`` and ``blocked``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython
from cython.cimports.libc.math import cos, hypot, sin, sqrt

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import Layer

_SURE = cython.declare(cython.int, 2)
_MAX_EVIDENCE = cython.declare(cython.int, 6)
SURE = _SURE
"""Minimum evidence of an occupied cell."""
MAX_EVIDENCE = _MAX_EVIDENCE
"""Maximum evidence that is stored. This number of beams removes all evidence of a cell."""


@cython.cfunc
@cython.exceptval(check=False)
def _first(at: cython.double) -> cython.int:
    """Return the first row or column of a range that begins at position ``at``."""
    index: cython.int = int(at)
    return max(index, 0)


@cython.cfunc
@cython.exceptval(check=False)
def _last(at: cython.double, count: cython.Py_ssize_t) -> cython.int:
    """Return the exclusive end of a range of rows or columns that ends at position ``at``."""
    index: cython.int = int(at) + 1
    return min(index, count)


@cython.cfunc
@cython.exceptval(check=False)
def _square(x: cython.double, y: cython.double) -> cython.double:
    return x * x + y * y


@cython.ccall
@cython.exceptval(check=False)
def add_wall(  # noqa: PLR0913, PLR0917 - layers and a cell
    wall: Layer,
    inflated: Layer,
    row: cython.int,
    col: cython.int,
    weight: cython.int,
    reach: cython.double,
) -> cython.void:
    """Add evidence to a cell. ``reach`` is the radius of the inflation, cells."""
    rows, cols = wall.shape[0], wall.shape[1]
    if row < 0 or row >= rows or col < 0 or col >= cols:
        return
    before: cython.int = int(wall[row, col])
    after: cython.int = min(max(before + weight, 0), _MAX_EVIDENCE)
    wall[row, col] = after
    step = 0
    if before < _SURE <= after:
        step = 1
    elif after < _SURE <= before:
        step = -1
    if step == 0:
        return
    whole: cython.int = int(reach)
    limit = reach * reach
    for i in range(-whole, whole + 1):
        r = row + i
        if r < 0 or r >= rows:
            continue
        for j in range(-whole, whole + 1):
            c = col + j
            if 0 <= c < cols and i * i + j * j <= limit:
                count: cython.int = int(inflated[r, c])
                inflated[r, c] = count + step


def sweep(  # noqa: PLR0913, PLR0917 - two poses in cells
    swept: Layer,
    x0: cython.double,
    y0: cython.double,
    th0: cython.double,
    x1: cython.double,
    y1: cython.double,
    th1: cython.double,
    half: cython.double,
    ahead: cython.double,
) -> int:
    """Mark the cells that the mouth passes between two near poses; return the number of new cells.

    The mouth passes a cell if the cell's centre is ahead of it at one pose and behind it at the
    other.
    """
    rows, cols = swept.shape[0], swept.shape[1]
    c0, s0 = cos(th0), sin(th0)
    c1, s1 = cos(th1), sin(th1)
    x0 += ahead * c0
    y0 += ahead * s0
    x1 += ahead * c1
    y1 += ahead * s1
    path = hypot(x1 - x0, y1 - y0)
    xm, ym = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    cm, sm = 0.5 * (c0 + c1), 0.5 * (s0 + s1)
    span = half + 0.5 * path + 1.0
    new = 0
    top, bottom = _first(ym - span), _last(ym + span, rows)
    first, last = _first(xm - span), _last(xm + span, cols)
    for r in range(top, bottom):
        dy0, dy1, dym = r + 0.5 - y0, r + 0.5 - y1, r + 0.5 - ym
        for c in range(first, last):
            if swept[r, c]:
                continue
            f0 = (c + 0.5 - x0) * c0 + dy0 * s0
            f1 = (c + 0.5 - x1) * c1 + dy1 * s1
            if f0 * f1 > 0.0:
                continue
            if abs(dym * cm - (c + 0.5 - xm) * sm) <= half:
                swept[r, c] = 1
                new += 1
    return new


def clear_body(  # noqa: PLR0913, PLR0917 - layers and a pose in cells
    wall: Layer,
    inflated: Layer,
    visited: Layer,
    x: cython.double,
    y: cython.double,
    inner: cython.double,
    reach: cython.double,
) -> None:
    """Remove evidence inside the footprint, and mark the axle's cell as visited."""
    rows, cols = wall.shape[0], wall.shape[1]
    row: cython.int = int(y)
    col: cython.int = int(x)
    if 0 <= row < rows and 0 <= col < cols:
        visited[row, col] = 1
    limit = inner * inner
    top, bottom = _first(y - inner), _last(y + inner, rows)
    first, last = _first(x - inner), _last(x + inner, cols)
    for r in range(top, bottom):
        dy = r + 0.5 - y
        for c in range(first, last):
            dx = c + 0.5 - x
            if wall[r, c] and dy * dy + dx * dx < limit:
                add_wall(wall, inflated, r, c, -_MAX_EVIDENCE, reach)


def beam(  # noqa: PLR0913, PLR0917 - layers and a ray in cells
    wall: Layer,
    inflated: Layer,
    x: cython.double,
    y: cython.double,
    dx: cython.double,
    dy: cython.double,
    free: cython.double,
    hit: cython.double,
    weight: cython.int,
    reach: cython.double,
) -> None:
    """Update the cells on a beam: ``free`` cells are free, the cell at ``hit`` gets ``weight``."""
    rows, cols = wall.shape[0], wall.shape[1]
    t = 0.0
    r: cython.int
    c: cython.int
    last_r: cython.int = -1
    last_c: cython.int = -1
    while t < free:
        r, c = int(y + t * dy), int(x + t * dx)
        if (r != last_r or c != last_c) and 0 <= r < rows and 0 <= c < cols:
            if wall[r, c]:
                add_wall(wall, inflated, r, c, -1, reach)
            last_r, last_c = r, c
        t += 0.5
    if weight:
        add_wall(wall, inflated, int(y + hit * dy), int(x + hit * dx), weight, reach)


def bump_area(  # noqa: PLR0913, PLR0917 - a layer and three contact points in cells
    blocked: Layer,
    x: cython.double,
    y: cython.double,
    low: cython.double,
    high: cython.double,
    reach: cython.double,
) -> None:
    """Block cells where the axle cannot be, for any contact bearing from ``low`` to ``high``."""
    rows, cols = blocked.shape[0], blocked.shape[1]
    mid = 0.5 * (low + high)
    ax, ay = x + reach * cos(low), y + reach * sin(low)
    bx, by = x + reach * cos(mid), y + reach * sin(mid)
    cx, cy = x + reach * cos(high), y + reach * sin(high)
    limit = (reach - 0.2) * (reach - 0.2)
    top, bottom = _first(y - reach), _last(y + reach, rows)
    first, last = _first(x - reach), _last(x + reach, cols)
    for r in range(top, bottom):
        py = r + 0.5
        for c in range(first, last):
            px = c + 0.5
            if (
                _square(px - ax, py - ay) < limit
                and _square(px - bx, py - by) < limit
                and _square(px - cx, py - cy) < limit
            ):
                blocked[r, c] = 1


def fresh_ahead(  # noqa: PLR0913, PLR0917 - a layer and a pose in cells
    swept: Layer,
    x: cython.double,
    y: cython.double,
    th: cython.double,
    start: cython.double,
    stop: cython.double,
    low: cython.double,
    high: cython.double,
) -> float:
    """Return the unswept share of a strip ahead, between ``start`` and ``stop`` cells from a pose.

    ``low`` and ``high`` are the lateral limits of the strip, left positive.
    """
    rows, cols = swept.shape[0], swept.shape[1]
    c, s = cos(th), sin(th)
    seen = fresh = 0
    row: cython.int
    col: cython.int
    t = start
    while t <= stop:
        u = low
        while u <= high:
            row, col = int(y + t * s + u * c), int(x + t * c - u * s)
            if 0 <= row < rows and 0 <= col < cols:
                seen += 1
                if not swept[row, col]:
                    fresh += 1
            u += 1.0
        t += 1.0
    share: cython.double = fresh
    return share / max(seen, 1)


def speed_limit_m_s(  # noqa: PLR0913, PLR0917 - a layer, a pose in cells, limits
    wall: Layer,
    x: cython.double,
    y: cython.double,
    th: cython.double,
    cell: cython.double,
    rim: cython.double,
    right: cython.double,
    left: cython.double,
    touch: cython.double,
    decel: cython.double,
    latency: cython.double,
    fast: cython.double,
) -> float:
    """Return the maximum forward speed (m/s) at which every contact is slower than ``touch``.

    The formula is that of :func:`bridge.motion.control.hidden_ahead.contact_speed`, for each
    occupied cell. The robot brakes with ``decel`` after ``latency``. ``cell`` is the length of a
    cell's edge, m. ``rim`` is the footprint's radius plus half a cell, m. Cells farther to the side
    than ``right`` or ``left`` (m) do not count.
    """
    rows, cols = wall.shape[0], wall.shape[1]
    c, s = cos(th), sin(th)
    lag_speed = decel * latency
    limit = fast
    # path in which the robot brakes from the top speed to the contact speed
    far = (
        rim + ((lag_speed + fast) * (lag_speed + fast) - lag_speed * lag_speed) / (2.0 * decel)
    ) / cell
    top, bottom = _first(y - far), _last(y + far, rows)
    begin, end = _first(x - far), _last(x + far, cols)
    for row in range(top, bottom):
        for col in range(begin, end):
            if wall[row, col] < _SURE:
                continue
            dx, dy = (col + 0.5 - x) * cell, (row + 0.5 - y) * cell
            ahead, aside = dx * c + dy * s, dy * c - dx * s
            if ahead <= 0.0 or aside >= left or -aside >= right or abs(aside) >= rim:
                continue
            reach = sqrt(rim * rim - aside * aside)
            soft = touch * rim / reach
            path = max(ahead - reach, 0.0)
            speed = sqrt((lag_speed + soft) * (lag_speed + soft) + 2.0 * decel * path) - lag_speed
            limit = min(limit, max(speed, soft))
    return limit
