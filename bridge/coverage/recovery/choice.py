"""What to do next: of all lanes and outlines left, the one that sweeps most per time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery.lane_kernels import scan_lanes, scan_outlines, turn_images
from bridge.coverage.recovery.travel_kernels import STRAIGHT, passable, travel, way_back

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.coverage.recovery.evidence import EvidenceMap
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.geometry import Pose2

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.int32]
    Floats = NDArray[np.float64]

Point = tuple[float, float]

_QUARTER = 0.5 * math.pi
_ENOUGH = 60
"""Cost per cell of a box's half girth beyond which nothing in it is farther."""
_RING, _ROOM = 64, 16384
_CORNERS = 400
_WAY = 8192
"""Cells of the longest way: five times across the largest room."""
_SNAP_CELLS = 6


@dataclass(frozen=True, slots=True)
class Choice:
    """A lane or an outline to begin, and how to get there."""

    kind: str
    """``lane`` or ``outline``."""
    way: tuple[Point, ...]
    """Corners of the way to the beginning, the robot's place left out."""
    heading_rad: float
    """Of the lane; of an outline: along the wall."""
    length_m: float
    new_m2: float
    rate_m2_s: float
    wall_left: bool = False
    """Of an outline: the side of the wall."""


@dataclass(slots=True)
class _View:
    """A window of the map, as whole arrays, and the search's results in it."""

    row0: int
    col0: int
    swept: Layer
    wall: Layer
    near: Layer
    lens: Layer
    been: Layer
    tried: Layer
    open: Layer
    dist: Ints

    @classmethod
    def of(cls, memory: EvidenceMap, window: tuple[int, int, int, int]) -> _View:
        r0, r1, c0, c1 = window
        part = np.s_[r0:r1, c0:c1]
        swept, wall, near, lens, been, tried = (
            np.ascontiguousarray(layer[part])
            for layer in (
                memory.swept,
                memory.wall,
                memory.near,
                memory.lens,
                memory.been,
                memory.tried,
            )
        )
        open_ = np.zeros(swept.shape, dtype=np.uint8)
        dist = np.zeros(swept.shape, dtype=np.int32)
        return cls(r0, c0, swept, wall, near, lens, been, tried, open_, dist)


class Chooser:
    """Looks for the best next thing; owns the search's buffers."""

    def __init__(self, options: RecoveryOptions) -> None:
        """Buffers are made as the map asks for them."""
        self._options = options
        self._queue = np.zeros((_RING, _ROOM), dtype=np.int32)
        self._corners = np.zeros((_CORNERS, 2), dtype=np.int32)
        self._cells = np.zeros(_WAY, dtype=np.int32)
        self.shut_in = False
        """Whether at the last choice the evidence left the robot no place to be."""

    def choose(self, memory: EvidenceMap, pose: Pose2, grid_rad: float) -> Choice | None:
        """The best choice from a pose; ``None``: nothing worth it is reachable."""
        options = self._options
        x, y = memory.to_cells(pose.x_m, pose.y_m)
        choice: Choice | None = None
        r0, r1, c0, c1 = memory.box()
        for most in options.looks:
            reach = most // STRAIGHT
            window = (
                max(r0, int(y) - reach),
                min(r1, int(y) + reach + 1),
                max(c0, int(x) - reach),
                min(c1, int(x) + reach + 1),
            )
            view = _View.of(memory, window)
            passable(view.near, view.lens, view.been, view.open)
            start = _free_cell(view.open, int(y) - view.row0, int(x) - view.col0)
            self.shut_in = start is None
            if start is None:
                return None
            travel(view.open, start[0], start[1], most, view.dist, self._queue)
            choice = self._best(memory, view, pose, grid_rad)
            if choice is not None and choice.rate_m2_s >= options.near_rate * options.cell_m**2:
                break
            if window == (r0, r1, c0, c1) and most >= _ENOUGH * (r1 - r0 + c1 - c0):
                break
        return choice

    # -- inside ------------------------------------------------------------------------------

    def _best(
        self, memory: EvidenceMap, view: _View, pose: Pose2, grid_rad: float
    ) -> Choice | None:
        options = self._options
        speed = options.lane_speed_m_s * 100.0
        x, y = memory.to_cells(pose.x_m, pose.y_m)
        x, y = x - view.col0, y - view.row0
        outline = np.zeros(4)
        prices = np.array([speed, options.turn_s_rad, options.stop_s, options.outline_cells])
        scan_outlines(
            view.open,
            view.near,
            view.lens,
            view.dist,
            view.swept,
            view.tried,
            options.tries,
            y,
            x,
            pose.theta_rad,
            prices,
            outline,
        )
        image = _Turned.of(view, grid_rad, options.tries)
        half = round(memory.half - 0.5)
        best = np.zeros((2, 8))
        for across in range(2):
            prices = np.array(
                [speed, options.turn_s_rad, options.stop_s, options.frontier, across * _QUARTER]
            )
            target, ways = image.rows(across=across)
            scan_lanes(
                target,
                ways,
                options.least_cells,
                options.gap_cells,
                half,
                *image.place(x, y, across=across),
                pose.theta_rad - grid_rad,
                prices,
                best[across],
                np.zeros(target.shape[1], dtype=np.int32),
            )
        score = max(best[0, 0], best[1, 0], outline[0])
        if score < options.least_rate:
            return None
        if outline[0] == score:
            return self._outline(memory, view, outline)
        across = int(best[1, 0] > best[0, 0])
        return self._lane(memory, view, image, best[across], across)

    def _outline(self, memory: EvidenceMap, view: _View, found: Floats) -> Choice:
        area = self._options.cell_m**2
        score, row, col, bearing = found.tolist()
        return Choice(
            "outline",
            self._way(memory, view, int(row), int(col)),
            bearing + _QUARTER,
            0.0,
            self._options.outline_cells * area,
            score * area,
        )

    def _lane(
        self, memory: EvidenceMap, view: _View, image: _Turned, found: Floats, across: int
    ) -> Choice:
        area = self._options.cell_m**2
        score, row, first, last, backwards, new, _, _ = found.tolist()
        begin, end = (last, first) if backwards else (first, last)
        x, y = image.point(row + 0.5, begin + 0.5, across=across)
        heading = image.angle_rad + across * _QUARTER + (math.pi if backwards else 0.0)
        way = self._way(memory, view, int(y), int(x))
        # the lane's own line, not the nearest cell's centre
        begin_m = memory.to_metres(x + view.col0, y + view.row0)
        return Choice(
            "lane",
            (*way[:-1], begin_m),
            heading,
            (abs(end - begin) + 1) * self._options.cell_m,
            new * area,
            score * area,
        )

    def _way(self, memory: EvidenceMap, view: _View, row: int, col: int) -> tuple[Point, ...]:
        count = way_back(view.open, view.dist, row, col, self._corners, self._cells)
        cells = self._corners[1:count].tolist() or [[row, col]]
        return tuple(memory.to_metres(c + view.col0 + 0.5, r + view.row0 + 0.5) for r, c in cells)


