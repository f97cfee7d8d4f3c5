"""A window of the map as a search needs it: what is open, what is left, outlines; compiled."""

# Kernels are long loops over plain numbers: a call out of them, or an object into them, costs more
# than it explains.
# ruff: noqa: C901, PLR0913, PLR0917

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.int32]
    Floats = NDArray[np.float64]

SWEPT, GIVEN_UP, OCCUPIED = 1, 2, 4
"""Why a cell is done with: bits."""


@compiled
def copy_window(
    near: Layer,
    lens: Layer,
    been: Layer,
    swept: Layer,
    wall: Layer,
    tried: Layer,
    tries: int,
    row0: int,
    col0: int,
    open_: Layer,
    done: Layer,
) -> None:
    """What a search needs of a window of the map, its rim shut.

    ``open_``: 0 the axle cannot be there, 1 beside such a place, 2 free. ``done``: why there is
    nothing to sweep, as bits.
    """
    rows, cols = open_.shape
    for r in range(rows):
        i = row0 + r
        for c in range(cols):
            j = col0 + c
            open_[r, c] = 2 if been[i, j] or not (near[i, j] or lens[i, j]) else 0
            state = 0
            if swept[i, j]:
                state = SWEPT
            if tried[i, j] >= tries:
                state |= GIVEN_UP
            if wall[i, j] > 1:
                state |= OCCUPIED
            done[r, c] = state
        open_[r, 0] = 0
        open_[r, cols - 1] = 0
    for c in range(cols):
        open_[0, c] = 0
        open_[rows - 1, c] = 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if open_[r, c] == 2 and (  # noqa: PLR2004 - free
                open_[r - 1, c] == 0
                or open_[r + 1, c] == 0
                or open_[r, c - 1] == 0
                or open_[r, c + 1] == 0
            ):
                open_[r, c] = 1


@compiled
def mark_targets(dist: Ints, most: int, done: Layer, target: Layer, ways: Ints) -> int:
    """What is worth sweeping, and how far the axle has to go; the number of targets.

    A cell is a target if nothing is done with it and it is within the mouth's half width (three
    and a half cells) of where the axle can be. ``ways``: -1 where it cannot.
    """
    rows, cols = dist.shape
    count = 0
    for r in range(rows):
        for c in range(cols):
            way = dist[r, c]
            if 0 <= way <= most:
                ways[r, c] = way
                target[r, c] = done[r, c] == 0
                count += target[r, c]
            else:
                ways[r, c] = -1
                target[r, c] = 0
    for r in range(3, rows - 3):
        for c in range(3, cols - 3):
            if ways[r, c] < 0 or (
                ways[r - 1, c] >= 0
                and ways[r + 1, c] >= 0
                and ways[r, c - 1] >= 0
                and ways[r, c + 1] >= 0
            ):
                continue
            # only the reach of a cell at the edge goes beyond what was counted above
            for i in range(-3, 4):
                for j in range(-3, 4):
                    if (
                        i * i + j * j <= 12  # noqa: PLR2004 - 3.5 cells, squared
                        and done[r + i, c + j] == 0
                        and target[r + i, c + j] == 0
                    ):
                        target[r + i, c + j] = 1
                        count += 1
    return count


@compiled
def keep_holes(target: Layer, hole: Layer) -> int:
    """Leave of the targets those of pieces into which a disc of 4 cm fits; their number.

    It is looked for as a block of four by four cells (of 2 cm) without its corners. ``hole`` is
    room for the result.
    """
    rows, cols = target.shape
    for r in range(rows):
        for c in range(cols):
            hole[r, c] = 0
    for r in range(rows - 3):
        for c in range(cols - 3):
            there = 0
            for n in range(16):
                if n // 4 % 3 or n % 4 % 3:
                    there += target[r + n // 4, c + n % 4]
            if there == 12:  # noqa: PLR2004 - all but the corners
                for n in range(16):
                    hole[r + n // 4, c + n % 4] = target[r + n // 4, c + n % 4]
    count = 0
    for r in range(rows):
        for c in range(cols):
            target[r, c] = hole[r, c]
            count += hole[r, c]
    return count


@compiled
def scan_outlines(
    open_: Layer,
    ways: Ints,
    done: Layer,
    here_row: float,
    here_col: float,
    heading: float,
    prices: Floats,
    best: Floats,
) -> None:
    """The best place beside a wall whose band was not swept, to begin following it.

    ``best``: score, row, column, bearing of the wall. ``prices``: cm/s, s/rad, s per stop, the
    cells that an outline promises.
    """
    rows, cols = open_.shape
    for r in range(5, rows - 5):
        for c in range(5, cols - 5):
            if open_[r, c] != 1 or ways[r, c] < 0 or done[r, c] & SWEPT:
                continue
            fresh = seen = 0
            wall_x = wall_y = 0.0
            for i in range(-4, 5):
                for j in range(-4, 5):
                    if i * i + j * j > 16:  # noqa: PLR2004 - the mouth's half width in cells
                        continue
                    if open_[r + i, c + j] == 0:
                        wall_x += j
                        wall_y += i
                    seen += 1
                    if not done[r + i, c + j] & (SWEPT | GIVEN_UP):
                        fresh += 1
            if fresh * 10 < seen * 7 or (wall_x == 0.0 and wall_y == 0.0):
                continue
            way = float(ways[r, c])
            time = way * 0.2 / prices[0] + 2.0 * prices[2] + prices[3] / 70.0
            bearing = math.atan2(r + 0.5 - here_row, c + 0.5 - here_col)
            if way > 40.0:  # noqa: PLR2004 - 8 cm
                off = abs((bearing - heading + math.pi) % (2.0 * math.pi) - math.pi)
                time += off * prices[1]
            score = prices[3] / time
            if score > best[0]:
                best[0] = score
                best[1] = r
                best[2] = c
                best[3] = math.atan2(wall_y, wall_x)
