"""Where the records of a chunk stand, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Ints = NDArray[np.int64]

_MESSAGE = 5
_FRONT = 9
"""Opcode and length."""
_LEAST = 11
"""And a message's channel."""


@compiled
def find_records(content: Bytes, starts: Ints, channels: Ints) -> int:
    """Walk a chunk's content; how many records there are, negative where the last is cut.

    Args:
        content: The chunk, unpacked.
        starts: Filled with each record's place; as long as there may be records.
        channels: Filled with each message's channel, and with -opcode of other records.

    """
    count, position, end = 0, np.int64(0), len(content)
    while position < end:
        if position + _LEAST > end:
            return -count - 1
        length = np.int64(0)
        for k in range(8):
            length |= np.int64(content[position + 1 + k]) << (8 * k)
        if length < 0 or length > end - position - _FRONT:
            return -count - 1
        starts[count] = position
        if content[position] == _MESSAGE:
            low, high = content[position + _FRONT], content[position + _FRONT + 1]
            channels[count] = np.int64(low) + 256 * np.int64(high)
        else:
            channels[count] = -np.int64(content[position])
        count += 1
        position += _FRONT + length
    return count


def rehearse() -> None:
    """Compile, or load what was compiled, before it is needed."""
    find_records(np.zeros(1, np.uint8), np.zeros(1, np.int64), np.zeros(1, np.int64))