@dataclass(slots=True)
class _Turned:
    """A view's targets and ways in a frame turned to the lanes."""

    angle_rad: float
    left: float
    """Of the image's corner in the turned frame, in cells; so ``low``."""
    low: float
    target: Layer
    ways: Ints

    @classmethod
    def of(cls, view: _View, angle_rad: float, tries: int) -> _Turned:
        rows, cols = view.swept.shape
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        corners = [(k * c + r * s, r * c - k * s) for r in (0, rows) for k in (0, cols)]
        left, low = (math.floor(min(p[i] for p in corners)) for i in (0, 1))
        shape = tuple(math.ceil(max(p[i] for p in corners)) - (low, left)[1 - i] for i in (1, 0))
        target, ways, reach = (np.zeros(shape, dtype=kind) for kind in ("u1", "i4", "i4"))
        turn_images(
            view.swept,
            view.wall,
            view.tried,
            tries,
            view.dist,
            angle_rad,
            left * c - low * s,
            left * s + low * c,
            target,
            ways,
            reach,
        )
        return cls(angle_rad, left, low, target, ways)

    def rows(self, *, across: int) -> tuple[Layer, Ints]:
        """The images; ``across``: turned by a further quarter, so that rows run along +v."""
        if not across:
            return self.target, self.ways
        return (
            np.ascontiguousarray(self.target[:, ::-1].T),
            np.ascontiguousarray(self.ways[:, ::-1].T),
        )

    def place(self, x: float, y: float, *, across: int) -> tuple[float, float]:
        """Row and column in the images of a point of the view."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        u, v = x * c + y * s - self.left, y * c - x * s - self.low
        return (self.target.shape[1] - u, v) if across else (v, u)

    def point(self, row: float, column: float, *, across: int) -> tuple[float, float]:
        """Point of the view at a row and a column of the images."""
        u, v = (self.target.shape[1] - row, column) if across else (column, row)
        u, v = u + self.left, v + self.low
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return u * c - v * s, u * s + v * c


def _free_cell(open_: Layer, row: int, col: int) -> tuple[int, int] | None:
    """The passable cell nearest to one."""
    rows, cols = open_.shape
    for reach in range(_SNAP_CELLS + 1):
        for r in range(row - reach, row + reach + 1):
            for c in range(col - reach, col + reach + 1):
                if 0 <= r < rows and 0 <= c < cols and open_[r, c]:
                    return r, c
    return None
