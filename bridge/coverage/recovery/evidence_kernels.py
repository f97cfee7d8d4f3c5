"""What one observation does to the evidence map, compiled.

Layers, all of shape (rows, columns), y then x, one byte a cell:

- ``swept``: the mouth went over the cell's centre.
- ``wall``: how often something was met there, less how often a beam passed; from ``SURE`` on
  the cell counts as occupied.
- ``near``: number of occupied cells within the body's radius: where the axle cannot be.
- ``lens``: where a bump says the axle cannot be.
- ``been``: the axle was there. It overrules the two layers above.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Layer = NDArray[np.uint8]

SURE = 2
"""Evidence that makes a cell occupied."""
MOST = 6
"""Evidence is not counted beyond: so many beams through a cell free it again."""


@compiled
def add_wall(  # noqa: PLR0913, PLR0917 - layers and a cell
    wall: Layer, near: Layer, row: int, col: int, weight: int, reach: float
) -> None:
    """Add evidence to a cell; ``reach``: the body's radius in cells, less a margin."""
    rows, cols = wall.shape
    if row < 0 or row >= rows or col < 0 or col >= cols:
        return
    before = int(wall[row, col])
    after = min(max(before + weight, 0), MOST)
    wall[row, col] = after
    step = 0
    if before < SURE <= after:
        step = 1
    elif after < SURE <= before:
        step = -1
    if step == 0:
        return
    whole = int(reach)
    limit = reach * reach
    for i in range(-whole, whole + 1):
        r = row + i
        if r < 0 or r >= rows:
            continue
        for j in range(-whole, whole + 1):
            c = col + j
            if 0 <= c < cols and i * i + j * j <= limit:
                near[r, c] = near[r, c] + step


@compiled
def sweep(  # noqa: PLR0913, PLR0917 - two poses in cells
    swept: Layer,
    x0: float,
    y0: float,
    th0: float,
    x1: float,
    y1: float,
    th1: float,
    half: float,
    ahead: float,
) -> int:
    """Mark the cells whose centre the mouth passes between two near poses; count the new ones.

    A centre is passed where it lies before the mouth at one pose and behind it at the other.
    """
    rows, cols = swept.shape
    c0, s0 = math.cos(th0), math.sin(th0)
    c1, s1 = math.cos(th1), math.sin(th1)
    x0 += ahead * c0
    y0 += ahead * s0
    x1 += ahead * c1
    y1 += ahead * s1
    way = math.hypot(x1 - x0, y1 - y0)
    xm, ym = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    cm, sm = 0.5 * (c0 + c1), 0.5 * (s0 + s1)
    span = half + 0.5 * way + 1.0
    new = 0
    for r in range(max(int(ym - span), 0), min(int(ym + span) + 1, rows)):
        dy0, dy1, dym = r + 0.5 - y0, r + 0.5 - y1, r + 0.5 - ym
        for c in range(max(int(xm - span), 0), min(int(xm + span) + 1, cols)):
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


@compiled
def clear_body(  # noqa: PLR0913, PLR0917 - layers and a pose in cells
    wall: Layer, near: Layer, been: Layer, x: float, y: float, inner: float, reach: float
) -> None:
    """The axle is here, so nothing is inside the body's disc."""
    rows, cols = wall.shape
    row, col = int(y), int(x)
    if 0 <= row < rows and 0 <= col < cols:
        been[row, col] = 1
    limit = inner * inner
    for r in range(max(int(y - inner), 0), min(int(y + inner) + 1, rows)):
        dy = r + 0.5 - y
        for c in range(max(int(x - inner), 0), min(int(x + inner) + 1, cols)):
            if wall[r, c] and dy * dy + (c + 0.5 - x) ** 2 < limit:
                add_wall(wall, near, r, c, -MOST, reach)


