"""Where the axle can go, how far that is, and the way there, compiled."""

# Kernels are long loops over plain numbers: a call out of them, or an object into them, costs more
# than it explains.
# ruff: noqa: C901, PLR0912, PLR0913, PLR0917

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.int32]

STRAIGHT, DIAGONAL = 10, 14
"""Cost of a step between cells; a cell is 2 cm."""
TIGHT = 3
"""A step next to where the axle cannot be costs this many times more."""
RING = 64
"""Buckets of the search: more than the dearest step costs."""
LEVEL, WAITING, TAKEN, COUNTS = 0, 1, 2, 3
"""Places in the search's state; from ``COUNTS`` on, the cells in each bucket."""


@compiled
def travel(
    ground: Layer, cols: int, most: int, budget: int, dist: Ints, queue: Ints, state: Ints
) -> tuple[int, bool]:
    """Go on with the search for shortest ways, up to a cost: cells settled, whether it is done.

    Dial's buckets in a ring. It settles at most ``budget`` cells before it returns, and goes on
    from ``state`` at the next call. Cells with a ``dist`` of more than ``most`` were only
    touched; -1: not even that. The rim must be shut.

    Args:
        ground: ``open_`` as of ``copy_window``, row after row.
        cols: in a row.
        most: cost up to which ways are wanted.
        budget: cells.
        dist: costs so far, row after row; -1 but for a 0 where it begins.
        queue: ``(RING, room)``: the cells of each bucket, flat.
        state: ``(COUNTS + RING,)``; zeros but for one cell waiting in bucket 0.

    """
    room = queue.shape[1]
    level = state[LEVEL]
    k = state[TAKEN]
    waiting = state[WAITING]
    settled = 0
    while waiting > 0 and level <= most:
        slot = level % RING
        while k < state[COUNTS + slot]:
            if settled >= budget:
                state[LEVEL], state[TAKEN], state[WAITING] = level, k, waiting
                return settled, False
            cell = queue[slot, k]
            k += 1
            waiting -= 1
            if dist[cell] != level:
                continue
            settled += 1
            for n in range(9):
                i, j = n // 3 - 1, n % 3 - 1
                there = cell + i * cols + j
                kind = ground[there]
                if kind == 0 or n == 4:  # noqa: PLR2004 - itself
                    continue
                cost = DIAGONAL if i != 0 and j != 0 else STRAIGHT
                if kind == 1:
                    cost *= TIGHT
                total = level + cost
                old = dist[there]
                if old >= 0 and total >= old:
                    continue
                spot = total % RING
                count = state[COUNTS + spot]
                if count < room:
                    dist[there] = total
                    queue[spot, count] = there
                    state[COUNTS + spot] = count + 1
                    waiting += 1
        state[COUNTS + slot] = 0
        k = 0
        level += 1
    state[LEVEL], state[TAKEN], state[WAITING] = level, k, waiting
    return settled, True


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
def way_back(open_: Layer, dist: Ints, row: int, col: int, out: Ints, cells: Ints) -> int:
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
