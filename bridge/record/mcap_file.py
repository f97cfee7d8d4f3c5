"""An MCAP file whose chunks close by log time as well as by size.

The container's records are the mcap library's; its writer is not used, because it spends
10.9 µs on a message where this spends 1.8 µs (measured), and closes chunks by size only, so
that a kill loses whatever the last mebibyte held. Messages of fixed length that come together
are cheaper still: :class:`Rows` packs a chunk's, headers included, in one go.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from typing import TYPE_CHECKING, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from bridge.record.chunk import CHUNK_BYTES, ZSTD_LEVEL, OpenChunk
from bridge.record.errors import LogGoneError, LogWriteError
from bridge.record.storage import open_log_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from io import FileIO
    from pathlib import Path

    from bridge.record.encode.rows import RowMessage, Rows

MAGIC = b"\x89MCAP0\r\n"


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it unannotated


class LogOpener(Protocol):
    """Creates a log's file."""

    def __call__(self, path: Path, *, force: bool) -> FileIO:
        """Open it for writing, or raise a :class:`LogError`."""


class _Packed:
    """Records that wait for the file's end, compressed: an hour has 14 400 chunks to index."""

    _BLOCK_BYTES = 128 * 1024

    def __init__(self, zstd: zstandard.ZstdCompressor) -> None:
        self.count = 0
        self._zstd = zstd
        self._blocks: list[bytes] = []
        self._pending = bytearray()

    def append(self, record: bytes) -> None:
        """Keep one more."""
        self.count += 1
        self._pending += record
        if len(self._pending) >= self._BLOCK_BYTES:
            self._blocks.append(self._zstd.compress(bytes(self._pending)))
            self._pending.clear()

    def __iter__(self) -> Iterator[bytes]:
        """All of them in order, in pieces of many records."""
        for block in self._blocks:
            yield zstandard.decompress(block)
        yield bytes(self._pending)


