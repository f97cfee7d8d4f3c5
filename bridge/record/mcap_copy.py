"""A new MCAP file out of the records of another: chunks as they are, the summary made anew."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from bridge.record.errors import LogExistsError, LogWriteError
from bridge.record.mcap_file import MAGIC
from bridge.record.unpack import CHUNK_HEAD, HEAD, MAX_SCHEMA_BYTES

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import BinaryIO, Self

_INDEX = struct.Struct("<BQHI")
_LOOSE_BYTES = 256 * 1024
_LAST_ID = (1 << 16) - 1


class Places:
    """Where the messages of a chunk's content stand, by channel."""

    def __init__(self) -> None:
        self.by_channel: dict[int, list[int]] = {}
        """Log time and offset of each message, in turn."""
        self.first_ns = self.last_ns = 0
        self._any = False

    def add(self, channel_id: int, log_ns: int, offset: int) -> None:
        """Note one message."""
        self.by_channel.setdefault(channel_id, []).extend((log_ns, offset))
        if not self._any:
            self._any, self.first_ns, self.last_ns = True, log_ns, log_ns
        self.first_ns, self.last_ns = min(self.first_ns, log_ns), max(self.last_ns, log_ns)


def bytes_of(record: McapRecord) -> bytes:
    """Serialise one record of the library's."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it unannotated


class McapCopy:
    """Writes whole records as they are given, and at the end the summary that they need.

    Numbers of schemas and channels are its own: the same declaration has one number, whatever it
    had where it comes from, and keeps the one that it had where that is free.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        """Create the file.

        Raises:
            LogExistsError: it exists and ``force`` is not set.
            LogWriteError: it cannot be opened or written.

        """
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.messages = 0
        self.chunks = 0
        self._file = _create(path, force=force)
        self._offset = 0
        self._crc = 0
        self._schema_ids: dict[bytes, int] = {}
        self._channel_ids: dict[bytes, int] = {}
        self._schema_bytes = 0
        self._has_header = False
        self._counts: dict[int, int] = {}
        self._span_ns: tuple[int, int] | None = None
        self._chunk_indexes: list[bytes] = []
        self._attachments: list[bytes] = []
        self._metadata: list[bytes] = []
        self._loose = bytearray()
        self._loose_places = Places()
        self._write(MAGIC)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._file.close()
        except OSError as error:
            if kind is None:  # else that is why, and it is on its way
                raise LogWriteError(self.path, error.strerror or str(error)) from None

    def header(self, profile: str, library: str) -> None:
        """Write the header, once: before everything else."""
        if not self._has_header:
            self._has_header = True
            self._write(bytes_of(Header(profile, library)))

    # ---- declarations

    def schema(self, schema: Schema) -> int:
        """Declare a schema; gives its number here.

        Raises:
            ValueError: no number is left, or the schemas are larger than anybody's.

        """
        key = _key(schema)
        number = self._schema_ids.get(key)
        if number is None:
            if self._schema_bytes + len(schema.data) > MAX_SCHEMA_BYTES:
                raise ValueError("its schemas are too large")
            self._schema_bytes += len(schema.data)
            number = _free(self.schemas, schema.id)
            schema = Schema(id=number, data=schema.data, encoding=schema.encoding, name=schema.name)
            self._schema_ids[key] = number
            self.schemas[number] = schema
            self._declare(schema)
        return number

    def channel(self, channel: Channel, schema_id: int) -> int:
        """Declare a channel with a schema of this file; gives its number here.

        Raises:
            ValueError: no number is left.

        """
        topic, encoding, notes = channel.topic, channel.message_encoding, channel.metadata
        channel = Channel(channel.id, topic, encoding, notes, schema_id)
        key = _key(channel)
        number = self._channel_ids.get(key)
        if number is None:
            number = _free(self.channels, channel.id)
            channel = Channel(number, topic, encoding, notes, schema_id)
            self._channel_ids[key] = number
            self.channels[number] = channel
            self._declare(channel)
        return number

    def _declare(self, record: Schema | Channel) -> None:
        self._flush_loose()
        self._write(bytes_of(record))

    # ---- content

    def record(self, opcode: int, content: bytes) -> None:
        """Write any other record as it is."""
        self._flush_loose()
        offset, data = self._offset, HEAD.pack(opcode, len(content)) + content
        self._write(data)
        if opcode == Opcode.ATTACHMENT:
            self._attachments.append(_attachment_index(content, offset, len(data)))
        elif opcode == Opcode.METADATA:
            (size,) = struct.unpack_from("<I", content)
            name = content[4 : 4 + size].decode("utf-8", "replace")
            self._metadata.append(bytes_of(MetadataIndex(offset, len(data), name)))

    def chunk(
        self, compression: str, packed: bytes | memoryview, content: bytes, places: Places
    ) -> None:
        """Write a chunk whose content is packed already, and index it."""
        self._flush_loose()
        self._chunk(compression, packed, content, places)

    def message(self, content: bytes, channel_id: int, log_ns: int) -> None:
        """Write a message that stood outside chunks; it goes into one."""
        self._loose_places.add(channel_id, log_ns, len(self._loose))
        self._loose += HEAD.pack(Opcode.MESSAGE, len(content)) + content
        if len(self._loose) >= _LOOSE_BYTES:
            self._flush_loose()

    def finish(self) -> None:
        """Write the summary and the end.

        Raises:
            LogWriteError: it could not be written.

        """
        self._flush_loose()
        self._write(bytes_of(DataEnd(self._crc)))
        start = self._offset
        groups: tuple[tuple[Opcode, Sequence[bytes]], ...] = (
            (Opcode.SCHEMA, [bytes_of(s) for s in self.schemas.values()]),
            (Opcode.CHANNEL, [bytes_of(c) for c in self.channels.values()]),
            (Opcode.STATISTICS, [bytes_of(self._statistics())]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        summary, offsets = bytearray(), bytearray()
        for opcode, records in groups:
            if not records:
                continue
            begin = start + len(summary)
            summary += b"".join(records)
            offsets += bytes_of(SummaryOffset(int(opcode), begin, start + len(summary) - begin))
        offsets_start = start + len(summary)
        body = bytes(summary + offsets)
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        crc = zlib.crc32(head, zlib.crc32(body))
        self._write(body + bytes_of(Footer(start, offsets_start, crc)) + MAGIC)
        try:
            self._file.close()
        except OSError as error:
            raise LogWriteError(self.path, error.strerror or str(error)) from None

    # ---- inside

    def _flush_loose(self) -> None:
        if not self._loose:
            return
        content, places = bytes(self._loose), self._loose_places
        self._loose, self._loose_places = bytearray(), Places()
        packed = zstandard.ZstdCompressor(level=1).compress(content)
        self._chunk("zstd", packed, content, places)

    def _chunk(
        self, compression: str, packed: bytes | memoryview, content: bytes, places: Places
    ) -> None:
        name, packed = compression.encode(), memoryview(packed)
        size = CHUNK_HEAD.size + 4 + len(name) + 8 + len(packed)
        start, length = self._offset, HEAD.size + size
        head = HEAD.pack(Opcode.CHUNK, size)
        head += CHUNK_HEAD.pack(places.first_ns, places.last_ns, len(content), zlib.crc32(content))
        head += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(packed))
        self._write(head)
        self._write(packed)
        indexes, offsets = bytearray(), dict[int, int]()
        for channel_id, entries in places.by_channel.items():
            offsets[channel_id] = start + length + len(indexes)
            size = 8 * len(entries)
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            indexes += struct.pack(f"<{len(entries)}Q", *entries)
            count = len(entries) // 2
            self._counts[channel_id] = self._counts.get(channel_id, 0) + count
            self.messages += count
        self._write(bytes(indexes))
        self.chunks += 1
        self._chunk_indexes.append(
            bytes_of(
                ChunkIndex(
                    chunk_length=length,
                    chunk_start_offset=start,
                    compression=compression,
                    compressed_size=len(packed),
                    message_end_time=places.last_ns,
                    message_index_length=len(indexes),
                    message_index_offsets=offsets,
                    message_start_time=places.first_ns,
                    uncompressed_size=len(content),
                )
            )
        )
        if places.by_channel:
            first, last = self._span_ns or (places.first_ns, places.last_ns)
            self._span_ns = min(first, places.first_ns), max(last, places.last_ns)

    def _statistics(self) -> Statistics:
        first_ns, last_ns = self._span_ns or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self.channels),
            channel_message_counts=self._counts,
            chunk_count=self.chunks,
            message_count=self.messages,
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self.schemas),
        )

    def _write(self, data: bytes | memoryview) -> None:
        try:
            self._file.write(data)
        except OSError as error:
            raise LogWriteError(self.path, error.strerror or str(error)) from None
        self._offset += memoryview(data).nbytes
        self._crc = zlib.crc32(data, self._crc)


