"""UART framing: ``00 | COBS( header 8 B | payload | CRC-32 ) | 00``.

COBS is that of Cheshire and Baker (1999); the CRC is that of zlib (reflected 0x04C11DB7),
little-endian, over header and payload.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple
from zlib import crc32

from cobs import cobs

from protocol.catalogue import PROTOCOL_VERSION
from protocol.errors import FieldRangeError, LocalError
from protocol.message import MAX_TYPE

HEADER = struct.Struct("<BBBBI")
CRC = struct.Struct("<I")
MAX_DECODED = 253
"""Longest frame without its COBS byte: COBS then adds exactly one."""
MAX_ENCODED = MAX_DECODED + 1
MIN_DECODED = HEADER.size + CRC.size
MAX_PAYLOAD = MAX_DECODED - MIN_DECODED
FLAG_AUTHENTICATED = 1
FLAG_RETRY = 2
MAX_FLAGS = 15
MAX_NODE = 15
_DELIMITER = b"\0"
_unpack = {
    MIN_DECODED + size: struct.Struct(f"<BBBBI{size}s4x").unpack for size in range(MAX_PAYLOAD + 1)
}
"""By the length of a decoded frame: header and payload in one call, the CRC passed over."""
_new = tuple.__new__


class Frame(NamedTuple):
    """One intact frame."""

    version_flags: int
    """Protocol version in the high nibble, flags in the low one."""
    node: int
    """The device's id, 1-15, in both directions; 0: all."""
    type_id: int
    seq: int
    """Counts the sender's frames; wraps at 8 bits."""
    t_us: int
    """Sender's clock when the content was sampled; wraps at 32 bits."""
    payload: bytes

    @property
    def version(self) -> int:
        """Protocol version of the sender."""
        return self.version_flags >> 4

    @property
    def flags(self) -> int:
        """Flag bits."""
        return self.version_flags & 0x0F


class Damage(Enum):
    """What is wrong with a stretch of bytes between two delimiters."""

    COBS = "cobs"
    LENGTH = "length"
    CRC = "crc"


@dataclass(frozen=True, slots=True)
class DamagedFrame:
    """Bytes between two delimiters that are no frame."""

    damage: Damage
    offset: int
    """Of its first byte in the stream, counted from the parser's start."""
    length: int
    data: bytes
    """The bytes themselves; the first 254 where there were more."""


class FrameSizeError(LocalError):
    """A payload too long for a frame."""

    def __init__(self, length: int) -> None:
        super().__init__(f"payload of {length} B exceeds {MAX_PAYLOAD} B")
        self.length = length


def encode_frame(  # noqa: PLR0913, PLR0917 - the header's fields
    node: int, type_id: int, seq: int, t_us: int, payload: bytes, flags: int = 0
) -> bytes:
    """COBS-encode one frame, its closing delimiter included, the leading one not.

    Raises:
        FrameSizeError: the payload is longer than a frame can hold.
        FieldRangeError: node, type or flags do not fit the header.

    """
    check_frame(node, type_id, payload, flags)
    return encode_checked(node, type_id, seq, t_us, payload, flags)


def encode_checked(  # noqa: PLR0913, PLR0917 - the header's fields
    node: int, type_id: int, seq: int, t_us: int, payload: bytes, flags: int
) -> bytes:
    """Like :func:`encode_frame`, for what :func:`check_frame` has passed."""
    head = HEADER.pack(PROTOCOL_VERSION << 4 | flags, node, type_id, seq & 0xFF, t_us & 0xFFFF_FFFF)
    body = head + payload
    encoded: bytes = cobs.encode(body + CRC.pack(crc32(body)))
    return encoded + _DELIMITER


def check_frame(node: int, type_id: int, payload: bytes, flags: int) -> None:
    """Refuse what :func:`encode_frame` cannot carry, before it is queued."""
    if len(payload) > MAX_PAYLOAD:
        raise FrameSizeError(len(payload))
    if not 0 <= node <= MAX_NODE:
        raise FieldRangeError("frame", "node", node)
    if not 0 <= type_id <= MAX_TYPE:
        raise FieldRangeError("frame", "type_id", type_id)
    if not 0 <= flags <= MAX_FLAGS:
        raise FieldRangeError("frame", "flags", flags)


class UartParser:
    """Finds frames in a byte stream, however it is cut; keeps at most one frame's bytes."""

    def __init__(self) -> None:
        self.bytes_seen = 0
        self.frames = 0
        self.damaged = 0
        self._partial = b""
        self._overlong = 0
        """Bytes dropped of a stretch that is already longer than any frame."""

    def feed(self, data: bytes) -> list[Frame | DamagedFrame]:
        """Take the next bytes; give what they complete, in order."""
        offset = self.bytes_seen - len(self._partial)
        self.bytes_seen += len(data)
        pieces = (self._partial + data).split(_DELIMITER)
        self._partial = pieces.pop()
        found: list[Frame | DamagedFrame] = []
        damaged = self.damaged
        if self._overlong and pieces:
            found.append(self._end_overlong(pieces[0], offset))
            offset += len(pieces.pop(0)) + 1
        for piece in pieces:  # every frame passes here: no call that is not needed
            if piece:
                try:
                    body = cobs.decode(piece)
                except cobs.DecodeError:
                    found.append(self._damage(Damage.COBS, piece, offset))
                else:
                    unpack = _unpack.get(len(body))
                    if unpack is None:
                        found.append(self._damage(Damage.LENGTH, piece, offset))
                    # The CRC over a codeword and its own CRC is a constant, the residue.
                    elif crc32(body) != _RESIDUE:
                        found.append(self._damage(Damage.CRC, piece, offset))
                    else:
                        found.append(_new(Frame, unpack(body)))
            offset += len(piece) + 1
        self.frames += len(found) - (self.damaged - damaged)
        if len(self._partial) > MAX_ENCODED:
            self._overlong += len(self._partial) - MAX_ENCODED
            self._partial = self._partial[:MAX_ENCODED]
        return found

    def _damage(self, damage: Damage, piece: bytes, offset: int) -> DamagedFrame:
        self.damaged += 1
        if len(piece) > MAX_ENCODED:
            damage = Damage.LENGTH  # whatever else: as where it came in many reads
        return DamagedFrame(damage, offset, len(piece), piece[:MAX_ENCODED])

    def _end_overlong(self, piece: bytes, offset: int) -> DamagedFrame:
        # Dropped bytes lie behind what was kept, so the stretch starts where it did.
        length = len(piece) + self._overlong
        first = offset - self._overlong
        self._overlong = 0
        self.damaged += 1
        return DamagedFrame(Damage.LENGTH, first, length, piece[:MAX_ENCODED])


_RESIDUE = 0x2144DF1C
"""zlib.crc32(m + crc32(m) little-endian) for every m."""
