"""UART framing: ``00 | COBS( header 8 B | payload | CRC-32 ) | 00``.

COBS is that of Cheshire and Baker (1999); the CRC is that of zlib (reflected 0x04C11DB7),
little-endian, over header and payload.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import Any, NamedTuple
from zlib import crc32

from cobs import cobs

from protocol.errors import FieldRangeError, LocalError
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.message import MAX_TYPE

HEADER = struct.Struct("<BBBBI")
CRC = struct.Struct("<I")
MAX_DECODED = 253
"""Longest frame without its COBS byte: COBS then adds exactly one."""
MAX_ENCODED = MAX_DECODED + 1
MIN_DECODED = HEADER.size + CRC.size
MAX_PAYLOAD = MAX_DECODED - MIN_DECODED
FLAG_AUTHENTICATED = 1
MAX_FLAGS = 15
MAX_NODE = 15
_DELIMITER = b"\0"
UNPACK_BODY = {
    MIN_DECODED + size: struct.Struct(f"<BBBBI{size}s4x").unpack for size in range(MAX_PAYLOAD + 1)
}
"""By the length of a decoded frame: header and payload in one call, the CRC passed over."""
RESIDUE = 0x2144DF1C
"""zlib.crc32(m + crc32(m) little-endian) for every m: a body is intact where it gives this."""
PACK_BODY = [struct.Struct(f"<BBBBI{size}s").pack for size in range(MAX_PAYLOAD + 1)]
"""By the length of a payload: header and payload in one call."""
OWN_VERSION = PROTOCOL_VERSION << 4
"""The first byte of a frame without flags."""
pack_crc = CRC.pack
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


class DamagedFrame(NamedTuple):
    """Bytes between two delimiters that are no frame; a bare tuple, for noise makes many."""

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
    pack = PACK_BODY[len(payload)]
    body = pack(OWN_VERSION | flags, node, type_id, seq & 0xFF, t_us & 0xFFFF_FFFF, payload)
    encoded: bytes = cobs.encode(body + pack_crc(crc32(body)))
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
    """Finds frames in a byte stream, however it is cut; keeps at most one frame's bytes.

    :meth:`split` and :meth:`locate` are its halves, for a loop that does more with each
    intact body in the same breath.
    """

    def __init__(self) -> None:
        self.bytes_seen = 0
        self.frames = 0
        self.damaged = 0
        self._partial = b""
        self._overlong = 0
        """Bytes dropped of a stretch that is already longer than any frame."""
        self._ended_overlong = 0
        """The same, of the stretch that the last bytes ended."""

    def feed(self, data: bytes) -> list[Frame | DamagedFrame]:
        """Take the next bytes; give what they complete, in order."""
        found: list[Any] = []
        pieces = self.split(data)
        damaged = False
        for piece in filter(None, pieces):  # every frame passes here: no call without need
            try:
                body = cobs.decode(piece)
                unpack = UNPACK_BODY[len(body)]
            except cobs.DecodeError:
                found.append(Damage.COBS)
                damaged = True
            except KeyError:
                found.append(Damage.LENGTH)
                damaged = True
            else:
                if crc32(body) == RESIDUE:
                    found.append(_new(Frame, unpack(body)))
                else:
                    found.append(Damage.CRC)
                    damaged = True
        self.frames += len(found)
        if damaged:
            self.locate(found, pieces)
        return found

    def split(self, data: bytes) -> list[bytes]:
        """Take the next bytes; give the stretches that they end, empty ones included."""
        pieces = (self._partial + data).split(_DELIMITER)
        self._partial = partial = pieces.pop()
        self.bytes_seen += len(data)
        if pieces:
            self._ended_overlong, self._overlong = self._overlong, 0
        if len(partial) > MAX_ENCODED:
            # One byte more than any frame has: it stays too long, whatever follows.
            self._overlong += len(partial) - MAX_ENCODED - 1
            self._partial = partial[: MAX_ENCODED + 1]
        return pieces

    def locate(self, found: list[Any], pieces: list[bytes]) -> None:
        """Replace each :class:`Damage` in ``found`` by what it befell, and count it.

        ``found`` has one item for each of ``pieces`` that is not empty; all of them were
        counted as frames.
        """
        dropped = self._ended_overlong
        # Counted back from the end: what is kept of the next stretch, then all that was ended.
        offset = self.bytes_seen - self._overlong - len(self._partial)
        offset -= sum(map(len, pieces)) + len(pieces) + dropped
        index = 0
        for piece in pieces:
            length = len(piece) + dropped
            if piece:
                damage = found[index]
                if damage.__class__ is Damage:
                    if length > MAX_ENCODED:
                        damage = Damage.LENGTH  # whatever else: as where it came in many reads
                    what = (damage, offset, length, piece[:MAX_ENCODED])
                    found[index] = _new(DamagedFrame, what)
                    self.damaged += 1
                    self.frames -= 1
                index += 1
            offset += length + 1
            dropped = 0