def _key(record: Schema | Channel) -> bytes:
    """What makes a declaration the same as another: all but its number."""
    data = bytes_of(record)
    return data[: HEAD.size] + data[HEAD.size + 2 :]


def _free(used: dict[int, Any], wanted: int) -> int:
    """A number that is free, the wanted one where possible; 0 is none.

    Raises:
        ValueError: all of them are taken.

    """
    if wanted and wanted not in used:
        return wanted
    number = next((n for n in range(len(used) + 1, 0, -1) if n not in used), None)
    if number is None or number > _LAST_ID:
        number = next((n for n in range(1, _LAST_ID + 1) if n not in used), None)
    if number is None:
        raise ValueError("no number is left for another schema or channel")
    return number


def _attachment_index(content: bytes, offset: int, length: int) -> bytes:
    log_ns, create_ns, size = struct.unpack_from("<QQI", content)
    name = content[20 : 20 + size]
    position = 20 + size
    (size,) = struct.unpack_from("<I", content, position)
    media_type = content[position + 4 : position + 4 + size]
    (data_size,) = struct.unpack_from("<Q", content, position + 4 + size)
    return bytes_of(
        AttachmentIndex(
            offset=offset,
            length=length,
            log_time=log_ns,
            create_time=create_ns,
            data_size=data_size,
            name=name.decode("utf-8", "replace"),
            media_type=media_type.decode("utf-8", "replace"),
        )
    )


def _create(path: Path, *, force: bool) -> BinaryIO:
    try:
        return path.open("wb" if force else "xb")
    except FileExistsError:
        raise LogExistsError(path) from None
    except OSError as error:
        raise LogWriteError(path, error.strerror or str(error)) from None
