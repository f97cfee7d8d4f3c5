"""Compiled parser of a chunk's records."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import Bytes, ConstBytes, LongGrid, Longs

_MESSAGE = cython.declare(cython.int, 5)
_MESSAGE_INDEX = cython.declare(cython.int, 7)
_FRONT = cython.declare(cython.int, 9)
"""Size of opcode and length, bytes."""
_LEAST = cython.declare(cython.int, 11)
"""Size of a record from its opcode to a message's channel, bytes."""
_MESSAGE_FIXED = cython.declare(cython.int, 22)
"""Size of a message's content before its data, bytes."""
_INDEX_HEAD = cython.declare(cython.int, 15)
"""Size of a message index's head, bytes."""


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _number(data: ConstBytes, at: cython.longlong, size: cython.int) -> cython.longlong:
    """Return a little-endian integer of up to eight bytes; eight bytes are signed."""
    low: cython.ulonglong = 0
    for k in range(size):
        byte: cython.ulonglong = int(data[at + k])
        low |= byte << (8 * k)
    return cython.cast(cython.longlong, low)


def find_records(content: ConstBytes, starts: Longs, lengths: Longs, channels: Longs) -> int:
    """Find the records of a chunk's content. Return their number; negative: the last is truncated.

    Args:
        content: The decompressed chunk.
        starts: Filled with each record's offset. Its length is the maximum number of records.
        lengths: Filled with the size of each record's content. It includes a message's header.
        channels: Filled with each message's channel. For other records: the negative opcode.

    """
    with cython.nogil:
        count = _find_records(content, starts, lengths, channels)
    return count  # noqa: RET504 - a Python object again, which needs the interpreter's lock


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _find_records(
    content: ConstBytes, starts: Longs, lengths: Longs, channels: Longs
) -> cython.longlong:
    count: cython.longlong = 0
    position: cython.longlong = 0
    end: cython.longlong = content.shape[0]
    length: cython.longlong
    while position < end:
        if position + _LEAST > end:
            return -count - 1
        length = _number(content, position + 1, 8)
        if content[position] == 0 or length < 0 or length > end - position - _FRONT:
            return -count - 1  # zeros would be parsed as empty records of nine bytes each
        starts[count], lengths[count] = position, length
        if content[position] == _MESSAGE:
            if length < _MESSAGE_FIXED:
                return -count - 1
            channels[count] = _number(content, position + _FRONT, 2)
        else:
            opcode: cython.int = int(content[position])
            channels[count] = -opcode
        count += 1
        position += _FRONT + length
    return count


def split_messages(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    data: ConstBytes,
    starts: Longs,
    head: cython.longlong,
    shape: ConstBytes,
    mask: ConstBytes,
    values: LongGrid,
    out: Bytes,
    fits: Bytes,
) -> int:
    """Extract the values of all messages with one shape; return the number of these messages.

    Args:
        data: Bytes with the messages.
        starts: Offset of each record.
        head: Size of a record before its message, bytes.
        shape: A message of this shape.
        mask: Bits that must be equal to those in ``shape``.
        values: For each value: its offset in the record, its size, and the offset of its first
            occurrence in ``out``. The values of all fitting messages are contiguous.
        out: Filled with the values.
        fits: Filled with 1 for each message of the shape, else 0.

    """
    with cython.nogil:
        count = _split_messages(data, starts, head, shape, mask, values, out, fits)
    return count  # noqa: RET504 - a Python object again, which needs the interpreter's lock


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _split_messages(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    data: ConstBytes,
    starts: Longs,
    head: cython.longlong,
    shape: ConstBytes,
    mask: ConstBytes,
    values: LongGrid,
    out: Bytes,
    fits: Bytes,
) -> cython.longlong:
    count: cython.longlong = 0
    start: cython.longlong
    source: cython.longlong
    target: cython.longlong
    size: cython.longlong
    wrong: cython.uchar
    for i in range(starts.shape[0]):
        start = starts[i]
        wrong = 0
        for k in range(shape.shape[0]):
            wrong |= (data[start + head + k] ^ shape[k]) & mask[k]
        fits[i] = wrong == 0
        if wrong:
            continue
        for v in range(values.shape[0]):
            source, size = start + values[v, 0], values[v, 1]
            target = values[v, 2] + count * size
            if size == 8:  # noqa: PLR2004 - the most frequent size, one instruction
                for k in range(8):
                    out[target + k] = data[source + k]
            elif size == 4:  # noqa: PLR2004 - one instruction
                for k in range(4):
                    out[target + k] = data[source + k]
            else:
                for k in range(size):
                    out[target + k] = data[source + k]
        count += 1
    return count


def skip_indexes(data: ConstBytes) -> cython.longlong:
    """Return the number of bytes at the start that are whole message indexes."""
    position: cython.longlong = 0
    end: cython.longlong = data.shape[0]
    length: cython.longlong
    entries: cython.longlong
    while position + _INDEX_HEAD <= end and data[position] == _MESSAGE_INDEX:
        length, entries = _number(data, position + 1, 8), _number(data, position + 11, 4)
        if length != entries + 6 or entries % 16 or length > end - position - _FRONT:
            break
        position += _FRONT + length
    return position
