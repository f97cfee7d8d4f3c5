"""MCAP file that closes chunks by log time and by size.

:class:`Rows` stores messages of a fixed form and packs all of them when a chunk closes. This is
faster than packing each message when it arrives.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Protocol

from mcap.records import Attachment, Channel, Header, Metadata, Schema

from bridge.record.chunk import CHUNK_BYTES, OpenChunk
from bridge.record.errors import LogWriteError
from bridge.record.mcap_file import MAGIC, McapFile, bytes_of, chunk_record
from bridge.record.storage import open_log_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from io import FileIO
    from pathlib import Path

    from bridge.record.encode.rows import RowMessage, Rows


class LogOpener(Protocol):
    """Creates a log's file."""

    def __call__(self, path: Path, *, force: bool) -> FileIO:
        """Open ``path`` for writing, or raise a :class:`LogError`."""


class ChunkTap(Protocol):
    """Receives the records of a log when they are written.

    The methods run in the writer's thread and must not block.
    """

    def begin(self) -> None:
        """Start a new file. Ids of schemas and channels count from 1 again."""

    def take(self, declarations: bytes, chunk: bytes, messages: int) -> None:
        """Take a chunk.

        Args:
            declarations: records of the schemas and channels that are new since the last chunk.
            chunk: record of the chunk.
            messages: number of its messages.

        """


class ChunkedFile:
    """Writes one MCAP file in whole chunks. Not thread-safe.

    After a failed write the file ends with its last whole chunk, which stays readable. Every later
    call raises the same :class:`LogWriteError`; :meth:`finish` still tries to complete the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        force: bool = False,
        library: str = "sweepctl",
        opener: LogOpener = open_log_file,
        tap: ChunkTap | None = None,
    ) -> None:
        """Create the file. ``tap`` receives a copy of its chunks.

        Raises:
            OutputExistsError: the file exists, and ``force`` is False.
            LogWriteError: the file cannot be opened or written.

        """
        self.out = McapFile(path, opener(path, force=force))
        """File for whole records."""
        self.chunk = OpenChunk()
        """The open chunk; public for callers that append many rows."""
        self._schema_ids: dict[str, int] = {}
        self._tap = tap
        self._declarations: list[bytes] = []
        """Records of schemas and channels that the tap does not have yet."""
        if tap is not None:
            tap.begin()
        self.closed = False
        try:
            self.out.write(MAGIC + bytes_of(Header(profile="", library=library)))
        except LogWriteError:
            self.out.close()
            if not force and path.is_file():  # a new file without content
                path.unlink(missing_ok=True)
            raise

    # ---- input

    def add_attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Close the open chunk and write an attachment."""
        self.flush()
        self.out.add_record(bytes_of(Attachment(time_ns, time_ns, name, media_type, data)))

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Close the open chunk and write named key-value pairs."""
        self.flush()
        self.out.add_record(bytes_of(Metadata(name=name, metadata=data)))

    def add_channel(self, topic: str, message_encoding: str, schema: tuple[str, str, bytes]) -> int:
        """Declare a topic with its schema (name, encoding, data); return the channel's id."""
        name, encoding, data = schema
        schemas, channels = self.out.schemas, self.out.channels
        schema_id = self._schema_ids.get(name)
        if schema_id is None:
            schema_id = self._schema_ids[name] = len(schemas) + 1
            schemas[schema_id] = Schema(id=schema_id, data=data, encoding=encoding, name=name)
            self._declarations.append(bytes_of(schemas[schema_id]))
            self.chunk.declare(self._declarations[-1])
        channel_id = len(channels) + 1
        channels[channel_id] = Channel(
            id=channel_id,
            topic=topic,
            message_encoding=message_encoding,
            metadata={},
            schema_id=schema_id,
        )
        self._declarations.append(bytes_of(channels[channel_id]))
        self.chunk.add_channel(self._declarations[-1])
        return channel_id

    def add_message(
        self, channel_id: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """Add one message; first close the open chunk if it is full or too old.

        Raises:
            LogWriteError: the file cannot be written.

        """
        chunk = self.chunk
        if not chunk.earliest_ns <= log_ns < chunk.deadline_ns or chunk.size >= CHUNK_BYTES:
            self.next_chunk(log_ns)
        chunk.add(channel_id, log_ns, publish_ns, sequence, data)

    def rows(self, ints: int, floats: int, messages: Iterable[RowMessage]) -> Rows:
        """Declare messages that always occur together; see :class:`Rows`."""
        return self.chunk.rows(ints, floats, messages)

    def begin_row(self, log_ns: int, size: int) -> int:
        """Reserve space for a row of this log time, before it is appended; return its place.

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
        """Close the open chunk and start one with a message of this time.

        Raises:
            LogWriteError: the file cannot be written.

        """
        self.flush()
        self.chunk.begin(log_ns)

    # ---- output

    def flush(self) -> None:
        """Close the open chunk and write it.

        Raises:
            LogWriteError: this write or an earlier write failed.

        """
        if self.out.failure is not None:
            raise self.out.failure
        closed = self.chunk.close()
        if closed is None:
            return
        self.out.add_chunk(closed)
        if self._tap is not None:
            declarations = b"".join(self._declarations)
            self._tap.take(declarations, chunk_record(closed), closed.messages)
        self._declarations.clear()

    def finish(self) -> None:
        """Close the last chunk, write the summary and close the file. It may be called again.

        Raises:
            LogWriteError: the end could not be written. The chunks before the end are complete.

        """
        if self.closed:
            return
        self.closed = True
        out = self.out
        failed_before = out.failure is not None
        try:
            if not failed_before:
                self.flush()
        except LogWriteError:
            # The failed chunk is discarded. Its disk space may be enough for the summary.
            out.failure = None
            out.end()
            raise
        else:
            out.failure = None
            with contextlib.suppress(LogWriteError) if failed_before else contextlib.nullcontext():
                out.end()
        finally:
            out.close()
