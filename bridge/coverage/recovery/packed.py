"""A compact map: two bits per cell, as a microcontroller would store it between two legs.

It serves a port of the planner to a microcontroller, and the measurements of ``bench.packed``. A
run on the host does not use it.

Each cell has one of four kinds. If several kinds apply, the last one in this list is stored:

- ``UNKNOWN``: no evidence, or only beams that passed through the cell.
- ``DONE``: swept, or abandoned.
- ``OCCUPIED``: enough evidence of an obstacle.
- ``VISITED``: visited by the axle. The cell is swept, and passable even if an obstacle is near.

The packed map preserves exactly:

- occupied cells that the axle did not visit, and so the inflation around them;
- cells that the axle visited;
- swept cells that are not occupied. Occupied cells need no sweeping.

Passable cells stay passable.

The packed map loses:

- the amount of evidence: a single reading is dropped, and an obstacle is only marked as occupied;
- cells that were blocked by bumps beside an obstacle;
- all fruitless attempts except the last;
- the difference between a swept and an abandoned cell;
- obstacles farther than ``RIM_M`` beyond the footprint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]
    Kinds = NDArray[np.uint8]

UNKNOWN, DONE, VISITED, OCCUPIED = range(4)
RIM_M = 0.05
"""Margin of the packed box around the footprint at the outermost positions of the axle, m. A wall
in contact is up to two cells outside the footprint."""
_HEAD_BYTES = 12
"""Size of the header, bytes: position of the first cell (two floats) and size of the box (two
16-bit numbers)."""


@dataclass(frozen=True, slots=True)
class PackedMap:
    """Cells of a box, row by row, four cells per byte. The first cell is in the lowest bits."""

    x0_m: float
    y0_m: float
    """Position of the first cell's corner, m."""
    rows: int
    columns: int
    cells: bytes

    @property
    def size_bytes(self) -> int:
        """Return the size including the header, bytes."""
        return len(self.cells) + _HEAD_BYTES


def kinds(done: Mask, visited: Mask, occupied: Mask) -> Kinds:
    """Return the kind of each cell."""
    kind: Kinds = np.where(done, DONE, UNKNOWN).astype(np.uint8)
    kind[occupied] = OCCUPIED
    kind[visited] = VISITED
    return kind


def pack(x0_m: float, y0_m: float, kind: Kinds) -> PackedMap:
    """Pack kinds of shape (rows, columns) into bytes."""
    flat = kind.ravel()
    four = np.concatenate([flat, np.zeros(-len(flat) % 4, dtype=np.uint8)]).reshape(-1, 4)
    cells: Kinds = four[:, 0] | four[:, 1] << 2 | four[:, 2] << 4 | four[:, 3] << 6
    rows, columns = kind.shape
    return PackedMap(x0_m, y0_m, rows, columns, cells.tobytes())


def unpack(packed: PackedMap) -> Kinds:
    """Return the kinds, of shape (rows, columns).

    Raises:
        ValueError: the number of bytes does not match the number of cells.

    """
    count = packed.rows * packed.columns
    if len(packed.cells) != -(-count // 4):
        raise ValueError(f"{len(packed.cells)} bytes for {count} cells of two bits")
    four = np.frombuffer(packed.cells, dtype=np.uint8)[:, None] >> np.arange(0, 8, 2)
    kind: Kinds = (four & 3).astype(np.uint8).ravel()[:count]
    return kind.reshape(packed.rows, packed.columns)
