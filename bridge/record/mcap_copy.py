"""Writer of a copy of an MCAP file: chunks are copied unchanged, but the summary is new."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Schema

from bridge.errors import OutputExistsError
from bridge.files import writing_mode
from bridge.record.errors import LogWriteError
from bridge.record.mcap_file import MAGIC, ZSTD_LEVEL, Chunk, McapFile, bytes_of
from bridge.record.unpack import HEAD, MAX_SCHEMA_BYTES

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO, Self

_LOOSE_BYTES = 256 * 1024
_LAST_ID = (1 << 16) - 1


class Places:
    """Log times and offsets of a chunk's messages, by channel."""

    def __init__(self) -> None:
        self.by_channel: dict[int, list[int]] = {}
        """Alternating log time and offset of each message, by channel."""
        self.first_ns = self.last_ns = 0
        self._any = False

    def add(self, channel_id: int, log_ns: int, offset: int) -> None:
        """Add one message."""
        self.by_channel.setdefault(channel_id, []).extend((log_ns, offset))
        if not self._any:
            self._any, self.first_ns, self.last_ns = True, log_ns, log_ns
        self.first_ns, self.last_ns = min(self.first_ns, log_ns), max(self.last_ns, log_ns)


class McapCopy:
    """Writes whole records, and at the end a summary of them.

    The copy has its own ids of schemas and channels. Equal declarations get one id. This is the id
    in the source file if it is free.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        """Create the file.

        Raises:
            OutputExistsError: the file exists, and ``force`` is False.
            LogWriteError: the file cannot be opened or written.

        """
        self._out = McapFile(path, _create(path, force=force))
        self.schemas, self.channels = self._out.schemas, self._out.channels
        self._schema_ids: dict[bytes, int] = {}
        self._channel_ids: dict[bytes, int] = {}
        self._schema_bytes = 0
        self._has_header = False
        self._loose = bytearray()
        self._loose_places = Places()
        self._out.write(MAGIC)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._out.close()
        except LogWriteError:
            if kind is None:  # otherwise the block's exception has priority
                raise

    @property
    def messages(self) -> int:
        """Number of messages in chunks."""
        return sum(self._out.counts.values())

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return self._out.chunk_count

    def header(self, profile: str, library: str) -> None:
        """Write the header, once and before all other records."""
        if not self._has_header:
            self._has_header = True
            self._out.write(bytes_of(Header(profile, library)))

    # ---- declarations

    def schema(self, schema: Schema) -> int:
        """Declare a schema; return its id in this file.

        Raises:
            ValueError: no id is free, or the schemas are too large.

        """
        key = _key(schema)
        number = self._schema_ids.get(key)
        if number is None:
            if self._schema_bytes + len(schema.data) > MAX_SCHEMA_BYTES:
                raise ValueError("the file's schemas are too large")
            self._schema_bytes += len(schema.data)
            number = _free(self.schemas, schema.id)
            schema = Schema(id=number, data=schema.data, encoding=schema.encoding, name=schema.name)
            self._schema_ids[key] = number
            self.schemas[number] = schema
            self._declare(schema)
        return number

    def channel(self, channel: Channel, schema_id: int) -> int:
        """Declare a channel with a schema of this file; return its id in this file.

        Raises:
            ValueError: no id is free.

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
        self._out.write(bytes_of(record))

    # ---- content

    def record(self, opcode: int, content: bytes) -> None:
        """Write a record that needs no special handling, unchanged."""
        self._flush_loose()
        self._out.add_record(HEAD.pack(opcode, len(content)) + content)

    def chunk(
        self, compression: str, packed: bytes | memoryview, content: bytes, places: Places
    ) -> None:
        """Write a chunk with packed content, and index it."""
        self._flush_loose()
        self._chunk(compression, packed, content, places)

    def message(self, content: bytes, channel_id: int, log_ns: int) -> None:
        """Write a message into a chunk. In the source file, the message was outside a chunk."""
        self._loose_places.add(channel_id, log_ns, len(self._loose))
        self._loose += HEAD.pack(Opcode.MESSAGE, len(content)) + content
        if len(self._loose) >= _LOOSE_BYTES:
            self._flush_loose()

    def finish(self) -> None:
        """Write the summary and the end.

        Raises:
            LogWriteError: the summary could not be written.

        """
        self._flush_loose()
        self._out.end(self._out.crc)
        self._out.close()

    # ---- chunks

    def _flush_loose(self) -> None:
        if not self._loose:
            return
        content, places = bytes(self._loose), self._loose_places
        self._loose, self._loose_places = bytearray(), Places()
        packed = zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress(content)
        self._chunk("zstd", packed, content, places)

    def _chunk(
        self, compression: str, packed: bytes | memoryview, content: bytes, places: Places
    ) -> None:
        entries = {
            channel_id: struct.pack(f"<{len(both)}Q", *both)
            for channel_id, both in places.by_channel.items()
        }
        self._out.add_chunk(
            Chunk(
                compression,
                packed,
                len(content),
                zlib.crc32(content),
                places.first_ns,
                places.last_ns,
                entries,
            )
        )


def _key(record: Schema | Channel) -> bytes:
    """Return the bytes of a declaration without its id. Equal bytes mean equal declarations."""
    data = bytes_of(record)
    return data[: HEAD.size] + data[HEAD.size + 2 :]


def _free(used: dict[int, Any], wanted: int) -> int:
    """Return a free id: ``wanted`` if it is free. The id 0 is not allowed.

    Raises:
        ValueError: all ids are used.

    """
    if wanted and wanted not in used:
        return wanted
    number = next((n for n in range(len(used) + 1, 0, -1) if n not in used), None)
    if number is None or number > _LAST_ID:
        number = next((n for n in range(1, _LAST_ID + 1) if n not in used), None)
    if number is None:
        raise ValueError("no free id for another schema or channel")
    return number


def _create(path: Path, *, force: bool) -> BinaryIO:
    try:
        return path.open(writing_mode(path, force=force))
    except FileExistsError:
        raise OutputExistsError(path) from None
    except OSError as error:
        raise LogWriteError.of(path, error) from None
