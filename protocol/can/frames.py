"""Classic CAN frames: identifiers, the packing of periodic messages, and their length in bits.

The identifier is ``type << 4 | node``. A lower identifier wins bus arbitration, so a stop (type 0
or 1) always wins. A periodic message is one frame: the low 16 bits of its time stamp, then at most
6 B of payload. A longer periodic message consists of several such frames, its parts. Each part has
its own type, so every frame can be decoded alone. The stamp comes first, so that an appended field
does not move other fields.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

from protocol.schema.message import RateClass

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

STAMP_SHIFT = 4
"""Unit of a 16-bit time stamp, as a bit shift: 2⁴ = 16 µs."""
T16 = struct.Struct("<H")
T32 = struct.Struct("<I")
MAX_DATA = 8

RECORD = struct.Struct("<IB3x8s")
"""Layout of a frame as 16 bytes: Linux' ``struct can_frame`` with a little-endian identifier."""
_NOT_PLAIN = 0xE000_0000
"""Mask of the extended, remote and error flags in the identifier's word."""
_MAX_STANDARD_ID = 0x7FF


class CanFrame(NamedTuple):
    """A data frame with an 11-bit identifier."""

    can_id: int
    data: bytes

    @property
    def can_type(self) -> int:
        """Message type, or the type of one of its parts."""
        return self.can_id >> 4

    @property
    def node(self) -> int:
        """Node id of the device; 0 addresses all devices."""
        return self.can_id & 0x0F


def to_record(frame: CanFrame) -> bytes:
    """Return the frame as 16 bytes."""
    return RECORD.pack(frame.can_id, len(frame.data), frame.data)


def from_record(record: bytes) -> CanFrame | None:
    """Return the frame in 16 bytes; None if it is no data frame with an 11-bit identifier."""
    word, length, data = RECORD.unpack(record)
    if word & _NOT_PLAIN or word > _MAX_STANDARD_ID or length > MAX_DATA:
        return None
    return CanFrame(word, data[:length])


# ---- periodic messages ------------------------------------------------------------------


class Part(NamedTuple):
    """Content of one frame of a periodic message."""

    can_type: int
    number: int
    spans: tuple[tuple[int, int], ...]
    """Byte ranges of the part's fields in the message's payload: first byte, and end (not
    included)."""
    slow_us: int
    """Minimum time between two transmissions, µs; 0: sent with every message."""
    full_stamp: bool
    """True for ``t_us u32 | payload`` instead of ``t16 | payload``."""


def parts_of(spec: MessageSpec, shared_fields: int) -> tuple[Part, ...]:
    """Return the frames that carry the first ``shared_fields`` fields of a periodic message.

    The peer declares only these fields. The frames are in the order of transmission. Slow parts
    come first, because a receiver delivers a message only after its slow parts have arrived.
    """
    spans: dict[int, list[tuple[int, int]]] = {}
    offset = 0
    for field in spec.fields[:shared_fields]:
        spans.setdefault(field.can_part, []).append((offset, offset + field.wire.size))
        offset += field.wire.size
    parts = (
        Part(
            spec.can_parts[number].can_type,
            number,
            tuple(_joined(spans[number])),
            spec.can_parts[number].slow_us,
            spec.full_stamp,
        )
        for number in sorted(spans)
    )
    return tuple(sorted(parts, key=lambda part: not part.slow_us))


def _joined(spans: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    first, last = -1, -1
    for start, end in spans:
        if start != last:
            if last >= 0:
                yield first, last
            first = start
        last = end
    yield first, last


def is_native(spec: MessageSpec) -> bool:
    """Return True if a message is periodic and uses these frames; all others are transfers."""
    return spec.rate is RateClass.STREAM


def pack(part: Part, payload: bytes, t_us: int) -> bytes:
    """Return the data of one frame, from the message's payload."""
    mine = b"".join(payload[start:end] for start, end in part.spans)
    if part.full_stamp:
        return T32.pack(t_us & 0xFFFF_FFFF) + mine
    return T16.pack(t_us >> STAMP_SHIFT & 0xFFFF) + mine


def join(fields: Iterable[Field], parts: dict[int, bytes]) -> bytes:
    """Join the payloads of a message's parts to the message's payload.

    The result ends before the first of our fields that the peer did not send. Fields that only the
    peer declares are appended; the codec skips them.
    """
    left = dict(parts)
    whole: list[bytes] = []
    for field in fields:
        size, source = field.wire.size, left.get(field.can_part, b"")
        if len(source) < size:
            break
        whole.append(source[:size])
        left[field.can_part] = source[size:]
    return b"".join(whole) + b"".join(left.values())


# ---- how long a frame occupies the bus ----------------------------------------------------

_FIXED_BITS = 47
"""Number of bits of a frame without its data: start bit, 11 of identifier, 3 of control, 4 of
length, 15 of CRC, 3 of delimiters and acknowledge, 7 of end, 3 between frames (ISO 11898-1)."""


def nominal_bits(length: int) -> int:
    """Return the number of bits of a frame with ``length`` data bytes, without stuff bits."""
    return _FIXED_BITS + 8 * length


def worst_bits(length: int) -> int:
    """Return the frame's number of bits with all possible stuff bits (Davis et al. 2007, eq. 1)."""
    return nominal_bits(length) + (33 + 8 * length) // 4
