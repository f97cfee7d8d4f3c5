"""What to do next: of all lanes and outlines left, the one that sweeps most per time.

The search is cut into slices of bounded work, so that no control step waits for it: on a large
floor the robot stands for some steps while it is under way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.coverage.recovery.lane_kernels import scan_lanes, turn_images
from bridge.coverage.recovery.travel_kernels import (
    COUNTS,
    RING,
    STRAIGHT,
    WAITING,
    travel,
    way_back,
)
from bridge.coverage.recovery.window_kernels import (
    copy_window,
    keep_holes,
    mark_targets,
    scan_outlines,
)

if TYPE_CHECKING:
    from collections.abc import Generator

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
_ROOM = 16384
_CORNERS = 400
_WAY = 8192
"""Cells of the longest way: five times across the largest room."""
_SNAP_CELLS = 6
_COPYING, _MARKING, _TURNING, _SCANNING = 0.2, 0.3, 0.4, 0.3
"""Work per cell of a window, by that of settling one cell in the search for ways."""


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


class _Buffers:
    """Arrays by name, kept between searches: fresh memory costs more than what is done in it."""

    def __init__(self) -> None:
        self._flat: dict[str, NDArray[np.generic]] = {}
        self.queue: Ints = np.zeros((RING, _ROOM), dtype=np.int32)
        self.state: Ints = np.zeros(COUNTS + RING, dtype=np.int32)
        self.corners: Ints = np.zeros((_CORNERS, 2), dtype=np.int32)
        self.way: Ints = np.zeros(_WAY, dtype=np.int32)

    def layer(self, name: str, shape: tuple[int, int]) -> Layer:
        """Bytes of a shape, of any content."""
        return self._get(name, shape, np.uint8)

    def ints(self, name: str, shape: tuple[int, int]) -> Ints:
        """Integers of a shape, of any content."""
        return self._get(name, shape, np.int32)

    def _get(self, name: str, shape: tuple[int, int], kind: type[np.generic]) -> NDArray[Any]:
        size = shape[0] * shape[1]
        flat = self._flat.get(name)
        if flat is None or flat.size < size:
            flat = self._flat[name] = np.zeros(size + size // 4, dtype=kind)
        return flat[:size].reshape(shape)


class _Window:
    """A window of the map as it was when the search began, and what the search found in it."""

    def __init__(
        self,
        memory: EvidenceMap,
        window: tuple[int, int, int, int],
        tries: int,
        buffers: _Buffers,
    ) -> None:
        r0, r1, c0, c1 = window
        shape = (r1 - r0, c1 - c0)
        self.x0_m, self.y0_m = memory.to_metres(c0, r0)
        self.cell_m = memory.to_metres(c0 + 1, r0)[0] - self.x0_m
        self.open = buffers.layer("open", shape)
        self.done = buffers.layer("done", shape)
        self.dist = buffers.ints("dist", shape)
        self.target = buffers.layer("target", shape)
        self.ways = buffers.ints("ways", shape)
        self._buffers = buffers
        self.settled = 0
        copy_window(
            memory.near,
            memory.lens,
            memory.been,
            memory.swept,
            memory.wall,
            memory.tried,
            tries,
            r0,
            c0,
            self.open,
            self.done,
        )

    @property
    def cells(self) -> int:
        """How many."""
        return self.open.size

    def place(self, pose: Pose2) -> tuple[float, float]:
        """Column and row of a pose."""
        return (pose.x_m - self.x0_m) / self.cell_m, (pose.y_m - self.y0_m) / self.cell_m

    def metres(self, column: float, row: float) -> Point:
        """Point at a column and a row with fractions."""
        return self.x0_m + column * self.cell_m, self.y0_m + row * self.cell_m

    def begin(self, start: tuple[int, int]) -> None:
        """Begin the search for ways at a cell."""
        row, col = start
        buffers = self._buffers
        self.dist.fill(-1)
        self.dist[row, col] = 0
        buffers.state.fill(0)
        buffers.state[WAITING] = buffers.state[COUNTS] = 1
        buffers.queue[0, 0] = row * self.dist.shape[1] + col

    def go_on(self, most: int, budget: int) -> bool:
        """Search for ways up to a cost; false: the budget of cells was used up before."""
        self.settled, done = travel(
            self.open.ravel(),
            self.open.shape[1],
            most,
            max(budget, 1),
            self.dist.ravel(),
            self._buffers.queue,
            self._buffers.state,
        )
        return done

    def way(self, row: int, col: int) -> tuple[Point, ...]:
        """Corners of the way to a cell."""
        corners = self._buffers.corners
        count = way_back(self.open, self.ways, row, col, corners, self._buffers.way)
        cells = corners[1:count].tolist() or [[row, col]]
        return tuple(self.metres(c + 0.5, r + 0.5) for r, c in cells)


class Chooser:
    """Looks for the best next thing; owns the search's buffers."""

    def __init__(self, options: RecoveryOptions) -> None:
        """Buffers are made as the map asks for them."""
        self._options = options
        self._buffers = _Buffers()
        self._spent = 0.0
        self.shut_in = False
        """Whether at the last choice the evidence left the robot no place to be."""

    def choose(self, memory: EvidenceMap, pose: Pose2, grid_rad: float) -> Choice | None:
        """The best choice from a pose, in one go; ``None``: nothing worth it is reachable."""
        search = self.search(memory, pose, grid_rad)
        while True:
            try:
                next(search)
            except StopIteration as stop:
                found: Choice | None = stop.value
                return found

    def search(
        self, memory: EvidenceMap, pose: Pose2, grid_rad: float
    ) -> Generator[None, None, Choice | None]:
        """The same in slices: it yields wherever a control step has done enough."""
        options = self._options
        column, row = memory.to_cells(pose.x_m, pose.y_m)
        box = memory.box()
        parts = [_clip(box, int(row), int(column), options.looks[0] // STRAIGHT), box]
        choice: Choice | None = None
        self._spent = 0.0
        for k, most in enumerate(options.looks):
            part = parts[min(k, 1)]
            if k < len(parts):
                yield from self._spend(_COPYING * _size(part))
                window = _Window(memory, part, options.tries, self._buffers)
                x, y = window.place(pose)
                start = _free_cell(window.open, int(y), int(x))
                self.shut_in = start is None
                if start is None:
                    return None
                window.begin(start)
            while not window.go_on(most, int(options.slice_cells - self._spent)):
                self._spent = 0.0
                yield
            self._spent += window.settled
            choice = yield from self._best(window, most, pose, grid_rad, memory.half)
            if choice is not None and choice.rate_m2_s >= options.near_rate * options.cell_m**2:
                break
            if part == box and most >= _ENOUGH * (part[1] - part[0] + part[3] - part[2]):
                break
        if choice is None:
            choice = yield from self._best(window, most, pose, grid_rad, memory.half, holes=True)
        return choice

    # -- inside ------------------------------------------------------------------------------

    def _spend(self, cells: float) -> Generator[None]:
        """Account for work, by the cost of settling so many cells; yield if it is too much."""
        if self._spent and self._spent + cells > self._options.slice_cells:
            self._spent = 0.0
            yield
        self._spent += cells

    def _best(  # noqa: PLR0913 - a window, and from where
        self,
        window: _Window,
        most: int,
        pose: Pose2,
        grid_rad: float,
        half: float,
        *,
        holes: bool = False,
    ) -> Generator[None, None, Choice | None]:
        options = self._options
        least_rate = options.hole_rate if holes else options.least_rate
        speed = options.lane_speed_m_s * 100.0
        x, y = window.place(pose)
        yield from self._spend(_MARKING * window.cells)
        left = mark_targets(window.dist, most, window.done, window.target, window.ways)
        if holes:
            yield from self._spend(_MARKING * window.cells)
            left = keep_holes(window.target, self._buffers.layer("hole", window.target.shape))
        outline = np.zeros(4)
        prices = np.array([speed, options.turn_s_rad, options.stop_s, options.outline_cells])
        scan_outlines(window.open, window.ways, window.done, y, x, pose.theta_rad, prices, outline)
        best = np.zeros((2, 8))
        image: _Turned | None = None
        if left >= options.least_cells:
            yield from self._spend(_TURNING * window.cells)
            image = _Turned(window, grid_rad, self._buffers)
            for across in range(2):
                yield from self._spend(_SCANNING * window.cells)
                prices = np.array(
                    [speed, options.turn_s_rad, options.stop_s, options.frontier, across * _QUARTER]
                )
                target, ways = image.rows(across=across)
                scan_lanes(
                    target,
                    ways,
                    options.least_cells,
                    options.gap_cells,
                    round(half - 0.5),
                    *image.place(x, y, across=across),
                    pose.theta_rad - grid_rad,
                    prices,
                    best[across],
                    self._buffers.ints("sums", (1, target.shape[1])).ravel(),
                )
        score = max(best[0, 0], best[1, 0], outline[0])
        if score < least_rate:
            return None
        if outline[0] == score or image is None:
            return self._outline(window, outline)
        across = int(best[1, 0] > best[0, 0])
        return self._lane(window, image, best[across], across)

    def _outline(self, window: _Window, found: Floats) -> Choice:
        area = self._options.cell_m**2
        score, row, col, bearing = found.tolist()
        return Choice(
            "outline",
            window.way(int(row), int(col)),
            bearing + _QUARTER,
            0.0,
            self._options.outline_cells * area,
            score * area,
        )

    def _lane(self, window: _Window, image: _Turned, found: Floats, across: int) -> Choice:
        area = self._options.cell_m**2
        score, row, first, last, backwards, new, _, _ = found.tolist()
        begin, end = (last, first) if backwards else (first, last)
        x, y = image.point(row + 0.5, begin + 0.5, across=across)
        heading = image.angle_rad + across * _QUARTER + (math.pi if backwards else 0.0)
        way = window.way(int(y), int(x))
        return Choice(
            "lane",
            # the lane's own line, not the nearest cell's centre
            (*way[:-1], window.metres(x, y)),
            heading,
            (abs(end - begin) + 1) * self._options.cell_m,
            new * area,
            score * area,
        )


class _Turned:
    """A window's targets and ways in a frame turned to the lanes."""

    def __init__(self, window: _Window, angle_rad: float, buffers: _Buffers) -> None:
        rows, cols = window.open.shape
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        corners = [(k * c + r * s, r * c - k * s) for r in (0, rows) for k in (0, cols)]
        self.angle_rad = angle_rad
        self._left = left = math.floor(min(p[0] for p in corners))
        self._low = low = math.floor(min(p[1] for p in corners))
        shape = (
            math.ceil(max(p[1] for p in corners)) - low,
            math.ceil(max(p[0] for p in corners)) - left,
        )
        self._shape = shape
        self._buffers = buffers
        self._target = buffers.layer("turned target", shape)
        self._ways = buffers.ints("turned ways", shape)
        turn_images(
            window.target,
            window.ways,
            angle_rad,
            left * c - low * s,
            left * s + low * c,
            self._target,
            self._ways,
        )

    def rows(self, *, across: int) -> tuple[Layer, Ints]:
        """The images; ``across``: turned by a further quarter, so that rows run along +v."""
        if not across:
            return self._target, self._ways
        shape = self._shape[::-1]
        target = self._buffers.layer("across target", shape)
        ways = self._buffers.ints("across ways", shape)
        target[:] = self._target[:, ::-1].T
        ways[:] = self._ways[:, ::-1].T
        return target, ways

    def place(self, x: float, y: float, *, across: int) -> tuple[float, float]:
        """Row and column in the images of a point of the window."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        u, v = x * c + y * s - self._left, y * c - x * s - self._low
        return (self._shape[1] - u, v) if across else (v, u)

    def point(self, row: float, column: float, *, across: int) -> tuple[float, float]:
        """Point of the window at a row and a column of the images."""
        u, v = (self._shape[1] - row, column) if across else (column, row)
        u, v = u + self._left, v + self._low
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return u * c - v * s, u * s + v * c


def _size(part: tuple[int, int, int, int]) -> int:
    r0, r1, c0, c1 = part
    return (r1 - r0) * (c1 - c0)


def _clip(
    box: tuple[int, int, int, int], row: int, column: int, reach: int
) -> tuple[int, int, int, int]:
    """What of a box is so near to a cell."""
    r0, r1, c0, c1 = box
    return (
        max(r0, row - reach),
        min(r1, row + reach + 1),
        max(c0, column - reach),
        min(c1, column + reach + 1),
    )


def _free_cell(open_: Layer, row: int, col: int) -> tuple[int, int] | None:
    """The passable cell nearest to one."""
    rows, cols = open_.shape
    for reach in range(_SNAP_CELLS + 1):
        for r in range(row - reach, row + reach + 1):
            for c in range(col - reach, col + reach + 1):
                if 0 <= r < rows and 0 <= c < cols and open_[r, c]:
                    return r, c
    return None