@compiled
def beam(  # noqa: PLR0913, PLR0917 - layers and a ray in cells
    wall: Layer,
    near: Layer,
    x: float,
    y: float,
    dx: float,
    dy: float,
    free: float,
    hit: float,
    weight: int,
    reach: float,
) -> None:
    """A beam passed ``free`` cells along (dx, dy); at ``hit`` it met something, if ``weight``."""
    rows, cols = wall.shape
    t = 0.0
    last_r = last_c = -1
    while t < free:
        r, c = int(y + t * dy), int(x + t * dx)
        if (r != last_r or c != last_c) and 0 <= r < rows and 0 <= c < cols:
            if wall[r, c]:
                add_wall(wall, near, r, c, -1, reach)
            last_r, last_c = r, c
        t += 0.5
    if weight:
        add_wall(wall, near, int(y + hit * dy), int(x + hit * dx), weight, reach)


@compiled
def bump_lens(  # noqa: PLR0913, PLR0917 - a layer and three contact points in cells
    lens: Layer, x: float, y: float, low: float, high: float, reach: float
) -> None:
    """The axle cannot be where any contact between the bearings ``low`` and ``high`` forbids it."""
    rows, cols = lens.shape
    mid = 0.5 * (low + high)
    ax, ay = x + reach * math.cos(low), y + reach * math.sin(low)
    bx, by = x + reach * math.cos(mid), y + reach * math.sin(mid)
    cx, cy = x + reach * math.cos(high), y + reach * math.sin(high)
    limit = (reach - 0.2) ** 2
    for r in range(max(int(y - reach), 0), min(int(y + reach) + 1, rows)):
        py = r + 0.5
        for c in range(max(int(x - reach), 0), min(int(x + reach) + 1, cols)):
            px = c + 0.5
            if (
                (px - ax) ** 2 + (py - ay) ** 2 < limit
                and (px - bx) ** 2 + (py - by) ** 2 < limit
                and (px - cx) ** 2 + (py - cy) ** 2 < limit
            ):
                lens[r, c] = 1


@compiled
def fresh_ahead(  # noqa: PLR0913, PLR0917 - a layer and a pose in cells
    swept: Layer,
    x: float,
    y: float,
    th: float,
    start: float,
    stop: float,
    low: float,
    high: float,
) -> float:
    """Share that is not swept of the way straight on from ``start`` to ``stop`` cells.

    ``low`` and ``high`` bound the strip across, left positive.
    """
    rows, cols = swept.shape
    c, s = math.cos(th), math.sin(th)
    seen = fresh = 0
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
    return fresh / max(seen, 1)


@compiled
def pace(  # noqa: PLR0913, PLR0917 - a layer, a pose in cells, limits
    wall: Layer,
    x: float,
    y: float,
    th: float,
    cell: float,
    rim: float,
    right: float,
    left: float,
    touch: float,
    decel: float,
    latency: float,
    fast: float,
) -> float:
    """Fastest forward speed (m/s) that meets no occupied cell harder than ``touch`` head on.

    Braking with ``decel`` after ``latency``. ``cell``: its edge; ``rim``: the body's radius and
    half a cell; what lies farther aside than ``right`` or ``left`` does not count (m).
    """
    rows, cols = wall.shape
    c, s = math.cos(th), math.sin(th)
    push = decel * latency
    most = fast
    # from the top speed to a touch
    far = (rim + ((push + fast) ** 2 - push * push) / (2.0 * decel)) / cell
    for row in range(max(int(y - far), 0), min(int(y + far) + 1, rows)):
        for col in range(max(int(x - far), 0), min(int(x + far) + 1, cols)):
            if wall[row, col] < SURE:
                continue
            dx, dy = (col + 0.5 - x) * cell, (row + 0.5 - y) * cell
            ahead, aside = dx * c + dy * s, dy * c - dx * s
            if ahead <= 0.0 or aside >= left or -aside >= right or abs(aside) >= rim:
                continue
            reach = math.sqrt(rim * rim - aside * aside)
            soft = touch * rim / reach
            way = max(ahead - reach, 0.0)
            speed = math.sqrt((push + soft) ** 2 + 2.0 * decel * way) - push
            most = min(most, max(speed, soft))
    return most
