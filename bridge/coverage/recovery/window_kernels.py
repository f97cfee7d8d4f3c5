"""Compiled images of a window of the map: passable cells, unswept cells, perimeters."""

# The kernels are long loops over numbers. Smaller functions would be clearer, but their calls and
# objects would cost too much time.
# ruff: noqa: C901, PLR0913, PLR0917

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
from cython.cimports.libc.math import atan2, fabs, sqrt

from bridge.coverage.recovery.evidence_kernels import SURE

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import IntGrid, Ints, Layer

_PI = cython.declare(cython.double, math.pi)
_SURE = cython.declare(cython.int, SURE)
_SWEPT = cython.declare(cython.int, 1)
_GIVEN_UP = cython.declare(cython.int, 2)
_OCCUPIED = cython.declare(cython.int, 4)
SWEPT, GIVEN_UP, OCCUPIED = _SWEPT, _GIVEN_UP, _OCCUPIED
"""Bits that show why a cell needs no sweeping."""
_CELL = cython.declare(cython.int, 8)
_MAX_WEIGHT = cython.declare(cython.int, 255)
CELL_WEIGHT = _CELL
"""Weight of a target in a large piece of unswept floor. Weights are whole numbers in a byte."""


@cython.final
@cython.cclass
class PerimeterCosts:
    """Costs and expected gain of a perimeter pass."""

    speed_cm_s = cython.declare(cython.double, visibility="public")
    turn_s_rad = cython.declare(cython.double, visibility="public")
    stop_s = cython.declare(cython.double, visibility="public")
    """Time for each stop, s."""
    cells = cython.declare(cython.double, visibility="public")
    """Number of cells that a perimeter pass is expected to sweep."""
    full_rate = cython.declare(cython.double, visibility="public")
    """Number of cells that the mouth sweeps per second."""
    cost_cm = cython.declare(cython.double, visibility="public")
    """Path length per unit of path cost, cm."""
    near_cost = cython.declare(cython.double, visibility="public")
    """Maximum cost of a path that is not driven before the perimeter pass."""
    transit_share = cython.declare(cython.double, visibility="public")
    """Cost of the path in the comparison of targets, relative to its time."""
    min_rate = cython.declare(cython.double, visibility="public")
    """Minimum number of new cells per second."""
    beside_cells = cython.declare(cython.int, visibility="public")
    """Radius of the floor beside the wall that is searched, cells: half the mouth's width."""

    def __init__(
        self,
        speed_cm_s: cython.double,
        turn_s_rad: cython.double,
        stop_s: cython.double,
        cells: cython.double,
        full_rate: cython.double,
        cell_cm: cython.double,
        near_cost: cython.double,
        beside_cells: cython.int,
        transit_share: cython.double,
        min_rate: cython.double,
    ) -> None:
        """Store each cost.

        ``cell_cm`` is the edge of a cell; the path cost of a cell is ten units.
        """
        self.speed_cm_s, self.turn_s_rad = speed_cm_s, turn_s_rad
        self.stop_s, self.cells, self.full_rate = stop_s, cells, full_rate
        self.cost_cm, self.near_cost = 0.1 * cell_cm, near_cost
        self.beside_cells = beside_cells
        self.transit_share, self.min_rate = transit_share, min_rate


@cython.final
@cython.cclass
class BestPerimeter:
    """The best place so far to begin a perimeter pass."""

    score = cython.declare(cython.double, visibility="public")
    """New cells per second, with the additional cost of the path; 0: no place."""
    rate = cython.declare(cython.double, visibility="public")
    """New cells per second."""
    row = cython.declare(cython.int, visibility="public")
    col = cython.declare(cython.int, visibility="public")
    bearing_rad = cython.declare(cython.double, visibility="public")
    """Bearing of the wall, rad."""

    def __init__(self) -> None:
        """Begin without a place."""
        self.score = self.rate = self.bearing_rad = 0.0
        self.row = self.col = 0


