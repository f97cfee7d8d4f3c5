"""What a file's own summary says of the records before it: kinds, places, declarations, counts."""

from __future__ import annotations

import contextlib
import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema, Statistics

from bridge.record.errors import LogReadError
from bridge.record.mcap_file import MAGIC
from bridge.record.scan import Found, first_end, records
from bridge.record.unpack import DAMAGE, HEAD, MAX_SCHEMA_BYTES

if TYPE_CHECKING:
    from bridge.record.scan import Bytes

_FOOTER = struct.Struct("<BQQQI")
_DATA_END = struct.Struct("<BQI")


@dataclass(slots=True)
class FileSummary:
    """What the summary says; empty where there is none, or it is damaged."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    kinds: dict[int, int] = field(default_factory=dict)
    """Opcode of the record at each place that an index names, from the file's beginning."""
    counts: dict[int, int] | None = None
    """Messages of each channel; None where that is not said."""
    schema_bytes: int = 0
    """Of all schemas together."""
    start: int | None = None
    """Where it begins, from the file's beginning."""
    is_proven: bool = False
    """Its checksum holds."""

    def take(self, opcode: int, content: bytes, begin: int) -> None:
        """Take one record of the summary of a file that begins at ``begin``.

        Raises:
            Exception: one of what the library raises on damage.

        """
        stream = ReadDataStream(BytesIO(content))
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schema_bytes += len(schema.data)
                if self.schema_bytes <= MAX_SCHEMA_BYTES:
                    self.schemas.setdefault(schema.id, schema)
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels.setdefault(channel.id, channel)
            case Opcode.CHUNK_INDEX:
                place = ChunkIndex.read(stream).chunk_start_offset
                self.kinds[begin + place] = Opcode.CHUNK
            case Opcode.ATTACHMENT_INDEX:
                place = AttachmentIndex.read(stream).offset
                self.kinds[begin + place] = Opcode.ATTACHMENT
            case Opcode.METADATA_INDEX:
                place = MetadataIndex.read(stream).offset
                self.kinds[begin + place] = Opcode.METADATA
            case Opcode.STATISTICS:
                self.counts = Statistics.read(stream).channel_message_counts


def read_file_summary(data: Bytes, begin: int, end: int) -> FileSummary:
    """Read the summary of the file from ``begin`` to ``end``; damage makes it shorter or empty."""
    summary = FileSummary()
    footer = end - len(MAGIC) - _FOOTER.size
    if footer <= begin or data[end - len(MAGIC) : end] != MAGIC:
        return summary
    opcode, length, start, _, crc = _FOOTER.unpack_from(data, footer)
    start += begin
    if opcode != Opcode.FOOTER or length != _FOOTER.size - HEAD.size or not begin < start <= footer:
        return summary
    content = data[start : end - len(MAGIC) - 4]
    summary.is_proven = crc != 0 and zlib.crc32(content) == crc
    with contextlib.suppress(*DAMAGE, LogReadError):
        for found in records(data, start):
            if not isinstance(found, Found) or found.opcode == Opcode.FOOTER:
                break
            summary.start = start
            summary.take(found.opcode, data[found.start : found.end], begin)
    return summary


def is_summary_of(data: Bytes, begin: int, end: int) -> bool:
    """Whether the footer before ``end`` names a summary behind the data of the file at ``begin``.

    It takes one look at the footer and one at the record before the summary, whatever their sizes.
    """
    footer = end - len(MAGIC) - _FOOTER.size
    if footer <= begin:
        return False
    start = begin + _FOOTER.unpack_from(data, footer)[2]
    before = start - _DATA_END.size
    if not begin < before < start <= footer:
        return False
    opcode: int
    length: int
    opcode, length, _ = _DATA_END.unpack_from(data, before)
    return opcode == Opcode.DATA_END and length == _DATA_END.size - HEAD.size


def summary_declarations(data: Bytes) -> dict[tuple[type, int], Schema | Channel]:
    """Schemas and channels of the first file's summary, by kind and id; none where damaged."""
    summary = read_file_summary(data, 0, first_end(data)[0])
    declared: dict[tuple[type, int], Schema | Channel] = {}
    declared |= {(Schema, number): schema for number, schema in summary.schemas.items()}
    declared |= {(Channel, number): channel for number, channel in summary.channels.items()}
    return declared
