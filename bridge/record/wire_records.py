"""The bytes of a wire, out of a log's raw topics."""

from __future__ import annotations

from struct import error as StructError  # noqa: N812 - it is a class
from typing import TYPE_CHECKING, NamedTuple

from bridge.record.reader import MISREAD
from protocol.can.frames import RECORD

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bridge.record.reader import LogMessage

RAW_CAN = "/raw/can"
RAW_TOPICS = frozenset({"/raw/uart/rx", "/raw/uart/tx", RAW_CAN})


class WireRecord(NamedTuple):
    """Bytes of a wire and the moment of their record."""

    log_ns: int
    outgoing: bool
    data: bytes
    """Of a bus: frames in 16 bytes each."""
    is_can: bool


def wire_record(message: LogMessage) -> WireRecord | None:
    """The bytes in a message of a raw topic; None: it is another program's, or damaged."""
    topic = message.channel.topic
    try:
        raw = message.decoded
        if not isinstance(raw.data, bytes | bytearray | list | tuple):
            return None  # a number would become as many zeros
        data = bytes(raw.data)
        if topic == RAW_CAN:
            frame = RECORD.pack(raw.can_id, len(data), data)
            return WireRecord(message.log_ns, bool(raw.outgoing), frame, is_can=True)
    except (*MISREAD, StructError):
        return None
    return WireRecord(message.log_ns, topic.endswith("tx"), data, is_can=False)


def wire_records(messages: Iterable[LogMessage]) -> Iterator[WireRecord]:
    """The bytes of all messages of raw topics."""
    for message in messages:
        if message.channel.topic in RAW_TOPICS:
            record = wire_record(message)
            if record is not None:
                yield record


def in_order(record: WireRecord) -> tuple[int, bool]:
    """What came in was heard before an answer went out in the same moment."""
    return record.log_ns, record.outgoing