def copy_window(
    inflated: Layer,
    blocked: Layer,
    visited: Layer,
    swept: Layer,
    wall: Layer,
    attempts: Layer,
    max_attempts: cython.int,
    row0: cython.int,
    col0: cython.int,
    open_: Layer,
    done: Layer,
) -> None:
    """Copy the cells that a search needs from a window of the map. Its border becomes impassable.

    ``open_`` is 0 in cells in which the axle cannot be, 1 next to such a cell, and 2 in free cells.
    ``done`` has the bits that show why a cell needs no sweeping.
    """
    rows: cython.int = open_.shape[0]
    cols: cython.int = open_.shape[1]
    r: cython.int
    c: cython.int
    state: cython.int
    sure: cython.int = _SURE
    for r in range(rows):
        i = row0 + r
        for c in range(cols):
            j = col0 + c
            open_[r, c] = 2 if visited[i, j] or not (inflated[i, j] or blocked[i, j]) else 0
            state = 0
            if swept[i, j]:
                state = _SWEPT
            if attempts[i, j] >= max_attempts:
                state |= _GIVEN_UP
            if wall[i, j] >= sure:
                state |= _OCCUPIED
            done[r, c] = state
        open_[r, 0] = 0
        open_[r, cols - 1] = 0
    for c in range(cols):
        open_[0, c] = 0
        open_[rows - 1, c] = 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if open_[r, c] == 2 and (  # noqa: PLR2004 - 2 is a free cell
                open_[r - 1, c] == 0
                or open_[r + 1, c] == 0
                or open_[r, c - 1] == 0
                or open_[r, c + 1] == 0
            ):
                open_[r, c] = 1


def mark_targets(
    dist: IntGrid,
    max_cost: cython.int,
    done: Layer,
    target: Layer,
    paths: IntGrid,
    near_2: cython.int,
) -> cython.int:
    """Mark the cells to sweep, and store the axle's path length to each cell; return their number.

    A cell is a target if it needs sweeping and the mouth can reach it from a reachable place of the
    axle. ``near_2`` is the square of the mouth's reach, cells. ``paths`` is -1 if there is no path.
    """
    near: cython.int = int(sqrt(near_2))
    rows: cython.int = dist.shape[0]
    cols: cython.int = dist.shape[1]
    r: cython.int
    c: cython.int
    count: cython.int = 0
    for r in range(rows):
        for c in range(cols):
            path = dist[r, c]
            if 0 <= path <= max_cost:
                paths[r, c] = path
                fresh: cython.int = 1 if done[r, c] == 0 else 0
                target[r, c] = fresh
                count += fresh
            else:
                paths[r, c] = -1
                target[r, c] = 0
    for r in range(max(near, 1), rows - max(near, 1)):
        for c in range(max(near, 1), cols - max(near, 1)):
            if paths[r, c] < 0 or (
                paths[r - 1, c] >= 0
                and paths[r + 1, c] >= 0
                and paths[r, c - 1] >= 0
                and paths[r, c + 1] >= 0
            ):
                continue
            # only cells at the edge of the reachable area can reach targets outside this area
            for i in range(-near, near + 1):
                for j in range(-near, near + 1):
                    if (
                        i * i + j * j <= near_2
                        and done[r + i, c + j] == 0
                        and target[r + i, c + j] == 0
                    ):
                        target[r + i, c + j] = 1
                        count += 1
    return count


