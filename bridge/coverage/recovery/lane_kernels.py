"""Compiled search for the best remaining lane: the largest swept area per time.

The search uses images of the map. They are rotated so that their rows are parallel to the lanes.
"""

# The kernels are long loops over numbers. Smaller functions would be clearer, but their calls and
# objects would cost too much time.
# ruff: noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
from cython.cimports.libc.math import atan2, cos, fabs, sin

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import IntGrid, Layer

_PI = cython.declare(cython.double, math.pi)


@cython.final
@cython.cclass
class LaneCosts:
    """Costs and limits in the rating of a lane."""

    speed_cm_s = cython.declare(cython.double, visibility="public")
    """Speed on the lane and on the path to the lane, cm/s."""
    turn_s_rad = cython.declare(cython.double, visibility="public")
    stop_s = cython.declare(cython.double, visibility="public")
    """Time for each stop, s."""
    frontier = cython.declare(cython.double, visibility="public")
    """Cost per cell edge of new frontier that the lane creates, cells."""
    heading_rad = cython.declare(cython.double, visibility="public")
    """Direction of the image's rows relative to the main direction of the walls, rad."""
    cell_cm = cython.declare(cython.double, visibility="public")
    """Edge of a cell, cm."""
    cost_cm = cython.declare(cython.double, visibility="public")
    """Path length per unit of path cost, cm."""
    near_cost = cython.declare(cython.double, visibility="public")
    """Maximum cost of a path that is not driven before the lane."""
    min_cells = cython.declare(cython.int, visibility="public")
    """Minimum number of new cells for a lane."""
    gap_cells = cython.declare(cython.int, visibility="public")
    """Maximum number of swept cells within the lane."""
    rows = cython.declare(cython.int, visibility="public")
    """Number of rows that the lane sweeps. If it is even, the axle drives between two rows."""
    transit_share = cython.declare(cython.double, visibility="public")
    """Cost of the path to the lane in the comparison of targets, relative to its time."""
    min_rate = cython.declare(cython.double, visibility="public")
    """Minimum number of new cells per second."""
    cell_weight = cython.declare(cython.int, visibility="public")
    """Weight of a target in a large piece of unswept floor."""
    ahead_cells = cython.declare(cython.int, visibility="public")
    """Distance of the mouth ahead of the axle, cells."""

    def __init__(
        self,
        speed_cm_s: cython.double,
        turn_s_rad: cython.double,
        stop_s: cython.double,
        frontier: cython.double,
        heading_rad: cython.double,
        cell_cm: cython.double,
        near_cost: cython.double,
        min_cells: cython.int,
        gap_cells: cython.int,
        rows: cython.int,
        transit_share: cython.double,
        min_rate: cython.double,
        cell_weight: cython.int,
        ahead_cells: cython.int = 0,
    ) -> None:
        """Store each cost and size. The path cost of one cell is ten units."""
        self.speed_cm_s, self.turn_s_rad, self.stop_s = speed_cm_s, turn_s_rad, stop_s
        self.frontier, self.heading_rad = frontier, heading_rad
        self.cell_cm, self.cost_cm, self.near_cost = cell_cm, 0.1 * cell_cm, near_cost
        self.min_cells, self.gap_cells, self.rows = min_cells, gap_cells, rows
        self.transit_share, self.min_rate = transit_share, min_rate
        self.cell_weight, self.ahead_cells = cell_weight, ahead_cells


@cython.final
@cython.cclass
class BestLane:
    """The best lane so far."""

    score = cython.declare(cython.double, visibility="public")
    """Weight of the new cells per second, minus the cost of the frontier, with the additional cost
    of the path; 0: no lane."""
    rate = cython.declare(cython.double, visibility="public")
    """New cells per second, minus the cost of the frontier."""
    row = cython.declare(cython.int, visibility="public")
    """Middle row, or the row after the middle."""
    first = cython.declare(cython.int, visibility="public")
    """First column of the axle. ``last`` is the last column of the axle."""
    last = cython.declare(cython.int, visibility="public")
    backwards = cython.declare(cython.bint, visibility="public")
    """True if the lane begins at ``last``."""
    new = cython.declare(cython.int, visibility="public")
    """Number of new cells."""

    def __init__(self) -> None:
        """Begin without a lane."""
        self.score = self.rate = 0.0
        self.row = self.first = self.last = self.new = 0
        self.backwards = False


def turn_images(
    target_in: Layer,
    paths_in: IntGrid,
    angle: cython.double,
    origin_x: cython.double,
    origin_y: cython.double,
    target: Layer,
    paths: IntGrid,
) -> None:
    """Rotate images by ``angle``, rad, about an origin, given in cells.

    Path lengths are path costs; outside the window they are -1, and targets are 0.
    """
    rows, cols = target.shape[0], target.shape[1]
    map_rows, map_cols = target_in.shape[0], target_in.shape[1]
    i: cython.Py_ssize_t
    j: cython.Py_ssize_t
    c, s = cos(angle), sin(angle)
    for r in range(rows):
        for k in range(cols):
            x = origin_x + (k + 0.5) * c - (r + 0.5) * s
            y = origin_y + (k + 0.5) * s + (r + 0.5) * c
            i, j = int(y), int(x)
            if y >= 0.0 and x >= 0.0 and i < map_rows and j < map_cols:
                paths[r, k] = paths_in[i, j]
                target[r, k] = target_in[i, j]
            else:
                paths[r, k] = -1
                target[r, k] = 0


