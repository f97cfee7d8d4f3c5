"""A window of the map for one search: free cells, targets, path lengths.

The arrays are reused in every search. :class:`Turned` contains targets and path lengths, rotated so
that their rows are parallel to the lanes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.coverage.recovery.lane_kernels import turn_images
from bridge.coverage.recovery.travel_kernels import RING, TravelSearch, trace_path, travel
from bridge.coverage.recovery.window_kernels import copy_window

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.motion.geometry import Pose2

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.int32]

Point = tuple[float, float]

_ROOM = 16384
"""Maximum number of cells in a bucket of the path search."""
_CORNERS = 400
"""Maximum number of corners of a path."""
_MAX_PATH_CELLS = 8192
"""Maximum length of a path, cells. The largest room needs a fifth of it."""


class Buffers:
    """Arrays by name, for reuse.

    Every search uses the same arrays, because their allocation would take longer than the search.
    """

    def __init__(self) -> None:
        self._flat: dict[str, NDArray[np.generic]] = {}
        self.queue: Ints = np.zeros((RING, _ROOM), dtype=np.int32)
        self.counts: Ints = np.zeros(RING, dtype=np.int32)
        self.corners: Ints = np.zeros((_CORNERS, 2), dtype=np.int32)
        self.path: Ints = np.zeros(_MAX_PATH_CELLS, dtype=np.int32)

    def layer(self, name: str, shape: tuple[int, int]) -> Layer:
        """Return a byte array of a shape. It contains old values."""
        return self._get(name, shape, np.uint8)

    def ints(self, name: str, shape: tuple[int, int]) -> Ints:
        """Return an integer array of a shape. It contains old values."""
        return self._get(name, shape, np.int32)

    def _get(self, name: str, shape: tuple[int, int], kind: type[np.generic]) -> NDArray[Any]:
        size = shape[0] * shape[1]
        flat = self._flat.get(name)
        if flat is None or flat.size < size:
            flat = self._flat[name] = np.zeros(size + size // 4, dtype=kind)
        return flat[:size].reshape(shape)


class SearchWindow:
    """A window of the map at the beginning of a search, and the results of the search."""

    def __init__(
        self,
        evidence_map: EvidenceMap,
        window: tuple[int, int, int, int],
        max_attempts: int,
        buffers: Buffers,
    ) -> None:
        r0, r1, c0, c1 = window
        shape = (r1 - r0, c1 - c0)
        self.x0_m, self.y0_m = evidence_map.to_metres(c0, r0)
        self.cell_m = evidence_map.to_metres(c0 + 1, r0)[0] - self.x0_m
        self.geometry = geometry = evidence_map.geometry
        self.reach_cells = min(geometry.mouth_cells, evidence_map.swept_cells)
        """Maximum distance from the axle at which the mouth sweeps a cell, cells."""
        self.lane_rows = min(geometry.lane_rows, int(2.0 * evidence_map.swept_cells))
        """Number of rows that a lane sweeps."""
        self.open = buffers.layer("open", shape)
        self.done = buffers.layer("done", shape)
        self.dist = buffers.ints("dist", shape)
        self.target = buffers.layer("target", shape)
        self.paths = buffers.ints("paths", shape)
        self._cliffs = evidence_map.cliffs.rims
        self._buffers = buffers
        self.settled = 0
        self._search = TravelSearch()
        blocked, visited = evidence_map.places()
        copy_window(
            evidence_map.inflated,
            blocked,
            visited,
            evidence_map.swept,
            evidence_map.wall,
            evidence_map.attempts,
            max_attempts,
            r0,
            c0,
            self.open,
            self.done,
        )

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.open.size

    @property
    def perimeter_lengths(self) -> Ints:
        """Path lengths to places where the robot can begin to follow a wall.

        Places at cliffs are excluded, because there is no wall.
        """
        if not self._cliffs:
            return self.paths
        paths = self.paths.copy()
        rows, cols = np.ogrid[: paths.shape[0], : paths.shape[1]]
        for point in self._cliffs:
            row, col = self.cell(*point)
            near = self.geometry.cliff_perimeter_m / self.cell_m
            paths[(rows - row) ** 2 + (cols - col) ** 2 < near**2] = -1
        return paths

    def place(self, pose: Pose2) -> tuple[float, float]:
        """Return column and row of a pose, with fractions."""
        return (pose.x_m - self.x0_m) / self.cell_m, (pose.y_m - self.y0_m) / self.cell_m

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return row and column of the cell that contains a point."""
        return int((y_m - self.y0_m) // self.cell_m), int((x_m - self.x0_m) // self.cell_m)

    def metres(self, column: float, row: float) -> Point:
        """Return the point at a column and a row, with fractions, m."""
        return self.x0_m + column * self.cell_m, self.y0_m + row * self.cell_m

    def begin(self, start: tuple[int, int]) -> None:
        """Begin the path search at a cell."""
        row, col = start
        buffers = self._buffers
        self.dist.fill(-1)
        self.dist[row, col] = 0
        buffers.counts.fill(0)
        buffers.counts[0] = 1
        self._search = TravelSearch()
        self._search.waiting = 1
        buffers.queue[0, 0] = row * self.dist.shape[1] + col

    def search_paths(self, max_cost: int, budget: int) -> bool:
        """Continue the path search up to a cost. Return False if the budget of cells is used up."""
        self.settled, done = travel(
            self.open.ravel(),
            self.open.shape[1],
            max_cost,
            max(budget, 1),
            self.dist.ravel(),
            self._buffers.queue,
            self._buffers.counts,
            self._search,
        )
        return done

    def path(self, row: int, col: int) -> tuple[Point, ...]:
        """Return the corners of the path to a cell, m."""
        corners = self._buffers.corners
        count = trace_path(self.open, self.paths, row, col, corners, self._buffers.path)
        cells = corners[1:count].tolist() or [[row, col]]
        return tuple(self.metres(c + 0.5, r + 0.5) for r, c in cells)


class Turned:
    """A window's targets and path lengths, in a frame rotated to the direction of the lanes."""

    def __init__(self, window: SearchWindow, angle_rad: float, buffers: Buffers) -> None:
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
        self._paths = buffers.ints("turned paths", shape)
        turn_images(
            window.target,
            window.paths,
            angle_rad,
            left * c - low * s,
            left * s + low * c,
            self._target,
            self._paths,
        )

    def rows(self, *, across: int) -> tuple[Layer, Ints]:
        """Return the images.

        With ``across`` they are rotated by a further 90°, so that rows are orthogonal to the lanes.
        """
        if not across:
            return self._target, self._paths
        shape = self._shape[::-1]
        target = self._buffers.layer("across target", shape)
        paths = self._buffers.ints("across paths", shape)
        target[:] = self._target[:, ::-1].T
        paths[:] = self._paths[:, ::-1].T
        return target, paths

    def place(self, x: float, y: float, *, across: int) -> tuple[float, float]:
        """Return row and column in the images for a point of the window."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        u, v = x * c + y * s - self._left, y * c - x * s - self._low
        return (self._shape[1] - u, v) if across else (v, u)

    def point(self, row: float, column: float, *, across: int) -> tuple[float, float]:
        """Return the point of the window at a row and a column of the images."""
        u, v = (self._shape[1] - row, column) if across else (column, row)
        u, v = u + self._left, v + self._low
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return u * c - v * s, u * s + v * c


def free_cell(open_: Layer, row: int, col: int, reach: int) -> tuple[int, int] | None:
    """Return the nearest passable cell within ``reach``; None: no such cell."""
    rows, cols = open_.shape
    for off in range(reach + 1):
        for r in range(row - off, row + off + 1):
            for c in range(col - off, col + off + 1):
                if 0 <= r < rows and 0 <= c < cols and open_[r, c]:
                    return r, c
    return None
