"""UART framing: ``00 | COBS( header 8 B | payload | CRC-32 ) | 00``.

COBS (consistent overhead byte stuffing) is specified in Cheshire and Baker (1999). The CRC-32 is
the CRC of zlib (polynomial 0x04C11DB7, reflected). It covers header and payload and is sent in
little-endian order.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import NamedTuple

from protocol import primitives
from protocol.errors import FieldRangeError, LocalError
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.message import MAX_TYPE
from protocol.uart.crc import crc_table

HEADER = struct.Struct("<BBBBI")
CRC = struct.Struct("<I")
MAX_DECODED = 253
"""Maximum length of a decoded frame, bytes. Up to this length, COBS adds exactly one byte."""
MAX_ENCODED = MAX_DECODED + 1
MIN_DECODED = HEADER.size + CRC.size
MAX_PAYLOAD = MAX_DECODED - MIN_DECODED
FLAG_AUTHENTICATED = 1
MAX_FLAGS = 15
MAX_NODE = 15
OWN_VERSION = PROTOCOL_VERSION << 4
"""First header byte of a frame without flags."""
RESIDUE = 0xDEBB20E3
"""Value of the CRC register after an intact frame and its CRC."""


_CRC_TABLE = crc_table(8)
_MAX_ENCODED, _MAX_PAYLOAD, _MIN_DECODED = MAX_ENCODED, MAX_PAYLOAD, MIN_DECODED
_RESIDUE = RESIDUE
# In compiled code these names are C integers; the names above are Python objects.


class Frame(NamedTuple):
    """One intact frame."""

    version_flags: int
    """Protocol version in the high nibble, flags in the low nibble."""
    node: int
    """Node id of the device, 1-15, in both directions; 0: all devices."""
    type_id: int
    seq: int
    """Counter of the sender's frames; wraps at 8 bits."""
    t_us: int
    """Time at which the content was sampled, by the sender's clock, µs; wraps at 32 bits."""
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
    """The error in a stretch of bytes between two delimiters."""

    COBS = "cobs"
    LENGTH = "length"
    CRC = "crc"


class DamagedFrame(NamedTuple):
    """Bytes between two delimiters that are not a frame; a tuple, because noise produces many."""

    damage: Damage
    offset: int
    """Index of its first byte in the stream, counted from the parser's start."""
    length: int
    data: bytes
    """The bytes, at most the first 254."""


class FrameSizeError(LocalError):
    """A payload too long for a frame."""

    def __init__(self, length: int) -> None:
        super().__init__(f"payload of {length} B exceeds {MAX_PAYLOAD} B")
        self.length = length


def encode_frame(  # noqa: PLR0913, PLR0917 - the header's fields
    node: int, type_id: int, seq: int, t_us: int, payload: bytes, flags: int = 0
) -> bytes:
    """Encode one frame with its closing delimiter, but without a leading delimiter.

    Raises:
        FrameSizeError: the payload is longer than a frame can hold.
        FieldRangeError: node, type or flags do not fit the header.

    """
    check_frame(node, type_id, payload, flags)
    head = OWN_VERSION | flags, node, type_id, seq & 0xFF
    return UartEncoder().frame(*head, t_us & 0xFFFF_FFFF, payload)


def check_frame(node: int, type_id: int, payload: bytes, flags: int) -> None:
    """Reject values that :func:`encode_frame` cannot encode, before they are queued."""
    if len(payload) > MAX_PAYLOAD:
        raise FrameSizeError(len(payload))
    if not 0 <= node <= MAX_NODE:
        raise FieldRangeError("frame", "node", node)
    if not 0 <= type_id <= MAX_TYPE:
        raise FieldRangeError("frame", "type_id", type_id)
    if not 0 <= flags <= MAX_FLAGS:
        raise FieldRangeError("frame", "flags", flags)