@cython.cfunc
@cython.cdivision(False)  # noqa: FBT003 - a directive: an angle's remainder has Python's sign
@cython.exceptval(check=False)
def _between(a: cython.double, b: cython.double) -> cython.double:
    """Return the absolute angle between two headings, rad."""
    return fabs((a - b + _PI) % (2.0 * _PI) - _PI)


@cython.cfunc
@cython.exceptval(check=False)
def _judge(
    best: BestLane,
    row: cython.int,
    first: cython.int,
    last: cython.int,
    backwards: cython.bint,
    new: cython.int,
    weight: cython.double,
    edges: cython.int,
    path: cython.double,
    bearing: cython.double,
    costs: LaneCosts,
    heading: cython.double,
) -> cython.void:
    """Rate one candidate and store it if it is the best so far.

    ``weight`` is the weight of the new cells, in cells.
    """
    length = (last - first + 1) * costs.cell_cm
    direction = costs.heading_rad + (_PI if backwards else 0.0)
    time = (path * costs.cost_cm + length) / costs.speed_cm_s + costs.stop_s
    if path > costs.near_cost:  # the robot must first drive a path to the lane
        off = _between(bearing, heading)
        off2 = _between(direction, bearing)
        time += (off + off2) * costs.turn_s_rad + costs.stop_s
    else:
        time += _between(direction, heading) * costs.turn_s_rad
    rate = (new - costs.frontier * edges) / time
    if rate < costs.min_rate:
        return
    if path > costs.near_cost:
        far = (path - costs.near_cost) * costs.cost_cm / costs.speed_cm_s
        time += (costs.transit_share - 1.0) * far
    score = (weight - costs.frontier * edges) / time
    if score > best.score:
        best.score = score
        best.rate = rate
        best.row = row
        best.first = first
        best.last = last
        best.backwards = backwards
        best.new = new


def scan_lanes(
    target: Layer,
    paths: IntGrid,
    here_row: cython.double,
    here_col: cython.double,
    heading: cython.double,
    costs: LaneCosts,
    best: BestLane,
    sums: IntGrid,
) -> None:
    """Find the straight lane along the rows with the largest weight of new cells per time.

    ``target`` has a weight for each cell, 0: no target. ``best`` contains the best lane so far.
    ``sums`` is a temporary array with two numbers per column: new cells, and their weight.
    ``here_row`` and ``here_col`` are the robot's place. ``heading`` is its heading relative to the
    main direction of the walls, rad.
    """
    rows: cython.int = target.shape[0]
    cols: cython.int = target.shape[1]
    below: cython.int = costs.rows // 2
    above: cython.int = (costs.rows - 1) // 2
    gap: cython.int = costs.gap_cells
    r: cython.int
    k: cython.int
    first: cython.int
    last: cython.int
    new: cython.int
    weight: cython.int
    edges: cython.int
    fresh: cython.int
    begin: cython.int
    end: cython.int
    back: cython.int
    behind: cython.int
    step: cython.int
    j: cython.int
    unit: cython.double = 1.0 / costs.cell_weight
    for k in range(cols):
        sums[0, k] = sums[1, k] = 0
    for r in range(min(below + above, rows)):
        for k in range(cols):
            sums[0, k] += 1 if target[r, k] else 0
            sums[1, k] += target[r, k]
    for r in range(below, rows - above - 1):
        for k in range(cols):
            sums[0, k] += 1 if target[r + above, k] else 0
            sums[1, k] += target[r + above, k]
            if r - below - 1 >= 0:
                sums[0, k] -= 1 if target[r - below - 1, k] else 0
                sums[1, k] -= target[r - below - 1, k]
        k = 0
        while k < cols:
            if paths[r, k] < 0 or sums[0, k] == 0:
                k += 1
                continue
            first = last = k
            new = 0
            weight = 0
            edges = 0
            while k < cols and paths[r, k] >= 0 and k - last <= gap:
                if sums[0, k] > 0:
                    last = k
                    new += sums[0, k]
                    weight += sums[1, k]
                    for side in range(2):
                        rim = r + above if side else r - below
                        out = r + above + 1 if side else r - below - 1
                        if out < 0 or out >= rows or not target[rim, k]:
                            continue
                        if not target[out, k]:
                            edges -= 1
                        elif paths[r + 1 if side else r - 1, k] >= 0:
                            edges += 1  # a lane farther out would avoid this frontier
                k += 1
            if new < costs.min_cells:
                continue
            for backwards in range(2):
                # the mouth is ahead of the axle, so both ends of the axle's path are farther back
                step = -1 if backwards else 1
                begin = last if backwards else first
                end = first if backwards else last
                fresh = new
                back = 0
                while (
                    back < costs.ahead_cells
                    and 0 <= begin - step < cols
                    and paths[r, begin - step] >= 0
                ):
                    begin -= step
                    back += 1
                for j in range(costs.ahead_cells - back):
                    behind = (last if backwards else first) + step * j
                    if first <= behind <= last:
                        fresh -= sums[0, behind]
                if fresh < costs.min_cells:
                    continue
                end -= step * costs.ahead_cells
                ahead = atan2(r + 0.5 - here_row, begin + 0.5 - here_col)
                _judge(
                    best,
                    r,
                    min(begin, end),
                    max(begin, end),
                    backwards == 1,
                    fresh,
                    unit * weight + fresh - new,
                    edges,
                    paths[r, begin],
                    costs.heading_rad + ahead,
                    costs,
                    heading,
                )
