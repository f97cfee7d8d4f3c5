"""The lanes that are left, priced by what they sweep per time, compiled.

Lanes are looked for in images of the map turned to the lanes' direction, row by row.
"""

# Kernels are long loops over plain numbers: a call out of them, or an object into them, costs more
# than it explains.
# ruff: noqa: C901, PLR0912, PLR0913, PLR0917

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


@compiled
def turn_images(
    target_in: Layer,
    ways_in: Ints,
    angle: float,
    origin_x: float,
    origin_y: float,
    target: Layer,
    ways: Ints,
) -> None:
    """Images turned by ``angle`` about an origin in cells."""
    rows, cols = target.shape
    map_rows, map_cols = target_in.shape
    c, s = math.cos(angle), math.sin(angle)
    for r in range(rows):
        for k in range(cols):
            x = origin_x + (k + 0.5) * c - (r + 0.5) * s
            y = origin_y + (k + 0.5) * s + (r + 0.5) * c
            i, j = int(y), int(x)
            if y >= 0.0 and x >= 0.0 and i < map_rows and j < map_cols:
                ways[r, k] = ways_in[i, j]
                target[r, k] = target_in[i, j]
            else:
                ways[r, k] = -1
                target[r, k] = 0


@compiled
def _judge(
    best: Floats,
    row: int,
    first: int,
    last: int,
    backwards: int,
    new: float,
    edges: float,
    way: float,
    bearing: float,
    prices: Floats,
    heading: float,
) -> None:
    """Price one candidate and keep it if it is the best so far."""
    speed, turn_s_rad, stop_s, frontier, lane_heading = (
        prices[0],
        prices[1],
        prices[2],
        prices[3],
        prices[4],
    )
    length = (last - first + 1) * 2.0
    direction = lane_heading + (math.pi if backwards else 0.0)
    time = (way * 0.2 + length) / speed + stop_s
    if way > 40.0:  # noqa: PLR2004 - 8 cm: there is a way to go first
        off = abs((bearing - heading + math.pi) % (2.0 * math.pi) - math.pi)
        off2 = abs((direction - bearing + math.pi) % (2.0 * math.pi) - math.pi)
        time += (off + off2) * turn_s_rad + stop_s
    else:
        off = abs((direction - heading + math.pi) % (2.0 * math.pi) - math.pi)
        time += off * turn_s_rad
    score = (new - frontier * edges) / time
    if score > best[0]:
        best[0] = score
        best[1] = row
        best[2] = first
        best[3] = last
        best[4] = backwards
        best[5] = new
        best[6] = way
        best[7] = time


@compiled
def scan_lanes(
    target: Layer,
    ways: Ints,
    least: int,
    gap: int,
    half: int,
    here_row: float,
    here_col: float,
    heading: float,
    prices: Floats,
    best: Floats,
    sums: Ints,
) -> None:
    """The best straight lane along the rows, judged by new cells per time.

    ``best`` holds the best so far. ``prices``: cm/s, s/rad, s per stop, cells per edge of
    frontier, heading of the rows (in the frame of ``heading``).
    ``sums`` is room for a number a column.
    """
    rows, cols = target.shape
    for k in range(cols):
        sums[k] = 0
    for r in range(min(2 * half, rows)):
        for k in range(cols):
            sums[k] += target[r, k]
    for r in range(half, rows - half - 1):
        for k in range(cols):
            sums[k] += target[r + half, k]
            if r - half - 1 >= 0:
                sums[k] -= target[r - half - 1, k]
        k = 0
        while k < cols:
            if ways[r, k] < 0 or sums[k] == 0:
                k += 1
                continue
            first = last = k
            new = 0
            edges = 0
            while k < cols and ways[r, k] >= 0 and k - last <= gap:
                if sums[k] > 0:
                    last = k
                    new += sums[k]
                    for side in range(2):
                        rim = r + half if side else r - half
                        out = r + half + 1 if side else r - half - 1
                        if out < 0 or out >= rows or not target[rim, k]:
                            continue
                        edges += 1 if target[out, k] else -1
                k += 1
            if new < least:
                continue
            for backwards in range(2):
                begin = last if backwards else first
                bearing = prices[4] + math.atan2(r + 0.5 - here_row, begin + 0.5 - here_col)
                _judge(
                    best,
                    r,
                    first,
                    last,
                    backwards,
                    new,
                    edges,
                    float(ways[r, begin]),
                    bearing,
                    prices,
                    heading,
                )
