"""The map of the dashboard: swept floor, path, room and robot in half-block characters."""

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

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.run.snapshot import Snapshot

_MARGIN_M = 0.1
"""Margin around everything that is drawn, m."""
_FINEST_M = 0.02
"""Minimum size of a map cell, m. Smaller cells show no more detail of the swept floor."""
_ARROWS = "→↗↑↖←↙↓↘"
"""Symbols of the robot by its heading, in steps of 45° from the x axis."""


def swept_picture(
    host: Snapshot,
    columns: int = 56,
    rows: int = 40,
    trail: Iterable[tuple[float, float]] = (),
    plan: FloorPlan | None = None,
) -> Text:
    """Draw swept floor, path and robot, with the y axis up; the robot is an arrow.

    Args:
        host: state of the run.
        columns: maximum width, characters.
        rows: maximum height, half lines.
        trail: positions of the path, m.
        plan: room whose walls, obstacles, cliffs, carpets and thresholds are drawn too.

    """
    pose = host.estimator.pose
    path = np.array([*trail, (pose.x_m, pose.y_m)])
    swept = _swept(host)
    shown = np.vstack([path, swept])
    if plan is not None:
        shown = np.vstack([shown, np.array(plan.walls)])
    low, high = shown.min(axis=0) - _MARGIN_M, shown.max(axis=0) + _MARGIN_M
    extent = high - low
    size_m = max(extent[0] / max(8, columns), extent[1] / max(8, rows), _FINEST_M)
    wide = min(columns, max(1, math.ceil(extent[0] / size_m)))
    tall = max(1, math.ceil(extent[1] / size_m))
    tall += tall % 2
    cells = np.zeros((tall, wide), dtype=np.int8)
    lines = [] if plan is None else _room_points(plan, size_m)
    soft = [(points, ink) for points, ink in lines if ink in {_CARPET, _THRESHOLD}]
    hard = [(points, ink) for points, ink in lines if ink in {_WALL, _CLIFF}]
    for points, ink in ((swept, _SWEPT), *soft, (path, _PATH), *hard):
        at = ((points - low) / size_m).astype(int)
        cells[np.clip(at[:, 1], 0, tall - 1), np.clip(at[:, 0], 0, wide - 1)] = ink
    robot = ((path[-1] - low) / size_m).astype(int)
    return _half_blocks(cells, (int(robot[1]), int(robot[0])), pose.theta_rad)


def _swept(host: Snapshot) -> NDArray[np.float64]:
    """Return the centres of the swept cells, m, as an array of shape (n, 2)."""
    grid = host.swept.to_occupancy()
    marked = np.argwhere(grid.cells == 0)[:, ::-1]
    origin = np.array((grid.origin_x_m, grid.origin_y_m))
    return np.asarray((marked + 0.5) * grid.resolution_m + origin, dtype=np.float64)


def _room_points(plan: FloorPlan, size_m: float) -> list[tuple[NDArray[np.float64], int]]:
    """Return points along every edge of the room, half a cell apart, and the ink of each edge."""
    polygons = [
        (plan.walls, _WALL),
        *((obstacle, _WALL) for obstacle in plan.obstacles),
        *((cliff, _CLIFF) for cliff in plan.cliffs),
        *((carpet.polygon, _CARPET) for carpet in plan.carpets),
    ]
    edges = [
        (a, b, ink)
        for polygon, ink in polygons
        for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True)
    ]
    edges += [(bar.begin, bar.end, _THRESHOLD) for bar in plan.thresholds]
    found = []
    for a, b, ink in edges:
        count = math.ceil(math.dist(a, b) / (0.5 * size_m)) + 1
        found.append((np.linspace(a, b, count, dtype=np.float64), ink))
    return found


_SWEPT, _PATH, _WALL, _CLIFF, _CARPET, _THRESHOLD = range(1, 7)
_INK = {
    _SWEPT: "green",
    _PATH: "cyan",
    _WALL: "white",
    _CLIFF: "red",
    _CARPET: "magenta",
    _THRESHOLD: "yellow",
}


def legend(plan: FloorPlan | None, width: int) -> list[Text]:
    """Return the legend of the map in lines of at most ``width`` characters.

    It lists only the kinds of objects that the room contains.
    """
    shown = [("swept", _SWEPT), ("path", _PATH)]
    if plan is not None:
        shown.append(("walls", _WALL))
        shown += [("cliff", _CLIFF)] if plan.cliffs else []
        shown += [("carpet", _CARPET)] if plan.carpets else []
        shown += [("threshold", _THRESHOLD)] if plan.thresholds else []
    lines = [Text()]
    for name, ink in shown:
        part = Text.assemble(("█", _INK[ink]), f" {name}")
        if lines[-1] and len(lines[-1]) + 2 + len(part) > width:
            lines.append(Text())
        lines[-1].append("  " if lines[-1] else "").append_text(part)
    return lines


def _half_blocks(cells: NDArray[np.int8], robot: tuple[int, int], theta_rad: float) -> Text:
    arrow = _ARROWS[round(theta_rad / (math.pi / 4)) % 8]
    text = Text(no_wrap=True)
    for row in range(cells.shape[0] - 1, 0, -2):
        pairs = zip(cells[row].tolist(), cells[row - 1].tolist(), strict=True)
        glyphs = [_GLYPHS[pair] for pair in pairs]
        if robot[0] in {row, row - 1}:
            glyphs[min(robot[1], len(glyphs) - 1)] = (arrow, "bold yellow")
        # One span for each run of equal style: a span for each cell would double the drawing time.
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


_GLYPHS = {(above, below): _glyph(above, below) for above in range(7) for below in range(7)}
"""Character and style by the ink of the upper and the lower half; 0: nothing."""
