"""Rows of numbers: messages of fixed length that occur together, packed when their chunk closes.

A new message only appends its numbers to an array. When the chunk closes, a compiled kernel writes
all records, with their headers, into the space that is reserved for them.
"""

from __future__ import annotations

import struct
from array import array
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.record.encode import rows_kernel as kernel

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from bridge.record.encode.packer import Part

OP_MESSAGE = 0x05
"""MCAP's opcode of a message."""
RECORD_HEAD = 9
"""Size of opcode and length, bytes. The length field does not count these bytes."""
_HEAD = struct.Struct("<BQH")
_FIXED = 22
"""Size of a message record before its data, bytes."""


class Source(NamedTuple):
    """Source of a value: a column of the row, and the conversion to the value."""

    kind: int
    """Kind of the source, from ``rows_kernel``."""
    column: int = 0
    gain: float = 1.0
    offset: float = 0.0


def whole(column: int) -> Source:
    """Use an integer column unchanged, with the width of the form."""
    return Source(kernel.WHOLE, column)


def scaled(column: int, gain: float, offset: float = 0.0) -> Source:
    """Use an integer column, converted to SI units."""
    return Source(kernel.SCALED, column, gain, offset)


def real(column: int) -> Source:
    """Use a float column unchanged."""
    return Source(kernel.FLOAT, column)


def ros_stamp(column: int) -> tuple[Source, Source]:
    """Use a time in nanoseconds as seconds and nanoseconds."""
    return Source(kernel.SECONDS, column), Source(kernel.NANOSECONDS, column)


def proto_stamp(column: int) -> Source:
    """Use a time in nanoseconds as a ``google.protobuf.Timestamp`` of twelve bytes."""
    return Source(kernel.STAMP, column)


def half_angle(column: int) -> tuple[Source, Source]:
    """Use sine and cosine of half an angle: z and w of a quaternion about z."""
    return Source(kernel.SIN_HALF, column), Source(kernel.COS_HALF, column)


class Head(NamedTuple):
    """Columns of a message's header: log time, publish time, and sequence number if present."""

    log: int
    publish: int
    sequence: int | None = None


class RowMessage(NamedTuple):
    """One of the messages that a row contains."""

    channel_id: int
    head: Head
    form: Sequence[Part]
    sources: Sequence[Source]
    """Source of each value of the form, in order."""


class Packed(NamedTuple):
    """Location of a chunk's rows."""

    entries: NDArray[np.int64]
    """Log times and offsets in the chunk, ``(messages, rows, 2)``."""
    first_ns: int
    last_ns: int


class Rows:
    """Pending rows of messages that occur together; created by ``ChunkedFile.rows``."""

    def __init__(self, ints: int, floats: int, messages: Iterable[RowMessage]) -> None:
        """Declare a row's number of integers and floats, and its messages.

        The first integer of a row is the row's offset in the chunk.
        """
        self._columns = ints, floats
        self.ints = array("q")
        """Integers of all pending rows."""
        self.floats = array("d")
        self.channels: list[int] = []
        """Channel of each message."""
        places: list[int] = []
        template = b""
        ops: list[tuple[int, int, int, int]] = []
        scales: list[tuple[float, float]] = []
        for channel_id, head, form, sources in messages:
            self._log_column = head.log
            self.channels.append(channel_id)
            places.append(len(template))
            size = _FIXED + sum(_size(part) for part in form)
            parts = [_HEAD.pack(OP_MESSAGE, size, channel_id), "I", "Q", "Q", *form]
            sequence = Source(-1) if head.sequence is None else whole(head.sequence)
            wanted = iter((sequence, whole(head.log), whole(head.publish), *sources))
            for part in parts:
                if isinstance(part, str):
                    kind, column, gain, offset = next(wanted)
                    if kind >= 0:
                        ops.append((len(template), kind, column, _size(part)))
                        scales.append((gain, offset))
                template += part if isinstance(part, bytes) else bytes(_size(part))
        self.size = len(template)
        """Size of a row's records, bytes."""
        self._template = np.frombuffer(template, dtype=np.uint8).copy()
        self._places = np.array(places, dtype=np.int64)
        self._ops = np.array(ops, dtype=np.int64)
        self._scales = np.array(scales, dtype=np.float64)

    def take(self, chunk: NDArray[np.uint8]) -> Packed:
        """Write the records of all rows into their chunk, and clear the rows."""
        ints, floats = self._columns
        table = np.frombuffer(self.ints, dtype=np.int64).reshape(-1, ints)
        count = len(table)
        if floats:
            reals = np.frombuffer(self.floats, dtype=np.float64).reshape(-1, floats)
        else:
            reals = np.zeros((count, 1))
        index = np.empty((len(self.channels), count, 2), dtype=np.int64)
        first_ns, last_ns = kernel.pack_rows(
            table,
            reals,
            self._template,
            self._ops,
            self._scales,
            chunk,
            self._log_column,
            self._places,
            index,
        )
        # A numpy array that shares the memory of an ``array`` prevents clearing it. So create new
        # ones.
        self.ints, self.floats = array("q"), array("d")
        return Packed(index, first_ns, last_ns)


def _size(part: Part) -> int:
    return len(part) if isinstance(part, bytes) else struct.calcsize(f"<{part}")
