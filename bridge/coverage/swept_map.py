"""Map of the swept floor during the run, for display and for the log. It needs no floor plan."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel

UNKNOWN = -1
SWEPT = 0
"""Value of a cell that the mouth has passed. Such a cell has no obstacle, so its value is "free" in
``nav_msgs/OccupancyGrid`` (0 free, 100 occupied, -1 unknown)."""

_MARGIN_CELLS = 50
"""Number of cells by which the map extends beyond a new mark."""
_MAX_CELLS = 4096 * 4096
"""Maximum number of cells of the map."""
_GAP_M = 0.5
"""Minimum distance of two successive poses that are not connected, m. The estimate was then
reset."""


class OccupancyArray(NamedTuple):
    """Data of an OccupancyGrid."""

    cells: NDArray[np.int8]
    """Cells, with shape (rows along +y, columns along +x). Flattened, they are the field ``data``
    of the message."""
    origin_x_m: float
    """Position of the corner of cell (0, 0), m."""
    origin_y_m: float
    resolution_m: float


class SweptMap:
    """Cells that the mouth has covered, also partly.

    The map grows in steps of at least 50 cells (1 m at the default resolution). A partly covered
    cell counts as covered. So the drawn area is up to half a cell too large on each side; the
    metrics give exact values. If the map has more than 16 million cells, further marks are dropped.
    """

    __slots__ = (
        "_cells",
        "_columns",
        "_grid",
        "_half_m",
        "_last",
        "_offset_m",
        "_per_m",
        "_rows",
        "_samples",
        "_unconfirmed",
        "_x0",
        "_y0",
        "resolution_m",
        "revision",
    )

    def __init__(self, model: RobotModel, resolution_m: float = 0.02) -> None:
        """Begin without cells."""
        self.resolution_m = resolution_m
        self.revision = 0
        """Counter that grows with every change of a cell."""
        self._per_m = 1.0 / resolution_m
        self._half_m = 0.5 * model.cleaning_width_m
        self._offset_m = model.mouth_offset_m
        self._samples = max(math.ceil(model.cleaning_width_m / resolution_m), 1)
        self._cells = bytearray()
        self._x0 = self._y0 = 0
        self._rows = self._columns = 0
        self._grid = (self._cells, 0, 0, 0, 0)
        """Cells, rows, columns and origin of the map. They are replaced together."""
        self._last: Pose2 | None = None
        self._unconfirmed: list[tuple[int, int]] = []
        """Cells covered since the last confirmation of the pose. Column and row count from the
        origin of the frame."""

    @property
    def swept_m2(self) -> float:
        """Area of the covered cells, m²."""
        return self._cells.count(1) * self.resolution_m**2

    def update(self, pose: Pose2) -> None:
        """Mark the cells that the mouth covers at a pose and on the path from the last one."""
        last = self._last
        if last is None:
            self._last = pose
            self._mark(pose.x_m, pose.y_m, pose.theta_rad)
            return
        dx, dy = pose.x_m - last.x_m, pose.y_m - last.y_m
        turn = math.remainder(pose.theta_rad - last.theta_rad, math.tau)
        reach = abs(self._offset_m) + self._half_m
        path = (abs(dx) + abs(dy) + abs(turn) * reach) * self._per_m
        # less than a quarter of a cell is nothing new; a path that is not a number is dropped
        if not path >= 0.25:  # noqa: PLR2004
            return
        self._last = pose
        steps = 1 if abs(dx) + abs(dy) > _GAP_M else math.ceil(path)
        for k in range(steps - 1, -1, -1):
            back = k / steps
            self._mark(
                pose.x_m - back * dx,
                pose.y_m - back * dy,
                pose.theta_rad - back * turn,
            )

    def confirm(self) -> None:
        """Accept the cells covered so far, because the poses were right."""
        self._unconfirmed.clear()

    def revert(self) -> float:
        """Remove the cells covered since the last confirmation. Return their area, m²."""
        count = len(self._unconfirmed)
        for column, row in self._unconfirmed:
            self._cells[(row - self._y0) * self._columns + column - self._x0] = 0
        self._unconfirmed.clear()
        self.revision += count > 0
        return count * self.resolution_m**2

    def to_occupancy(self) -> OccupancyArray:
        """Return a copy: 0 swept, -1 unknown. This method may be called from any thread."""
        swept, rows, columns, x0, y0 = self._grid
        cells = np.frombuffer(bytes(swept), dtype=np.uint8)
        grid = np.where(cells > 0, SWEPT, UNKNOWN).astype(np.int8)
        return OccupancyArray(
            grid.reshape(rows, columns),
            x0 * self.resolution_m,
            y0 * self.resolution_m,
            self.resolution_m,
        )

    def _mark(self, x_m: float, y_m: float, theta_rad: float) -> None:
        per_m, samples = self._per_m, self._samples
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        x = (x_m + self._offset_m * c - self._half_m * s) * per_m - self._x0
        y = (y_m + self._offset_m * s + self._half_m * c) * per_m - self._y0
        step_x = 2.0 * self._half_m * s * per_m / samples
        step_y = -2.0 * self._half_m * c * per_m / samples
        end_x, end_y = x + samples * step_x, y + samples * step_y
        if not (
            0.0 <= x < self._columns
            and 0.0 <= y < self._rows
            and 0.0 <= end_x < self._columns
            and 0.0 <= end_y < self._rows
        ):
            shift = self._grow(min(x, end_x), min(y, end_y), max(x, end_x), max(y, end_y))
            if shift is None:
                return
            x += shift[0]
            y += shift[1]
        # sample the middle of each part of the mouth; a part is at most one cell wide
        x += 0.5 * step_x
        y += 0.5 * step_y
        cells, columns = self._cells, self._columns
        changed = False
        for _ in range(samples):
            index = int(y) * columns + int(x)
            if not cells[index]:
                cells[index] = 1
                changed = True
                self._unconfirmed.append((int(x) + self._x0, int(y) + self._y0))
            x += step_x
            y += step_y
        if changed:
            self.revision += 1

    def _grow(self, x0: float, y0: float, x1: float, y1: float) -> tuple[int, int] | None:
        """Enlarge the map to contain a box, in cells from the present origin. Return the shift."""
        if not (math.isfinite(x0 + x1) and math.isfinite(y0 + y1)):
            return None
        left = max(-math.floor(x0) + _MARGIN_CELLS, 0) if x0 < 0 else 0
        down = max(-math.floor(y0) + _MARGIN_CELLS, 0) if y0 < 0 else 0
        right = math.floor(x1) + 1 + _MARGIN_CELLS if x1 >= self._columns else self._columns
        up = math.floor(y1) + 1 + _MARGIN_CELLS if y1 >= self._rows else self._rows
        if not self._cells:
            # no cells yet: place the map around the first box
            left, down = -math.floor(x0) + _MARGIN_CELLS, -math.floor(y0) + _MARGIN_CELLS
            right, up = math.floor(x1) + 1 + _MARGIN_CELLS, math.floor(y1) + 1 + _MARGIN_CELLS
        columns, rows = left + right, down + up
        if columns * rows > _MAX_CELLS:
            return None
        grown = np.zeros((rows, columns), dtype=np.uint8)
        if self._cells:
            old = np.frombuffer(bytes(self._cells), dtype=np.uint8)
            grown[down : down + self._rows, left : left + self._columns] = old.reshape(
                self._rows,
                self._columns,
            )
        self._cells = bytearray(grown.tobytes())
        self._rows, self._columns = rows, columns
        self._x0 -= left
        self._y0 -= down
        self._grid = (self._cells, rows, columns, self._x0, self._y0)
        return left, down
