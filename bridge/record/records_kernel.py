"""Where the records of a chunk stand, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled, compiled_unlocked

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Ints = NDArray[np.int64]

_NONE, _ONE, _FOUR, _EIGHT = np.uint64(0), np.uint64(1), np.uint64(4), np.uint64(8)
_MESSAGE, _MESSAGE_INDEX = 5, 7
_FRONT = 9
"""Opcode and length."""
_LEAST = 11
"""And a message's channel."""
_MESSAGE_FIXED = 22
"""And its number and times."""
_INDEX_HEAD = 15
"""And the size of a message index."""


@compiled_unlocked
def find_records(content: Bytes, starts: Ints, lengths: Ints, channels: Ints) -> int:
    """Walk a chunk's content; how many records there are, negative where the last is cut.

    Args:
        content: The chunk, unpacked.
        starts: Filled with each record's place; as long as there may be records.
        lengths: Filled with the sizes of their contents, a message's own head included.
        channels: Filled with each message's channel, and with -opcode of other records.

    """
    count, position, end = 0, np.int64(0), len(content)
    while position < end:
        if position + _LEAST > end:
            return -count - 1
        length = np.int64(0)
        for k in range(8):
            length |= np.int64(content[position + 1 + k]) << (8 * k)
        if content[position] == 0 or length < 0 or length > end - position - _FRONT:
            return -count - 1  # zeros are no records, and would be walked nine bytes at a time
        starts[count], lengths[count] = position, length
        if content[position] == _MESSAGE:
            if length < _MESSAGE_FIXED:
                return -count - 1
            low, high = content[position + _FRONT], content[position + _FRONT + 1]
            channels[count] = np.int64(low) + 256 * np.int64(high)
        else:
            channels[count] = -np.int64(content[position])
        count += 1
        position += _FRONT + length
    return count


@compiled_unlocked
def split_messages(  # noqa: PLR0913, PLR0917 - what is read, by which shape, into what
    data: Bytes,
    starts: Ints,
    head: int,
    shape: Bytes,
    mask: Bytes,
    values: Ints,
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
    # Indexes without a sign: one that may be negative is looked at twice.
    count, length = _NONE, np.uint64(len(shape))
    for i in range(len(starts)):
        start = np.uint64(starts[i])
        begin = start + np.uint64(head)
        wrong = np.uint8(0)
        for k in range(length):
            wrong |= (data[begin + k] ^ shape[k]) & mask[k]
        fits[i] = wrong == 0
        if wrong:
            continue
        for v in range(len(values)):
            source, size = start + np.uint64(values[v, 0]), np.uint64(values[v, 1])
            target = np.uint64(values[v, 2]) + count * size
            if size == _EIGHT:  # most of them, and one instruction each
                for k in range(_EIGHT):
                    out[target + k] = data[source + k]
            elif size == _FOUR:
                for k in range(_FOUR):
                    out[target + k] = data[source + k]
            else:
                for k in range(size):
                    out[target + k] = data[source + k]
        count += _ONE
    return int(count)


@compiled
def skip_indexes(data: Bytes) -> int:
    """How many bytes from the beginning are message indexes, whole ones."""
    position, end = 0, len(data)
    while position + _INDEX_HEAD <= end and data[position] == _MESSAGE_INDEX:
        length, entries = np.int64(0), np.int64(0)
        for k in range(8):
            length |= np.int64(data[position + 1 + k]) << (8 * k)
        for k in range(4):
            entries |= np.int64(data[position + 11 + k]) << (8 * k)
        if length != entries + 6 or entries % 16 or length > end - position - _FRONT:
            break
        position += _FRONT + int(length)
    return position


def rehearse() -> None:
    """Compile, or load what was compiled, before it is needed."""
    byte, number = np.zeros(1, np.uint8), np.zeros(1, np.int64)
    find_records(byte, number, number, number)
    split_messages(byte, number[:0], 0, byte[:0], byte[:0], np.zeros((1, 3), np.int64), byte, byte)
    skip_indexes(byte)
