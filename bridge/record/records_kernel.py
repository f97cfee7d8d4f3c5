"""Where the records of a chunk stand, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import Bytes, ConstBytes, LongGrid, Longs

_MESSAGE = cython.declare(cython.int, 5)
_MESSAGE_INDEX = cython.declare(cython.int, 7)
_FRONT = cython.declare(cython.int, 9)
"""Opcode and length."""
_LEAST = cython.declare(cython.int, 11)
"""And a message's channel."""
_MESSAGE_FIXED = cython.declare(cython.int, 22)
"""And its number and times."""
_INDEX_HEAD = cython.declare(cython.int, 15)
"""And the size of a message index."""


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _number(data: ConstBytes, at: cython.longlong, size: cython.int) -> cython.longlong:
    """A little-endian number of up to eight bytes; the eighth carries the sign."""
    low: cython.ulonglong = 0
    for k in range(size):
        byte: cython.ulonglong = int(data[at + k])
        low |= byte << (8 * k)
    return cython.cast(cython.longlong, low)


def find_records(content: ConstBytes, starts: Longs, lengths: Longs, channels: Longs) -> int:
    """Walk a chunk's content; how many records there are, negative where the last is cut.

    Args:
        content: The chunk, unpacked.
        starts: Filled with each record's place; as long as there may be records.
        lengths: Filled with the sizes of their contents, a message's own head included.
        channels: Filled with each message's channel, and with -opcode of other records.

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
            return -count - 1  # zeros are no records, and would be walked nine bytes at a time
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


def split_messages(  # noqa: PLR0913, PLR0917 - what is read, by which shape, into what
    data: ConstBytes,
    starts: Longs,
    head: cython.longlong,
    shape: ConstBytes,
    mask: ConstBytes,
    values: LongGrid,
    out: Bytes,
    fits: Bytes,
) -> int:
    """Take messages of one shape apart, value by value; how many have it.

    Args:
        data: Where they stand.
        starts: Where each record begins.
        head: Bytes of a record before its message.
        shape: A message of the shape.
        mask: Which bits of it must be the same.
        values: Of each value: where in the record it is, its size, and where in ``out`` the
            first one of it goes. Those of the messages that fit follow on each other.
        out: Filled with them.
        fits: Filled with whether a message has the shape.

    """
    with cython.nogil:
        count = _split_messages(data, starts, head, shape, mask, values, out, fits)
    return count  # noqa: RET504 - as above


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _split_messages(  # noqa: PLR0913, PLR0917 - as above
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
            if size == 8:  # noqa: PLR2004 - most of them, and one instruction each
                for k in range(8):
                    out[target + k] = data[source + k]
            elif size == 4:  # noqa: PLR2004 - as above
                for k in range(4):
                    out[target + k] = data[source + k]
            else:
                for k in range(size):
                    out[target + k] = data[source + k]
        count += 1
    return count


def skip_indexes(data: ConstBytes) -> cython.longlong:
    """How many bytes from the beginning are message indexes, whole ones."""
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
