"""The summary section of an MCAP file: record types, offsets, declarations and counts."""

from __future__ import annotations

import contextlib
import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, MetadataIndex, Statistics

from bridge.record.errors import LogReadError
from bridge.record.mcap_file import MAGIC
from bridge.record.mcap_records import Declared, parse
from bridge.record.scan import Found, records
from bridge.record.unpack import DAMAGE, HEAD

if TYPE_CHECKING:
    from bridge.record.scan import Bytes

FOOTER = struct.Struct("<BQQQI")
_DATA_END = struct.Struct("<BQI")


@dataclass(slots=True)
class FileSummary:
    """Content of the summary section; empty if it is missing or damaged."""

    declared: Declared = field(default_factory=Declared)
    kinds: dict[int, int] = field(default_factory=dict)
    """Opcode of each indexed record, by its offset in the whole data."""
    counts: dict[int, int] | None = None
    """Number of messages per channel; None: no statistics."""
    start: int | None = None
    """Offset of the summary in the whole data; None: no summary."""
    is_proven: bool = False
    """True if the summary's CRC matches."""

    def take(self, opcode: int, content: bytes, begin: int) -> None:
        """Handle one record of the summary of a file that starts at ``begin``.

        Raises:
            Exception: any error that the library raises on damage.

        """
        match opcode:
            case Opcode.SCHEMA | Opcode.CHANNEL:
                self.declared.take(opcode, content)
            case Opcode.CHUNK_INDEX:
                place = parse(ChunkIndex, content).chunk_start_offset
                self.kinds[begin + place] = Opcode.CHUNK
            case Opcode.ATTACHMENT_INDEX:
                place = parse(AttachmentIndex, content).offset
                self.kinds[begin + place] = Opcode.ATTACHMENT
            case Opcode.METADATA_INDEX:
                place = parse(MetadataIndex, content).offset
                self.kinds[begin + place] = Opcode.METADATA
            case Opcode.STATISTICS:
                self.counts = parse(Statistics, content).channel_message_counts


def read_file_summary(data: Bytes, begin: int, end: int) -> FileSummary:
    """Read the summary of the file between two offsets. Damage ends the summary early."""
    summary = FileSummary()
    footer = end - len(MAGIC) - FOOTER.size
    if footer <= begin or data[end - len(MAGIC) : end] != MAGIC:
        return summary
    opcode, length, start, _, crc = FOOTER.unpack_from(data, footer)
    start += begin
    if opcode != Opcode.FOOTER or length != FOOTER.size - HEAD.size or not begin < start <= footer:
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
    """Return True if the footer before ``end`` belongs to the file at ``begin``.

    The function reads only the footer and the record before the summary, in constant time.
    """
    footer = end - len(MAGIC) - FOOTER.size
    if footer <= begin:
        return False
    start = begin + FOOTER.unpack_from(data, footer)[2]
    before = start - _DATA_END.size
    if not begin < before < start <= footer:
        return False
    opcode: int
    length: int
    opcode, length, _ = _DATA_END.unpack_from(data, before)
    return opcode == Opcode.DATA_END and length == _DATA_END.size - HEAD.size
