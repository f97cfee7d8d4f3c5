"""Reads the raw bytes of logs of protocol version 1 as version 2 would have sent them.

Version 2 differs in the version nibble, in fields that were appended, and on CAN in the place of
the short stamp: before the payload instead of behind it. Sweepctl 0.1 wrote such logs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from zlib import crc32

from protocol.can.frames import T16, from_record, is_native, to_record
from protocol.can.transfers import END, SEGMENT, START
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.framing import CRC, Frame, UartParser, encode_frame

if TYPE_CHECKING:
    from bridge.record.reader import LogReader
    from bridge.record.wire_records import WireRecord

_VERSION = 1
_FLAGS = 0x0F
_PART_SIZES = {
    part.can_type: sum(f.wire.size for f in spec.fields if f.can_part == number)
    for spec in CATALOGUE
    if is_native(spec) and not spec.full_stamp
    for number, part in enumerate(spec.can_parts)
}
"""Bytes of each CAN frame with a short stamp, by the type in its identifier."""


def is_version_1(reader: LogReader) -> bool:
    """Return whether a log's raw bytes are of protocol version 1."""
    return str(reader.run.get("protocol_version")) == str(_VERSION)


class Version1:
    """Rewrites the records of one log, which come in order."""

    def __init__(self) -> None:
        """Start with no byte held back."""
        self._open = {False: b"", True: b""}
        """Bytes of an unfinished serial frame, by direction."""
        self._transfers: dict[int, list[bytes]] = {}
        """Segments of an unfinished CAN transfer, by identifier."""

    def rewrite(self, record: WireRecord) -> WireRecord:
        """Return the record with the bytes of version 2; bytes of an open frame come with its end.

        Damaged bytes stay as they are.
        """
        if record.is_can:
            return record._replace(data=self._can(record.data))
        *whole, rest = (self._open[record.outgoing] + record.data).split(b"\0")
        self._open[record.outgoing] = rest
        return record._replace(data=b"".join(_serial(stretch) + b"\0" for stretch in whole))

    def _can(self, data: bytes) -> bytes:
        frame = from_record(data)
        if frame is None or not frame.data:
            return data
        size = _PART_SIZES.get(frame.can_type)
        if size is not None:
            payload, stamp = frame.data[: -T16.size], frame.data[-T16.size :]
            return to_record(frame._replace(data=stamp + payload.ljust(size, b"\0")))
        if frame.can_type in CATALOGUE.by_type and is_native(CATALOGUE.by_type[frame.can_type]):
            return data  # the whole stamp stands in front in both versions
        return b"".join(
            to_record(frame._replace(data=segment))
            for segment in self._segments(frame.can_id, frame.data)
        )

    def _segments(self, can_id: int, data: bytes) -> list[bytes]:
        """Return the segments of a transfer once it is complete."""
        tail = data[-1]
        if tail & START:
            self._transfers[can_id] = []
        held = self._transfers.setdefault(can_id, [])
        held.append(data)
        if not tail & END:
            return []
        del self._transfers[can_id]
        content = b"".join(segment[:-1] for segment in held)
        if len(held) > 1:
            content, check = content[: -CRC.size], content[-CRC.size :]
            if CRC.pack(crc32(content)) != check:
                return held  # damaged: it stays so
        if content[:1] and content[0] >> 4 == _VERSION:
            content = bytes([PROTOCOL_VERSION << 4 | content[0] & _FLAGS]) + content[1:]
        if len(held) > 1:
            content += CRC.pack(crc32(content))
        cut = [content[i : i + SEGMENT] for i in range(0, len(content), SEGMENT)]
        return [part + segment[-1:] for part, segment in zip(cut, held, strict=True)]


def _serial(stretch: bytes) -> bytes:
    """Return what stands between two delimiters."""
    events = UartParser().feed(b"\0" + stretch + b"\0")
    if len(events) != 1 or not isinstance(events[0], Frame) or events[0].version != _VERSION:
        return stretch
    frame = events[0]
    payload, spec = frame.payload, CATALOGUE.by_type.get(frame.type_id)
    if spec is not None and spec.direction is Direction.DEVICE and spec.text_field is None:
        payload = payload.ljust(spec.layout.size, b"\0")
    flags = frame.version_flags & _FLAGS
    return encode_frame(frame.node, frame.type_id, frame.seq, frame.t_us, payload, flags)[:-1]
