"""Metadata and small attachments of a log, without its messages.

In a complete file, the index at the end gives their offsets, so reading takes constant time. An
incomplete file has no index, so its records are read one by one.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.record.file_summary import FOOTER, is_summary_of
from bridge.record.mcap_file import MAGIC
from bridge.record.mcap_records import Attachment, Metadata, Opcode, parse
from bridge.record.names import CATALOGUE_ATTACHMENT, METADATA, SUMMARY_ATTACHMENT
from bridge.record.scan import DamagedBytes, Found, opened, records
from bridge.record.summaries import read_summary
from bridge.record.unpack import DAMAGE, HEAD, attachment_is_damaged

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

    from bridge.record.scan import Bytes

_MAX_ATTACHMENT_BYTES = 4 << 20
"""Maximum size of an attachment that is read, bytes. A run's summary and robot file have some
kilobytes, and a room file has at most a few hundred kilobytes."""
_INDEXES = {
    int(Opcode.ATTACHMENT_INDEX): int(Opcode.ATTACHMENT),
    int(Opcode.METADATA_INDEX): int(Opcode.METADATA),
}
"""Kind of the record to which an index record points."""
_PLACE = struct.Struct("<QQ")
_NAME_AT = 20
"""Offset of the name in an attachment, bytes. Two times and the length of the name precede it."""


@dataclass(slots=True)
class LogHead:
    """One log file without its messages."""

    file_bytes: int
    whole: bool
    """False: the end is missing, because the file is still being written or its writer was
    killed."""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    """Damage among the records that were read, one line each."""

    @property
    def run(self) -> dict[str, str]:
        """Metadata of the run; empty for a file of another program."""
        return self.metadata.get(METADATA, {})

    @property
    def summary(self) -> dict[str, Any] | None:
        """Summary of the run; None: the log ends before the summary."""
        data = self.attachments.get(SUMMARY_ATTACHMENT)
        return None if data is None else read_summary(data)


def read_head(path: Path) -> LogHead:
    """Read one file's metadata and attachments.

    Raises:
        LogReadError: the file is missing, cannot be read, or is not an MCAP file.

    """
    with opened(path) as data:
        whole = is_summary_of(data, 0, len(data))
        head = LogHead(len(data), whole)
        listed = _indexed(data) if whole else None
        for found in _scanned(data, head) if listed is None else listed:
            try:
                _take(head, data, found)
            except DAMAGE as error:
                head.problems.append(f"a damaged record was skipped: {error}")
    return head


def _indexed(data: Bytes) -> list[Found] | None:
    """Return the records that the summary section lists; None: the summary is damaged."""
    size = len(data)
    footer = size - len(MAGIC) - FOOTER.size
    position, found = FOOTER.unpack_from(data, footer)[2], []
    while position + HEAD.size <= footer:
        opcode, length = HEAD.unpack_from(data, position)
        start = position + HEAD.size
        position = start + length
        if opcode == 0 or position > footer:
            return None
        if opcode in _INDEXES:
            # Both kinds of index records begin with the offset and the length of the record they
            # point to.
            offset, whole = _PLACE.unpack_from(data, start)
            if whole < HEAD.size or offset + whole > size or data[offset] != _INDEXES[opcode]:
                return None
            found.append(Found(data[offset], offset, offset + HEAD.size, offset + whole))
    return sorted(found, key=lambda each: each.offset)


def _scanned(data: Bytes, head: LogHead) -> Iterator[Found]:
    for found in records(data, indexes=False):
        if not isinstance(found, DamagedBytes):
            yield found
        elif not found.is_tail:
            size = found.end - found.offset
            head.problems.append(f"{size} bytes at offset {found.offset} are damaged")


def _is_catalogue(data: Bytes, start: int) -> bool:
    """Return True if an attachment is the catalogue, which is by far the largest attachment."""
    name = start + _NAME_AT
    return data[name : name + len(CATALOGUE_ATTACHMENT)] == CATALOGUE_ATTACHMENT.encode()


def _take(head: LogHead, data: Bytes, found: Found) -> None:
    opcode, _, start, end = found
    if opcode == Opcode.ATTACHMENT and _is_catalogue(data, start):
        return
    if opcode == Opcode.METADATA:
        metadata = parse(Metadata, data[start:end])
        head.metadata.setdefault(metadata.name, {}).update(metadata.metadata)
    elif opcode == Opcode.ATTACHMENT and end - start <= _MAX_ATTACHMENT_BYTES:
        record = data[start:end]
        attachment = parse(Attachment, record)
        if attachment_is_damaged(record):
            head.problems.append(f"attachment {attachment.name} is damaged")
        else:
            head.attachments[attachment.name] = attachment.data
