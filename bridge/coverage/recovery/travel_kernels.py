"""Where the axle can go, how far that is, and the way there, compiled."""

# Kernels are long loops over plain numbers: a call out of them, or an object into them, costs more
# than it explains.
# ruff: noqa: C901, PLR0912, PLR0913, PLR0917

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.int32]

STRAIGHT, DIAGONAL = 10, 14
"""Cost of a step between cells; a cell is 2 cm."""
TIGHT = 3
"""A step next to where the axle cannot be costs this many times more."""


@compiled
def passable(near: Layer, lens: Layer, been: Layer, open_: Layer) -> None:
    """0: the axle cannot be there, 1: beside such a place, 2: free."""
    rows, cols = near.shape
    for r in range(rows):
        for c in range(cols):
            free = been[r, c] or not (near[r, c] or lens[r, c])
            open_[r, c] = 2 if free else 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if open_[r, c] != 2:  # noqa: PLR2004 - free
                continue
            if (
                open_[r - 1, c] == 0
                or open_[r + 1, c] == 0
                or open_[r, c - 1] == 0
                or open_[r, c + 1] == 0
            ):
                open_[r, c] = 1


@compiled
def travel(open_: Layer, row: int, col: int, most: int, dist: Ints, queue: Ints) -> int:
    """Shortest ways from a cell, up to ``most``; -1 where not reached.

    Dial's buckets in a ring: steps cost at most 42. ``queue`` has a row per bucket, its first
    column how many are in it.
    Returns the number of cells reached.
    """
    rows, cols = open_.shape
    ring, room = queue.shape
    for r in range(rows):
        for c in range(cols):
            dist[r, c] = -1
    for slot in range(ring):
        queue[slot, 0] = 0
    dist[row, col] = 0
    queue[0, 1] = row * cols + col
    queue[0, 0] = 1
    waiting = 1
    reached = 0
    level = 0
    while waiting > 0 and level <= most:
        slot = level % ring
        k = 0
        while k < queue[slot, 0]:
            k += 1
            cell = queue[slot, k]
            waiting -= 1
            r, c = cell // cols, cell % cols
            if dist[r, c] != level:
                continue
            reached += 1
            for i in range(-1, 2):
                for j in range(-1, 2):
                    if i == 0 and j == 0:
                        continue
                    rr, cc = r + i, c + j
                    if rr < 0 or rr >= rows or cc < 0 or cc >= cols:
                        continue
                    kind = open_[rr, cc]
                    if kind == 0:
                        continue
                    cost = STRAIGHT if i == 0 or j == 0 else DIAGONAL
                    if kind == 1:
                        cost *= TIGHT
                    total = level + cost
                    old = dist[rr, cc]
                    if old < 0 or total < old:
                        spot = total % ring
                        if queue[spot, 0] + 1 >= room:
                            continue
                        dist[rr, cc] = total
                        queue[spot, 0] += 1
                        queue[spot, queue[spot, 0]] = rr * cols + cc
                        waiting += 1
        queue[slot, 0] = 0
        level += 1
    # what is beyond ``most`` was only touched: take it back
    for r in range(rows):
        for c in range(cols):
            if dist[r, c] > most:
                dist[r, c] = -1
    return reached


@compiled
def _clear_line(open_: Layer, r0: int, c0: int, r1: int, c1: int, least: int) -> bool:
    """Whether every cell on a straight line is at least ``least`` (1 passable, 2 free)."""
    steps = max(abs(r1 - r0), abs(c1 - c0)) * 2
    if steps == 0:
        return True
    for k in range(steps + 1):
        r = int(r0 + 0.5 + (r1 - r0) * k / steps)
        c = int(c0 + 0.5 + (c1 - c0) * k / steps)
        if open_[r, c] < least:
            return False
    return True


@compiled
def way_back(  # noqa: PLR0913, PLR0917 - layers, a cell and room
    open_: Layer, dist: Ints, row: int, col: int, out: Ints, cells: Ints
) -> int:
    """Corners of the way from where ``dist`` begins to a cell, ends included.

    Returns their number, 0 if the cell was not reached or the way has too many corners.
    ``cells`` is room for the way's cells; a longer way counts as one not reached.
    """
    rows, cols = open_.shape
    if dist[row, col] < 0:
        return 0
    room = out.shape[0]
    n = 0
    r, c = row, col
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
    # from the start (the last cell) on, always to the farthest cell in a free straight line
    k = n - 1
    count = 0
    while True:
        if count >= room:
            return 0
        out[count, 0], out[count, 1] = cells[k] // cols, cells[k] % cols
        count += 1
        if k == 0:
            return count
        nearest = k - 1
        for least in range(2, 0, -1):
            m = k - 1
            reach = k - 1
            while m >= 0:
                if _clear_line(
                    open_,
                    cells[k] // cols,
                    cells[k] % cols,
                    cells[m] // cols,
                    cells[m] % cols,
                    least,
                ):
                    reach = m
                elif m < k - 4 and reach > m + 12:
                    break
                m -= 1
            if reach < nearest:
                nearest = reach
                break
        k = nearest