def keep_holes(target: Layer, hole: Layer, width: cython.int) -> cython.int:
    """Keep only targets in pieces into which a disc of a diameter fits; return their number.

    The disc is a block of ``width`` by ``width`` cells, without the cells whose centres are outside
    the disc. ``hole`` is temporary space.
    """
    rows: cython.int = target.shape[0]
    cols: cython.int = target.shape[1]
    r: cython.int
    c: cython.int
    i: cython.int
    j: cython.int
    whole: cython.bint
    for r in range(rows):
        for c in range(cols):
            hole[r, c] = 0
    for r in range(rows - width + 1):
        for c in range(cols - width + 1):
            whole = True
            for n in range(width * width):
                i, j = 2 * (n // width) - width + 1, 2 * (n % width) - width + 1
                if i * i + j * j <= width * width and not target[r + n // width, c + n % width]:
                    whole = False
                    break
            if whole:
                for n in range(width * width):
                    i, j = n // width, n % width
                    hole[r + i, c + j] = target[r + i, c + j]
    count: cython.int = 0
    for r in range(rows):
        for c in range(cols):
            target[r, c] = hole[r, c]
            kept: cython.int = int(hole[r, c])
            count += kept
    return count


def weigh_pieces(
    target: Layer,
    open_: Layer,
    done: Layer,
    paths: IntGrid,
    queue: Ints,
    return_cells: cython.double,
    small_cells: cython.int,
    min_cells: cython.int,
) -> None:
    """Replace each target by its weight: ``CELL_WEIGHT``, and more in a small piece.

    The robot must return to each piece of unswept floor that it leaves. So the targets of a piece
    together weigh ``return_cells`` more than their number. A piece with fewer than ``small_cells``
    targets weighs proportionally less, because the robot may not return to it. A piece with fewer
    than ``min_cells`` targets has no additional weight, and neither has a piece that continues
    beyond the searched area. ``queue`` is temporary space for all cells.
    """
    rows: cython.int = target.shape[0]
    cols: cython.int = target.shape[1]
    r: cython.int
    c: cython.int
    y: cython.int
    x: cython.int
    k: cython.int
    count: cython.int
    weight: cython.int
    whole: cython.bint
    # Use local copies, because compiled code reads a module variable again after each array store.
    cell_weight: cython.int = _CELL
    max_weight: cython.int = _MAX_WEIGHT
    for r in range(rows):
        for c in range(cols):
            if target[r, c] != 1:
                continue
            queue[0] = r * cols + c
            target[r, c] = 2
            count = 1
            k = 0
            whole = True
            while k < count:
                cell = queue[k]
                y = cell // cols
                x = cell % cols
                k += 1
                # the cells at the window's border count as impassable
                if y < 2 or x < 2 or y >= rows - 2 or x >= cols - 2:  # noqa: PLR2004 - beside it
                    whole = False
                if y == 0 or x == 0 or y == rows - 1 or x == cols - 1:
                    continue
                for i in range(-1, 2):
                    for j in range(-1, 2):
                        if target[y + i, x + j] == 1:
                            target[y + i, x + j] = 2
                            queue[count] = cell + i * cols + j
                            count += 1
                        elif (
                            target[y + i, x + j] == 0
                            and paths[y + i, x + j] < 0
                            and open_[y + i, x + j] > 0
                            and done[y + i, x + j] == 0
                        ):
                            whole = False
            weight = cell_weight
            if whole and count >= min_cells:
                more = return_cells / max(count, small_cells)
                weight = min(int(cell_weight * (1.0 + more) + 0.5), max_weight)
            for k in range(count):
                cell = queue[k]
                target[cell // cols, cell % cols] = weight


@cython.cdivision(False)  # noqa: FBT003 - a directive: an angle's remainder has Python's sign
def scan_perimeters(
    open_: Layer,
    paths: IntGrid,
    done: Layer,
    here_row: cython.double,
    here_col: cython.double,
    heading: cython.double,
    costs: PerimeterCosts,
    best: BestPerimeter,
) -> None:
    """Find the best place to begin a perimeter pass: at a wall with an unswept strip."""
    rows: cython.int = open_.shape[0]
    cols: cython.int = open_.shape[1]
    r: cython.int
    c: cython.int
    fresh: cython.int
    seen: cython.int
    path: cython.double
    near: cython.int = costs.beside_cells
    for r in range(near + 1, rows - near - 1):
        for c in range(near + 1, cols - near - 1):
            if open_[r, c] != 1 or paths[r, c] < 0 or done[r, c] & _SWEPT:
                continue
            fresh = seen = 0
            wall_x = wall_y = 0.0
            for i in range(-near, near + 1):
                for j in range(-near, near + 1):
                    if i * i + j * j > near * near:
                        continue
                    if open_[r + i, c + j] == 0:
                        wall_x += j
                        wall_y += i
                    seen += 1
                    if not done[r + i, c + j] & (_SWEPT | _GIVEN_UP):
                        fresh += 1
            # at least seven tenths of the floor beside the wall must be unswept
            if fresh * 10 < seen * 7 or (wall_x == 0.0 and wall_y == 0.0):
                continue
            path = paths[r, c]
            time = path * costs.cost_cm / costs.speed_cm_s + 2.0 * costs.stop_s
            time += costs.cells / costs.full_rate
            bearing = atan2(r + 0.5 - here_row, c + 0.5 - here_col)
            if path > costs.near_cost:
                off = fabs((bearing - heading + _PI) % (2.0 * _PI) - _PI)
                time += off * costs.turn_s_rad
            rate = costs.cells / time
            if rate < costs.min_rate:
                continue
            far = max(path - costs.near_cost, 0.0) * costs.cost_cm / costs.speed_cm_s
            score = costs.cells / (time + (costs.transit_share - 1.0) * far)
            if score > best.score:
                best.score = score
                best.rate = rate
                best.row = r
                best.col = c
                best.bearing_rad = atan2(wall_y, wall_x)
