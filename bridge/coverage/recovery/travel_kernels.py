"""Compiled search for shortest paths of the axle over passable cells."""

# The kernels are long loops over numbers. Smaller functions would be clearer, but their calls and
# objects would cost too much time.
# ruff: noqa: C901, PLR0912, PLR0913, PLR0917

from __future__ import annotations

from typing import TYPE_CHECKING

import cython

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import Bytes, IntGrid, Ints, Layer

_STRAIGHT = cython.declare(cython.int, 10)
_DIAGONAL = cython.declare(cython.int, 14)
_TIGHT = cython.declare(cython.int, 3)
_RING = cython.declare(cython.int, 64)
STRAIGHT = _STRAIGHT
"""Cost of a straight step between cells. A diagonal step costs ``_DIAGONAL``. A step next to a cell
in which the axle cannot be costs ``_TIGHT`` times as much."""
RING = _RING
"""Number of buckets of the search: a power of two that is larger than the maximum cost of a
step."""


@cython.final
@cython.cclass
class TravelSearch:
    """State of a path search."""

    level = cython.declare(cython.int, visibility="public")
    """Path cost of the bucket that is being processed."""
    waiting = cython.declare(cython.int, visibility="public")
    """Number of waiting cells in all buckets."""
    taken = cython.declare(cython.int, visibility="public")
    """Number of processed cells in the bucket ``level``."""

    def __init__(self) -> None:
        """Begin before the first cell."""
        self.level = self.waiting = self.taken = 0


def travel(
    ground: Bytes,
    cols: cython.int,
    max_cost: cython.int,
    budget: cython.int,
    dist: Ints,
    queue: IntGrid,
    counts: Ints,
    search: TravelSearch,
) -> tuple[int, bool]:
    """Continue the search for shortest paths; return the number of settled cells and completion.

    The algorithm is Dial's, with a ring of buckets. A cell is settled when its path cost is final.
    One call settles at most ``budget`` cells. The next call continues with ``search``. A cell with
    a ``dist`` above ``max_cost`` has only a preliminary cost; -1 means that no path is known. The
    cells at the border of the window must not be passable.

    Args:
        ground: ``open_`` from ``copy_window``, row by row.
        cols: Number of cells in a row.
        max_cost: Maximum cost of a path; the search ends there.
        budget: Maximum number of cells that are settled.
        dist: Path costs so far, row by row. Initially 0 at the start and -1 elsewhere.
        queue: ``(RING, room)``: the cells of each bucket, as flat indices.
        counts: ``(RING,)``: the number of cells in each bucket. Initially 1 in bucket 0, else 0.
        search: State of the search. Initially it has one waiting cell.

    """
    room: cython.int = queue.shape[1]
    level: cython.int = search.level
    k: cython.int = search.taken
    waiting: cython.int = search.waiting
    settled: cython.int = 0
    there: cython.int
    cost: cython.int
    i: cython.int
    j: cython.int
    # Use local copies, because compiled code reads a module variable again after each array store.
    straight: cython.int = _STRAIGHT
    diagonal: cython.int = _DIAGONAL
    tight: cython.int = _TIGHT
    last_bucket: cython.int = _RING - 1
    while waiting > 0 and level <= max_cost:
        slot = level & last_bucket
        while k < counts[slot]:
            if settled >= budget:
                search.level, search.taken, search.waiting = level, k, waiting
                return settled, False
            cell = queue[slot, k]
            k += 1
            waiting -= 1
            if dist[cell] != level:
                continue
            settled += 1
            for i in range(-1, 2):
                for j in range(-1, 2):
                    there = cell + i * cols + j
                    kind = ground[there]
                    if kind == 0 or (i == 0 and j == 0):
                        continue
                    cost = diagonal if i != 0 and j != 0 else straight
                    if kind == 1:
                        cost *= tight
                    total = level + cost
                    old = dist[there]
                    if old >= 0 and total >= old:
                        continue
                    spot = total & last_bucket
                    count = counts[spot]
                    if count < room:
                        dist[there] = total
                        queue[spot, count] = there
                        counts[spot] = count + 1
                        waiting += 1
        counts[slot] = 0
        k = 0
        level += 1
    search.level, search.taken, search.waiting = level, k, waiting
    return settled, True


@cython.ccall
@cython.exceptval(check=False)
def clear_line(
    open_: Layer,
    r0: cython.int,
    c0: cython.int,
    r1: cython.int,
    c1: cython.int,
    min_kind: cython.int,
) -> cython.bint:
    """Return True if every cell on a line is at least ``min_kind`` (1 passable, 2 free)."""
    down: cython.int = r1 - r0
    right: cython.int = c1 - c0
    steps: cython.int = max(abs(down), abs(right)) * 2
    if steps == 0:
        return True
    count: cython.double = steps
    r: cython.int
    c: cython.int
    k: cython.int
    for k in range(steps + 1):
        r = int(r0 + 0.5 + down * k / count)
        c = int(c0 + 0.5 + right * k / count)
        if open_[r, c] < min_kind:
            return False
    return True


def trace_path(
    open_: Layer, dist: IntGrid, row: cython.int, col: cython.int, out: IntGrid, cells: Ints
) -> cython.int:
    """Write the corners of the shortest path from the start of ``dist`` to a cell, with both ends.

    Return the number of corners; 0: no path to the cell, or too many corners or cells. ``cells`` is
    temporary space for the cells of the path.
    """
    rows: cython.int = open_.shape[0]
    cols: cython.int = open_.shape[1]
    if dist[row, col] < 0:
        return 0
    room: cython.int = out.shape[0]
    r: cython.int = row
    c: cython.int = col
    br: cython.int
    bc: cython.int
    rr: cython.int
    cc: cython.int
    best: cython.int
    n: cython.int = 0
    while n < cells.shape[0]:
        cells[n] = r * cols + c
        n += 1
        if dist[r, c] == 0:
            break
        best = dist[r, c]
        br, bc = r, c
        for i in range(-1, 2):
            for j in range(-1, 2):
                rr, cc = r + i, c + j
                if 0 <= rr < rows and 0 <= cc < cols and 0 <= dist[rr, cc] < best:
                    best = dist[rr, cc]
                    br, bc = rr, cc
        if br == r and bc == c:
            return 0
        r, c = br, bc
    # from the start (the last cell): go to the farthest cell that a straight free line reaches
    k: cython.int = n - 1
    count: cython.int = 0
    m: cython.int
    reach: cython.int
    nearest: cython.int
    while True:
        if count >= room:
            return 0
        out[count, 0], out[count, 1] = cells[k] // cols, cells[k] % cols
        count += 1
        if k == 0:
            return count
        nearest = k - 1
        for min_kind in range(2, 0, -1):
            m = k - 1
            reach = k - 1
            while m >= 0:
                if clear_line(
                    open_,
                    cells[k] // cols,
                    cells[k] % cols,
                    cells[m] // cols,
                    cells[m] % cols,
                    min_kind,
                ):
                    reach = m
                elif m < k - 4 and reach > m + 12:
                    break
                m -= 1
            if reach < nearest:
                nearest = reach
                break
        k = nearest
