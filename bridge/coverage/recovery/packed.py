"""The map at rest: two bits a cell, as a microcontroller would hold it between two legs.

A cell is of one of four kinds; where it could be of several, the later one is kept:

- ``UNKNOWN``: nothing known, or nothing but a beam that passed.
- ``DONE``: swept, or given up.
- ``BEEN``: the axle was there, whose middle the mouth is: swept, and open whatever is near.
- ``OCCUPIED``: something stands there, by evidence enough.

Of how the planner sees a cell of the box that is packed this survives, exactly: what is occupied
but for cells in which the axle was, and so the disc around it that is forbidden; where the axle
was; what is swept but for cells in which something stands, which are done with all the same.
What was open stays open.

Lost: how much evidence there is (a lone reading is forgotten, a thing is just sure enough), the
places that bumps forbid beside the thing that was put there, tries that were not the last, whether
a cell was swept or given up, and things that were seen farther off than ``RIM_M`` beyond the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]
    Kinds = NDArray[np.uint8]

UNKNOWN, DONE, BEEN, OCCUPIED = range(4)
RIM_M = 0.05
"""Packed beyond the body where the axle was outermost: a wall stands outside of the disc that
touches it, by up to two cells."""
_HEAD_BYTES = 12
"""Beside the cells: where the first one lies (two floats) and how many (two 16-bit numbers)."""


@dataclass(frozen=True, slots=True)
class PackedMap:
    """Cells of a box, row after row, four to a byte, the first in the lowest bits."""

    x0_m: float
    y0_m: float
    """The corner of the first cell."""
    rows: int
    columns: int
    cells: bytes

    @property
    def size_bytes(self) -> int:
        """What it takes, its frame included."""
        return len(self.cells) + _HEAD_BYTES


def kinds(done: Mask, visited: Mask, occupied: Mask) -> Kinds:
    """The kind of each cell."""
    kind: Kinds = np.where(done, DONE, UNKNOWN).astype(np.uint8)
    kind[occupied] = OCCUPIED
    kind[visited] = BEEN
    return kind


def pack(x0_m: float, y0_m: float, kind: Kinds) -> PackedMap:
    """Kinds, of shape (rows, columns), as bytes."""
    flat = kind.ravel()
    four = np.concatenate([flat, np.zeros(-len(flat) % 4, dtype=np.uint8)]).reshape(-1, 4)
    cells: Kinds = four[:, 0] | four[:, 1] << 2 | four[:, 2] << 4 | four[:, 3] << 6
    rows, columns = kind.shape
    return PackedMap(x0_m, y0_m, rows, columns, cells.tobytes())


def unpack(packed: PackedMap) -> Kinds:
    """The kinds, of shape (rows, columns).

    Raises:
        ValueError: the bytes are not as many as the cells ask for.

    """
    count = packed.rows * packed.columns
    if len(packed.cells) != -(-count // 4):
        raise ValueError(f"{len(packed.cells)} bytes for {count} cells of two bits")
    four = np.frombuffer(packed.cells, dtype=np.uint8)[:, None] >> np.arange(0, 8, 2)
    kind: Kinds = (four & 3).astype(np.uint8).ravel()[:count]
    return kind.reshape(packed.rows, packed.columns)
