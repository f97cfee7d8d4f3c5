"""Parsing of single records of an MCAP file."""

from __future__ import annotations

from io import BytesIO
from typing import TypeVar, cast

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    Schema,
)

from bridge.record.unpack import MAX_SCHEMA_BYTES

__all__ = [
    "Attachment",
    "Channel",
    "Declared",
    "Header",
    "MessageIndex",
    "Metadata",
    "Opcode",
    "Schema",
    "parse",
]

_Record = TypeVar("_Record", bound=McapRecord)


def parse(kind: type[_Record], content: bytes) -> _Record:
    """Parse a record's content, without opcode and length."""
    read = kind.read  # type: ignore[attr-defined]  # every record class used here has it
    return cast("_Record", read(ReadDataStream(BytesIO(content))))


class Declared:
    """Schemas and channels that a file has declared so far."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._preloaded: set[int] = set()
        self.schema_bytes = 0
        """Size of all schemas, bytes."""

    def preload(self, summary: Declared) -> None:
        """Use the declarations of a summary for ids that the data have not declared yet."""
        self.schemas, self.schema_bytes = summary.schemas.copy(), summary.schema_bytes
        self.channels = summary.channels.copy()
        self._preloaded = set(self.channels)

    def take(self, opcode: int, content: bytes) -> Channel | None:
        """Handle a schema or channel record and ignore others. Return a new channel, or None.

        Raises:
            Exception: any error that the library raises on damage.
            ValueError: the schemas are too large.

        """
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, content)
            before = self.schemas.get(schema.id)
            size = self.schema_bytes + len(schema.data) - (len(before.data) if before else 0)
            if size > MAX_SCHEMA_BYTES:
                raise ValueError(f"the file's schemas have more than {MAX_SCHEMA_BYTES} bytes")
            self.schema_bytes = size
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, content)
            if channel.id not in self.channels or channel.id in self._preloaded:
                self._preloaded.discard(channel.id)
                self.channels[channel.id] = channel
                return channel
        return None