class ChunkedFile:
    """Writes one MCAP file, a whole chunk at a time. Not for several threads at once.

    After a failed write the file ends with its last whole chunk: what was recorded before
    stays readable, every later call raises the same :class:`LogWriteError`, and
    :meth:`finish` still tries to close the file whole.
    """

    def __init__(
        self,
        path: Path,
        *,
        force: bool = False,
        library: str = "sweepctl",
        opener: LogOpener = open_log_file,
    ) -> None:
        """Create the file.

        Raises:
            LogExistsError: it exists and ``force`` is not set.
            LogWriteError: it cannot be opened or written.

        """
        self.path = path
        self.offset = 0
        """Bytes written so far, all of them whole records."""
        self.failure: LogWriteError | None = None
        self._file = opener(path, force=force)
        self.chunk = OpenChunk()
        """The one in progress, for who appends many rows."""
        self._schemas: dict[int, Schema] = {}
        self._schema_ids: dict[str, int] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: list[int] = []
        self._chunks = _Packed(zstandard.ZstdCompressor(level=ZSTD_LEVEL))
        """The chunks' index records."""
        self._span_ns: tuple[int, int] | None = None
        """Log times of the first and the last message."""
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.closed = False
        try:
            self._write(MAGIC + _bytes_of(Header(profile="", library=library)))
        except LogWriteError:
            self._file.close()
            if not force:  # it is ours, and says nothing
                path.unlink(missing_ok=True)
            raise

    # ---- what goes in

    def add_attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Write a file within the file, after the chunk in progress."""
        self.flush()
        record = _bytes_of(Attachment(time_ns, time_ns, name, media_type, data))
        index = AttachmentIndex(
            offset=self.offset,
            length=len(record),
            log_time=time_ns,
            create_time=time_ns,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._write(record)
        self._attachments.append(index)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write named key-value pairs, after the chunk in progress."""
        self.flush()
        record = _bytes_of(Metadata(name=name, metadata=data))
        index = MetadataIndex(offset=self.offset, length=len(record), name=name)
        self._write(record)
        self._metadata.append(index)

    def add_channel(self, topic: str, message_encoding: str, schema: tuple[str, str, bytes]) -> int:
        """Declare a topic with its schema (name, encoding, data); gives the channel's id."""
        name, encoding, data = schema
        schema_id = self._schema_ids.get(name)
        if schema_id is None:
            schema_id = self._schema_ids[name] = len(self._schemas) + 1
            self._schemas[schema_id] = Schema(id=schema_id, data=data, encoding=encoding, name=name)
            self.chunk.declare(_bytes_of(self._schemas[schema_id]))
        channel_id = len(self._channels) + 1
        self._channels[channel_id] = Channel(
            id=channel_id,
            topic=topic,
            message_encoding=message_encoding,
            metadata={},
            schema_id=schema_id,
        )
        self._counts.append(0)
        self.chunk.add_channel(_bytes_of(self._channels[channel_id]))
        return channel_id

    def add_message(
        self, channel_id: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """Add one message; closes the chunk in progress where it is full or old enough.

        Raises:
            LogWriteError: the file cannot be written.

        """
        chunk = self.chunk
        if not chunk.earliest_ns <= log_ns < chunk.deadline_ns or chunk.size >= CHUNK_BYTES:
            self.next_chunk(log_ns)
        chunk.add(channel_id, log_ns, publish_ns, sequence, data)

    def rows(self, ints: int, floats: int, messages: Iterable[RowMessage]) -> Rows:
        """Declare messages that always come together; see :class:`Rows`."""
        return self.chunk.rows(ints, floats, messages)

    def begin_row(self, log_ns: int, size: int) -> int:
        """Make room for a row of this log time, before it is appended; gives its place.

        Raises:
            LogWriteError: the file cannot be written.

        """
        chunk = self.chunk
        if not chunk.earliest_ns <= log_ns < chunk.deadline_ns or chunk.size >= CHUNK_BYTES:
            self.next_chunk(log_ns)
        place = chunk.size
        chunk.size = place + size
        return place

    def next_chunk(self, log_ns: int) -> None:
        """Close the chunk in progress and begin one with a message of this time.

        Raises:
            LogWriteError: the file cannot be written.

        """
        self.flush()
        self.chunk.begin(log_ns)

    # ---- what comes out

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the operating system.

        Raises:
            LogWriteError: it could not be written, now or earlier.

        """
        if self.failure is not None:
            raise self.failure
        closed = self.chunk.close(self.offset)
        if closed is None:
            return
        self._write(closed.data)
        self._chunks.append(closed.described)
        first_ns, last_ns = closed.first_ns, closed.last_ns
        earliest_ns, latest_ns = self._span_ns or (first_ns, last_ns)
        self._span_ns = min(first_ns, earliest_ns), max(last_ns, latest_ns)
        for channel_id, count in closed.counts.items():
            self._counts[channel_id - 1] += count

    def finish(self) -> None:
        """Close the last chunk, write the summary and close the file; again is no error.

        Raises:
            LogWriteError: the end could not be written; the chunks before it are whole.

        """
        if self.closed:
            return
        self.closed = True
        failed_before = self.failure is not None
        try:
            if not failed_before:
                self.flush()
        except LogWriteError:
            # The room that the cut chunk gave back may be enough for the summary.
            self.failure = None
            self._write_end()
            raise
        else:
            self.failure = None
            with contextlib.suppress(LogWriteError) if failed_before else contextlib.nullcontext():
                self._write_end()
        finally:
            self._file.close()

    def _write_end(self) -> None:
        data_end = _bytes_of(DataEnd(0))
        start = self.offset + len(data_end)
        summary, offsets = bytearray(), bytearray()
        groups: tuple[tuple[Opcode, Iterable[bytes]], ...] = (
            (Opcode.SCHEMA, map(_bytes_of, self._schemas.values())),
            (Opcode.CHANNEL, map(_bytes_of, self._channels.values())),
            (Opcode.STATISTICS, (_bytes_of(self._statistics()),)),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, map(_bytes_of, self._attachments)),
            (Opcode.METADATA_INDEX, map(_bytes_of, self._metadata)),
        )
        for opcode, records in groups:
            group_start = start + len(summary)
            for record in records:
                summary += record
            length = start + len(summary) - group_start
            offsets += _bytes_of(SummaryOffset(int(opcode), group_start, length))
        offsets_start = start + len(summary)
        body = bytes(summary + offsets)
        # The CRC covers the summary and the footer up to the CRC itself.
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        crc = zlib.crc32(footer_head, zlib.crc32(body))
        self._write(data_end + body + _bytes_of(Footer(start, offsets_start, crc)) + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts={c: n for c, n in enumerate(self._counts, 1) if n},
            chunk_count=self._chunks.count,
            message_count=sum(self._counts),
            message_end_time=self._span_ns[1] if self._span_ns else 0,
            message_start_time=self._span_ns[0] if self._span_ns else 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        """Append whole records, or cut the file back to the records before them."""
        if self.failure is not None:
            raise self.failure
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            with contextlib.suppress(OSError):  # a full device may not even be cut
                self._file.truncate(self.offset)
                self._file.seek(self.offset)
            kind = LogGoneError if isinstance(error, FileNotFoundError) else LogWriteError
            self.failure = kind(self.path, error.strerror or str(error))
            raise self.failure from None
        self.offset += len(data)
