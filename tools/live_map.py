"""The map of the live picture: swept floor, the way so far, and the robot, in half blocks."""

from __future__ import annotations

import math
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from bridge.host import Host

_MARGIN_M, _FINEST_M = 0.1, 0.02
_ARROWS = "→↗↑↖←↙↓↘"


def swept_picture(
    host: Host,
    columns: int = 56,
    rows: int = 40,
    trail: Iterable[tuple[float, float]] = (),
) -> Text:
    """The swept map and the way in half blocks, north up, the robot an arrow where it looks.

    At most ``columns`` wide, ``rows`` half lines high.
    """
    pose = host.estimator.pose
    way = np.array([*trail, (pose.x_m, pose.y_m)])
    swept = _swept(host)
    seen = np.vstack([way, swept])
    low, high = seen.min(axis=0) - _MARGIN_M, seen.max(axis=0) + _MARGIN_M
    extent = high - low
    size_m = max(extent[0] / max(8, columns), extent[1] / max(8, rows), _FINEST_M)
    wide = min(columns, max(1, math.ceil(extent[0] / size_m)))
    tall = max(1, math.ceil(extent[1] / size_m))
    tall += tall % 2
    cells = np.zeros((tall, wide), dtype=np.int8)
    for points, ink in ((swept, 1), (way, 2)):
        at = ((points - low) / size_m).astype(int)
        cells[np.clip(at[:, 1], 0, tall - 1), np.clip(at[:, 0], 0, wide - 1)] = ink
    robot = ((way[-1] - low) / size_m).astype(int)
    return _half_blocks(cells, (int(robot[1]), int(robot[0])), pose.theta_rad)


def _swept(host: Host) -> NDArray[np.float64]:
    """Centres of the swept cells, x and y, metres."""
    grid = host.swept.to_occupancy()
    marked = np.argwhere(grid.cells == 0)[:, ::-1]
    origin = np.array((grid.origin_x_m, grid.origin_y_m))
    return np.asarray((marked + 0.5) * grid.resolution_m + origin, dtype=np.float64)


_INK = {1: "green", 2: "cyan"}


def _half_blocks(cells: NDArray[np.int8], robot: tuple[int, int], theta_rad: float) -> Text:
    arrow = _ARROWS[round(theta_rad / (math.pi / 4)) % 8]
    text = Text(no_wrap=True)
    for row in range(cells.shape[0] - 1, 0, -2):
        pairs = zip(cells[row].tolist(), cells[row - 1].tolist(), strict=True)
        glyphs = [_GLYPHS[pair] for pair in pairs]
        if robot[0] in {row, row - 1}:
            glyphs[min(robot[1], len(glyphs) - 1)] = (arrow, "bold yellow")
        # Stretches of one style: a span for each cell would cost most of the drawing.
        for style, run in groupby(glyphs, key=itemgetter(1)):
            text.append("".join(glyph for glyph, _ in run), style=style or None)
        text.append("\n")
    return text


def _glyph(above: int, below: int) -> tuple[str, str]:
    if above == below:
        return ("█", _INK[above]) if above else (" ", "")
    if above and below:
        return "▀", f"{_INK[above]} on {_INK[below]}"
    return "▀" if above else "▄", _INK[above or below]


_GLYPHS = {(above, below): _glyph(above, below) for above in range(3) for below in range(3)}
"""By what is above and below; 0: nothing."""
