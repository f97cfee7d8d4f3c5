"""A new MCAP file out of the records of another: chunks as they are, the summary made anew."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Schema

from bridge.errors import OutputExistsError
from bridge.files import check_target
from bridge.record.errors import LogWriteError
from bridge.record.mcap_file import MAGIC, ZSTD_LEVEL, Chunk, McapFile, bytes_of
from bridge.record.unpack import HEAD, MAX_SCHEMA_BYTES

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO, Self

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


class McapCopy:
    """Writes whole records as they are given, and at the end the summary that they need.

    Numbers of schemas and channels are its own: the same declaration has one number, whatever it
    had where it comes from, and keeps the one that it had where that is free.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        """Create the file.

        Raises:
            OutputExistsError: it exists and ``force`` is not set.
            LogWriteError: it cannot be opened or written.

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
            if kind is None:  # else that is why, and it is on its way
                raise

    @property
    def messages(self) -> int:
        """Messages so far, in chunks."""
        return sum(self._out.counts.values())

    @property
    def chunks(self) -> int:
        """Chunks so far."""
        return self._out.chunk_count

    def header(self, profile: str, library: str) -> None:
        """Write the header, once: before everything else."""
        if not self._has_header:
            self._has_header = True
            self._out.write(bytes_of(Header(profile, library)))

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
        self._out.write(bytes_of(record))

    # ---- content

    def record(self, opcode: int, content: bytes) -> None:
        """Write any other record as it is."""
        self._flush_loose()
        self._out.add_record(HEAD.pack(opcode, len(content)) + content)

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
        self._out.end(self._out.crc)
        self._out.close()

    # ---- inside

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


def _create(path: Path, *, force: bool) -> BinaryIO:
    try:
        check_target(path)
        return path.open("wb" if force else "xb")
    except FileExistsError:
        raise OutputExistsError(path) from None
    except OSError as error:
        raise LogWriteError.of(path, error) from None
