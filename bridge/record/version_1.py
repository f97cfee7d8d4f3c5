"""Conversion of raw bytes in logs of protocol version 1 to version 2.

Version 2 has another version nibble, other message types and additional fields. On CAN, version 2
has its short time stamp before the payload, and version 1 after the payload. Sweepctl 0.1 wrote
logs of version 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from zlib import crc32

from protocol.can.frames import T16, T32, from_record, is_native, to_record
from protocol.can.transfers import END, FLAG_WHOLE_STAMP, START, TRANSFER, segments
from protocol.messages.device import Ack, Nack
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.framing import CRC, Frame, UartParser, encode_frame

if TYPE_CHECKING:
    from bridge.record.reader import LogReader
    from bridge.record.wire_records import WireRecord

_VERSION = 1
_TYPES = {
    0x00: 0x01,  # stop
    0x01: 0x0F,  # tag on CAN
    0x03: 0x0A,  # wheel_duty
    0x0A: 0x70,  # get_parameter
    0x0B: 0x71,  # set_parameter
    0x0C: 0x72,  # save_parameters
    0x0F: 0x73,  # set_key
    0x12: 0x13,  # imu, and its parts on CAN
    0x22: 0x14,
    0x32: 0x15,
    0x13: 0x16,  # encoders
    0x14: 0x20,  # range
    0x15: 0x24,  # power
    0x16: 0x28,  # link_counters
    0x17: 0x2C,  # planner_state, and its part on CAN
    0x27: 0x2D,
    0x1D: 0x79,  # log_text
    0x1E: 0x78,  # parameter_value
}
"""Type in version 2 for each changed type of version 1."""
_HOST_HELLO = CATALOGUE.by_class[HostHello].type_id
_HELLO_BOOT = 8
"""Offset of the boot id in the host's hello, bytes. Only version 2 has this field."""
_NO_BOOT = bytes(4)
_REPLIES = {CATALOGUE.by_class[kind].type_id for kind in (Ack, Nack)}
_COMMAND_TYPE = 2
"""Offset of the command's type in a reply, bytes."""
_FLAGS = 0x0F
_PART_SIZES = {
    part.can_type: sum(f.wire.size for f in spec.fields if f.can_part == number)
    for spec in CATALOGUE
    if is_native(spec) and not spec.full_stamp
    for number, part in enumerate(spec.can_parts)
}
"""Size of each CAN frame with a short stamp, bytes, by the type in the frame's identifier."""


def is_version_1(reader: LogReader) -> bool:
    """Return True if a log's raw bytes are of protocol version 1."""
    return str(reader.run.get("protocol_version")) == str(_VERSION)


class Version1:
    """Converts the records of one log. The records must be passed in order."""

    def __init__(self) -> None:
        """Start without unfinished frames."""
        self._open = {False: b"", True: b""}
        """Bytes of an unfinished serial frame, by direction."""
        self._transfers: dict[int, list[bytes]] = {}
        """Segments of an unfinished CAN transfer, by identifier."""

    def rewrite(self, record: WireRecord) -> WireRecord:
        """Return the record with the bytes of version 2.

        The bytes of an unfinished frame are returned when its end arrives. Damaged bytes do not
        change.
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
        can_type = _TYPES.get(frame.can_type, frame.can_type)
        frame = frame._replace(can_id=can_type << 4 | frame.node)
        size = _PART_SIZES.get(frame.can_type)
        if size is not None:
            payload, stamp = frame.data[: -T16.size], frame.data[-T16.size :]
            return to_record(frame._replace(data=stamp + payload.ljust(size, b"\0")))
        if frame.can_type in CATALOGUE.by_type and is_native(CATALOGUE.by_type[frame.can_type]):
            return to_record(frame)  # both versions have the full stamp at the start
        return b"".join(
            to_record(frame._replace(data=segment))
            for segment in self._segments(frame.can_id, frame.data)
        )

    def _segments(self, can_id: int, data: bytes) -> list[bytes]:
        """Return the segments of a transfer when it is complete, else an empty list."""
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
                return held  # damaged bytes do not change
        if content[:1] and content[0] >> 4 == _VERSION:
            head = 1 + (T32.size if content[0] & FLAG_WHOLE_STAMP else T16.size)
            content = (
                bytes([PROTOCOL_VERSION << 4 | content[0] & _FLAGS])
                + content[1:head]
                + _payload(can_id >> 4, content[head:])
            )
        return segments(content, tail & TRANSFER)


def _payload(type_id: int, payload: bytes) -> bytes:
    """Return the payload of a message in version 2."""
    if type_id == _HOST_HELLO:
        return payload[:_HELLO_BOOT] + _NO_BOOT + payload[_HELLO_BOOT:]
    if type_id in _REPLIES and len(payload) > _COMMAND_TYPE:
        command_type = payload[_COMMAND_TYPE]
        named = bytes([_TYPES.get(command_type, command_type)])
        return payload[:_COMMAND_TYPE] + named + payload[_COMMAND_TYPE + 1 :]
    spec = CATALOGUE.by_type.get(type_id)
    if spec is not None and spec.direction is Direction.DEVICE and spec.text_field is None:
        return payload.ljust(spec.layout.size, b"\0")
    return payload


def _serial(stretch: bytes) -> bytes:
    """Return the converted bytes between two delimiters."""
    events = UartParser().feed(b"\0" + stretch + b"\0")
    if len(events) != 1 or not isinstance(events[0], Frame) or events[0].version != _VERSION:
        return stretch
    frame = events[0]
    type_id = _TYPES.get(frame.type_id, frame.type_id)
    payload = _payload(type_id, frame.payload)
    flags = frame.version_flags & _FLAGS
    return encode_frame(frame.node, type_id, frame.seq, frame.t_us, payload, flags)[:-1]