class UartEncoder:
    """Encodes frames one after the other."""

    def __init__(self) -> None:
        self._body = bytearray(MAX_DECODED)
        self._encoded = bytearray(MAX_ENCODED + 1)

    def frame(  # noqa: PLR0913, PLR0917 - the header's fields
        self, version_flags: int, node: int, type_id: int, seq: int, t_us: int, payload: bytes
    ) -> bytes:
        """Encode one frame with its closing delimiter, but without a leading delimiter.

        Raises:
            FrameSizeError: the payload is longer than a frame can hold.

        """
        body, encoded, content = self._body, self._encoded, payload
        size = len(payload)
        if size > _MAX_PAYLOAD:
            raise FrameSizeError(size)
        body[0], body[1], body[2], body[3] = version_flags, node, type_id, seq
        body[4], body[5] = t_us & 0xFF, t_us >> 8 & 0xFF
        body[6], body[7] = t_us >> 16 & 0xFF, t_us >> 24
        for place in range(size):
            body[8 + place] = content[place]
        size += 8
        crc = 0xFFFF_FFFF
        for place in range(size):
            crc = _CRC_TABLE[(crc ^ body[place]) & 0xFF] ^ crc >> 8
        crc ^= 0xFFFF_FFFF
        body[size], body[size + 1] = crc & 0xFF, crc >> 8 & 0xFF
        body[size + 2], body[size + 3] = crc >> 16 & 0xFF, crc >> 24
        size += 4
        # COBS: each zero is replaced by the distance to the next zero. The first byte is the
        # distance to the first zero.
        zero = 0
        for place in range(size):
            byte = body[place]
            if byte:
                encoded[place + 1] = byte
            else:
                encoded[zero] = place + 1 - zero
                zero = place + 1
        encoded[zero] = size + 1 - zero
        encoded[size + 1] = 0
        return primitives.cut(encoded, 0, size + 2)


class UartParser:
    """Finds frames in a byte stream that arrives in pieces; stores at most one frame's bytes.

    :meth:`feed` processes a piece and returns all frames and damage that it completes. :meth:`take`
    and :meth:`next_event` return the same events one by one, with the header's fields as
    attributes.
    """

    def __init__(self) -> None:
        self.bytes_seen = 0
        """Number of bytes parsed."""
        self.frames = 0
        self.damaged = 0
        self.version_flags = self.node = self.type_id = self.seq = 0
        """Header fields of the newest frame."""
        self.payload = b""
        """Payload of the newest frame."""
        self._data = b""
        self._place = 0
        """Index of the next byte in the present piece."""
        self._stretch = bytearray(MAX_ENCODED)
        """First bytes after the last delimiter, up to the length of a frame."""
        self._length = 0
        """Number of bytes after the last delimiter, stored or dropped."""
        self._body = bytearray(MAX_DECODED)

    def feed(self, data: bytes) -> list[Frame | DamagedFrame]:
        """Process the next bytes; return the completed frames and damage, in order."""
        found: list[Frame | DamagedFrame] = []
        self.take(data)
        event = self.next_event()
        while event is not None:
            found.append(event)
            event = self.next_event()
        return found

    def take(self, data: bytes) -> None:
        """Set the next bytes to process, after :meth:`next_event` has returned None."""
        self._data = data
        self._place = 0

    def next_event(self) -> Frame | DamagedFrame | None:
        """Return the next frame or damage in the present bytes; None if there are no more."""
        view, stretch = self._data, self._stretch
        begin, length = self._place, self._length
        for place in range(begin, len(self._data)):
            byte = view[place]
            if byte:
                if length < _MAX_ENCODED:
                    stretch[length] = byte
                length += 1
            elif length:
                self._place = place + 1
                self._length = 0
                self.bytes_seen += place + 1 - begin
                return self._judged(length)
        self._length = length
        self.bytes_seen += len(self._data) - begin
        self._data = b""
        self._place = 0
        return None

    def _judged(self, length: int) -> Frame | DamagedFrame:
        """Decode the last ``length`` bytes before a delimiter; return the frame or the damage."""
        stretch, body = self._stretch, self._body
        damage = _LENGTH
        if length <= _MAX_ENCODED:
            # COBS and CRC in one pass. Each distance leads to a zero; the last distance leads to
            # the end.
            left = stretch[0]
            crc = 0xFFFF_FFFF
            for place in range(1, length):
                byte = stretch[place]
                left -= 1
                if left == 0:
                    left = byte
                    byte = 0
                body[place - 1] = byte
                crc = _CRC_TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
            if left != 1:
                damage = _COBS
            elif length > _MIN_DECODED:
                if crc == _RESIDUE:
                    return self._frame(length - 5)
                damage = _CRC
        self.damaged += 1
        offset = self.bytes_seen - 1 - length
        data = primitives.cut(stretch, 0, min(length, _MAX_ENCODED))
        return primitives.make(_DamagedFrame, (damage, offset, length, data))

    def _frame(self, end: int) -> Frame:
        """Return the frame whose header and payload are the first ``end`` bytes of the body."""
        body = self._body
        self.frames += 1
        self.version_flags, self.node, self.type_id, self.seq = body[0], body[1], body[2], body[3]
        t_us = body[4] | body[5] << 8 | body[6] << 16 | body[7] << 24
        self.payload = payload = primitives.cut(body, 8, end)
        values = (self.version_flags, self.node, self.type_id, self.seq, t_us, payload)
        return primitives.make(_Frame, values)


_Frame, _DamagedFrame = Frame, DamagedFrame
_COBS, _LENGTH, _CRC = Damage.COBS, Damage.LENGTH, Damage.CRC
