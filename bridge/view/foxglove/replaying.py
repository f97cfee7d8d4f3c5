"""Transfer of a recorded log's messages to the live server."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.record.chunk import OpenChunk
from bridge.record.mcap_file import bytes_of, chunk_record
from bridge.record.mcap_records import Channel, Schema

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.record.chunked_file import ChunkTap
    from bridge.record.reader import LogChannel, LogMessage

_MAX_MESSAGES = 5000
"""Maximum number of messages in one chunk."""


class LogFeed:
    """Packs messages into chunks as in a log, and passes the chunks on."""

    def __init__(self, tap: ChunkTap) -> None:
        """Pass chunks to ``tap``."""
        self._tap = tap
        self._chunk = OpenChunk()
        self._ids: dict[tuple[str, str, str], int] = {}
        tap.begin()

    def take(self, messages: Sequence[LogMessage]) -> None:
        """Pass messages to the tap."""
        for begin in range(0, len(messages), _MAX_MESSAGES):
            declared: list[bytes] = []
            part = messages[begin : begin + _MAX_MESSAGES]
            for channel, log_ns, publish_ns, sequence, data in part:
                number = self._id(channel, declared)
                self._chunk.add(number, log_ns, publish_ns, sequence, data)
            closed = self._chunk.close()
            if closed is not None:
                self._tap.take(b"".join(declared), chunk_record(closed), closed.messages)

    def _id(self, channel: LogChannel, declared: list[bytes]) -> int:
        """Return the number of a channel. Declare the channel if it is new."""
        key = channel.topic, channel.message_encoding, channel.schema_name
        number = self._ids.get(key)
        if number is not None:
            return number
        number = self._ids[key] = len(self._ids) + 1
        schema, schema_id = channel.schema, 0
        if schema is not None:
            schema_id = number
            declared.append(
                bytes_of(
                    Schema(id=number, data=schema.data, encoding=schema.encoding, name=schema.name)
                )
            )
        record = bytes_of(
            Channel(
                id=number,
                topic=channel.topic,
                message_encoding=channel.message_encoding,
                metadata={},
                schema_id=schema_id,
            )
        )
        declared.append(record)
        self._chunk.add_channel(record)
        return number
