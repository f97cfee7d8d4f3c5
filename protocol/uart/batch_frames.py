"""Decodes delimiters, COBS and CRC-32 of a whole capture with numpy, frame length by length.

The streaming parser (:mod:`protocol.uart.framing`) is the reference; both must give the same
results.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from protocol.uart.crc import crc_table
from protocol.uart.framing import CRC, MAX_DECODED, MAX_ENCODED, MIN_DECODED, Damage

if TYPE_CHECKING:
    from numpy.typing import NDArray

DAMAGES = (Damage.COBS, Damage.LENGTH, Damage.CRC)
"""Kinds of damage; the index is the code in arrays."""
COBS, LENGTH, CHECK = range(3)
INTACT = 255
OFFSET_SIZE = 8
"""Number of bytes before the content in each row. They contain the frame's offset in the capture as
a little-endian 64-bit integer."""
_RESIDUE = zlib.crc32(bytes(4))
"""CRC of any bytes that are followed by their own CRC."""
_FEW = 256
"""Number of rows below which one zlib call per frame is faster than one numpy call per byte
column."""


class Stretches(NamedTuple):
    """Stretches of bytes between two delimiters; empty and overlong stretches are excluded."""

    starts: NDArray[np.int64]
    """Index of the first byte of each stretch."""
    lengths: NDArray[np.int64]
    """Length of each stretch, 1 to 254 bytes."""
    overlong_starts: NDArray[np.int64]
    """Index of the first byte of each stretch that is longer than any frame."""
    overlong_lengths: NDArray[np.int64]


def find_stretches(data: bytes) -> Stretches:
    """Split ``data``, which ends with a delimiter or is empty."""
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == 0)
    gaps = np.diff(ends, prepend=-1)
    gaps -= 1
    filled = np.flatnonzero(gaps)
    lengths = gaps[filled]
    starts = ends[filled]
    starts -= lengths
    overlong = lengths > MAX_ENCODED
    if not overlong.any():
        return Stretches(starts, lengths, starts[:0], lengths[:0])
    usable = ~overlong
    return Stretches(starts[usable], lengths[usable], starts[overlong], lengths[overlong])


def decode_frames(
    data: bytes, starts: NDArray[np.int64], length: int, first: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Decode all stretches of one length, 1 to 254 bytes.

    Return the damage of each stretch (:data:`INTACT` if none), and a row for each intact frame. A
    row contains the frame's offset (8 bytes), header and payload. ``first`` is the offset of
    ``data`` in the capture.
    """
    encoded = _gather(data, starts, length)
    whole = _undo_cobs(encoded)
    size = length - 1  # COBS adds one byte to a content of up to 253 B
    if size < MIN_DECODED:
        return np.empty((0, OFFSET_SIZE), np.uint8), np.where(
            whole, np.uint8(LENGTH), np.uint8(COBS)
        )
    body = encoded[:, 1:]
    intact = _check(body)
    intact &= whole
    damage = np.full(len(starts), INTACT, np.uint8)
    if not intact.all():
        damage[~intact] = CHECK
        damage[~whole] = COBS
        body, starts = body[intact], starts[intact]
    content = size - CRC.size
    rows = np.empty((len(body), OFFSET_SIZE + content), np.uint8)
    rows[:, :OFFSET_SIZE] = (starts + first).astype("<i8").view(np.uint8).reshape(-1, OFFSET_SIZE)
    rows[:, OFFSET_SIZE:] = body[:, :content]
    return rows, damage


def _gather(data: bytes, starts: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    # View with an item of `length` bytes at each byte offset, so that numpy copies whole frames.
    places = len(data) - length + 1
    items = np.ndarray((places,), f"V{length}", data, 0, (1,))
    return items[starts].view(np.uint8).reshape(-1, length)


def _undo_cobs(encoded: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Restore the zeros in place; return False for rows with invalid COBS distances.

    The distances are invalid if they do not lead exactly to the row's end. The encoded data has no
    zeros, so each step moves forward. In stretches of up to 254 bytes, a distance of 0xFF always
    leads past the end.
    """
    count, length = encoded.shape
    flat = encoded.reshape(-1)
    row_ends = np.arange(length, (count + 1) * length, length)
    whole = np.ones(count, np.bool_)
    which = np.arange(count)
    places = row_ends - length + encoded[:, 0]
    while True:
        whole[which[places > row_ends]] = False
        inside = places < row_ends
        places, row_ends, which = places[inside], row_ends[inside], which[inside]
        if not len(which):
            return whole
        steps = flat[places]
        flat[places] = 0
        places += steps


def _check(body: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return whether the CRC-32 at the end of each row matches the bytes before it."""
    count, size = body.shape
    if count < _FEW:
        rows = np.ascontiguousarray(body).view(f"V{size}").ravel().tolist()
        checks = np.fromiter(map(zlib.crc32, rows), np.uint32, count)
        right: NDArray[np.bool_] = checks == np.uint32(_RESIDUE)
        return right
    # A CRC is affine: it is the XOR of an effect of each byte, which depends on the byte's value
    # and its distance from the end.
    content = size - CRC.size
    register = np.full(count, zlib.crc32(bytes(content)), np.uint32)
    for column in range(content):
        # A byte is always a valid index. Mode "wrap" skips the bounds check and saves a third of
        # the time.
        register ^= _EFFECTS[content - 1 - column].take(body[:, column], mode="wrap")
    stored = np.ascontiguousarray(body[:, content:]).view("<u4").ravel()
    equal: NDArray[np.bool_] = register == stored
    return equal


def _effects() -> NDArray[np.uint32]:
    """Return the effect of one byte on the CRC, indexed by distance from the end and by value."""
    step = np.array(crc_table(8), np.uint32)
    effects = np.empty((MAX_DECODED, 256), np.uint32)
    effects[0] = step
    for distance in range(1, MAX_DECODED):
        before = effects[distance - 1]
        effects[distance] = step[before & np.uint32(0xFF)] ^ (before >> np.uint32(8))
    return effects


_EFFECTS = _effects()
