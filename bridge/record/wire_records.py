"""Recorded bytes of a link, from a log's raw topics."""

from __future__ import annotations

from struct import error as StructError  # noqa: N812 - a class name
from typing import TYPE_CHECKING, NamedTuple

from bridge.record.reader import MISREAD
from protocol.can.frames import RECORD

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bridge.record.reader import LogMessage

RAW_CAN = "/raw/can"
RAW_TOPICS = frozenset({"/raw/uart/rx", "/raw/uart/tx", RAW_CAN})


class WireRecord(NamedTuple):
    """Recorded bytes of a link and their time."""

    log_ns: int
    outgoing: bool
    data: bytes
    """Recorded bytes. For a CAN bus, each frame is a record of 16 bytes."""
    is_can: bool


def wire_record(message: LogMessage) -> WireRecord | None:
    """Return the bytes in a message of a raw topic. Return None for other messages."""
    topic = message.channel.topic
    try:
        raw = message.decoded
        if not isinstance(raw.data, bytes | bytearray | list | tuple):
            return None  # bytes(number) would be that many zeros
        data = bytes(raw.data)
        if topic == RAW_CAN:
            frame = RECORD.pack(raw.can_id, len(data), data)
            return WireRecord(message.log_ns, bool(raw.outgoing), frame, is_can=True)
    except (*MISREAD, StructError):
        return None
    return WireRecord(message.log_ns, topic.endswith("tx"), data, is_can=False)


def wire_records(messages: Iterable[LogMessage]) -> Iterator[WireRecord]:
    """Yield the bytes of all messages of raw topics."""
    for message in messages:
        if message.channel.topic in RAW_TOPICS:
            record = wire_record(message)
            if record is not None:
                yield record


def in_order(record: WireRecord) -> tuple[int, bool]:
    """Return the sort key: received bytes come before a reply sent at the same time."""
    return record.log_ns, record.outgoing
