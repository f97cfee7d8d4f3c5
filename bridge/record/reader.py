"""Reading logs: ours, those of other programs, and those whose end is missing.

The file is read from front to back, so that one without a summary (its writer was killed)
reads like any other, as far as whole chunks go.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from dataclasses import dataclass
from io import BytesIO
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory
from zstandard import ZstdError

from bridge.record.family import parts_of
from bridge.record.names import METADATA, SUMMARY_ATTACHMENT
from bridge.record.scan import CHUNK_HEAD, HEAD, Damage, is_whole, opened, records
from bridge.record.summaries import read_summary

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator
    from pathlib import Path

_MESSAGE = struct.Struct("<HIQQ")
_TEXT, _SIZE = struct.Struct("<I"), struct.Struct("<Q")
_log_ns = attrgetter("log_ns")

MAX_CHUNK_BYTES = 512 * 1024 * 1024
"""A chunk that claims more is taken for damage, not for a reason to fill the memory."""

DAMAGE = (
    *(McapError, ZstdError, struct.error, ValueError, KeyError),
    *(EOFError, OverflowError, RuntimeError, MemoryError),
)
"""What the library raises on content that is not what it should be."""


@dataclass(frozen=True, slots=True)
class LogChannel:
    """A topic and how its messages are written."""

    topic: str
    schema_name: str
    message_encoding: str
    decode: Callable[[bytes], Any] | None
    """To a protobuf message, or an object with the ROS message's fields; None: not known."""


class LogMessage(NamedTuple):
    """One message as it stands in the file."""

    channel: LogChannel
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes

    @property
    def topic(self) -> str:
        """The topic it was written to."""
        return self.channel.topic

    @property
    def decoded(self) -> Any:  # noqa: ANN401 - whatever the file's own schema says
        """The message by the schema in the file: attributes by field name.

        Raises:
            ValueError: the file has no schema that we can read for it, or the data is damaged.

        """
        if self.channel.decode is None:
            raise ValueError(f"{self.topic}: no decoder for {self.channel.message_encoding!r}")
        try:
            return self.channel.decode(self.data)
        except Exception as error:
            raise ValueError(f"{self.topic}: damaged message: {error}") from error


class LogReader:
    """One MCAP file, or the run in several files that begins with it (see ``family``).

    Every call reads the file anew; nothing is kept but small things. ``truncated`` and
    ``problems`` are complete once the file has been read to its end, which the constructor does
    for everything but the messages.
    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        """Read attachments and metadata, and see whether the file is whole.

        ``alone``: read this file only, whatever run it belongs to.

        Raises:
            LogReadError: it is missing, cannot be read, or is no MCAP file.

        """
        self.path = path
        self.parts = [path] if alone else parts_of(path)
        """The files that are read."""
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.truncated = False
        """The end (of one of the files) is missing: the program that wrote it was killed, or the
        disk was full."""
        self.problems: list[str] = []
        """Damage that was stepped over while messages were read, a line each."""
        self.bytes = 0
        self._head_problems: list[str] = []
        self._declared: list[list[tuple[int, bytes]]] = []
        """Schemas and channels of each file's summary: those whose own place is damaged."""
        for part in self.parts:
            self._declared.append([])
            self.truncated |= not self._read_head(part, self._declared[-1])
        if len(self.parts) > 1:
            for name in ("part", "previous"):  # of the last file
                self.run.pop(name, None)
        self.problems = self._head_problems

    def _read_head(self, path: Path, declared: list[tuple[int, bytes]]) -> bool:
        """Take what stands around the messages; whether the file is whole."""
        whole = False
        with opened(path) as data:
            self.bytes += len(data)
            in_summary = False
            for found in records(data):
                if isinstance(found, Damage):
                    if not found.is_tail and not in_summary:
                        size = found.end - found.offset
                        where = f"{path.name}: " if len(self.parts) > 1 else ""
                        told = f"{size} bytes at offset {found.offset} are damaged, stepped over"
                        self._head_problems.append(where + told)
                    continue
                opcode, _, start, end = found
                if opcode in _SKIP_BULK:
                    continue
                if opcode == Opcode.DATA_END:
                    in_summary = True
                    whole = is_whole(data)
                elif in_summary and opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                    declared.append((opcode, data[start:end]))
                elif not in_summary:
                    try:
                        self._take_head(opcode, data[start:end])
                    except DAMAGE as error:
                        self._head_problems.append(f"damaged record stepped over: {_why(error)}")
        return whole

    def _take_head(self, opcode: int, record: bytes) -> None:
        if opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(_stream(record))
            if attachment_is_damaged(record):
                self._head_problems.append(f"attachment {attachment.name} is damaged")
            self.attachments[attachment.name] = attachment.data
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(_stream(record))
            self.metadata.setdefault(metadata.name, {}).update(metadata.metadata)

    @property
    def run(self) -> dict[str, str]:
        """What the run says of itself; empty where another program wrote the file."""
        return self.metadata.get(METADATA, {})

    @property
    def summary(self) -> dict[str, Any] | None:
        """The run's summary, where it came to one."""
        data = self.attachments.get(SUMMARY_ATTACHMENT)
        return None if data is None else read_summary(data)

    def messages(self, topics: Container[str] | None = None) -> Iterator[LogMessage]:
        """Every message (of these topics): chunk by chunk, in each by log time.

        A damaged chunk is stepped over and named in ``problems``.
        """
        self.problems = self._head_problems.copy()
        for part, declared in zip(self.parts, self._declared, strict=True):
            state = _Channels(topics)
            state.preload(declared)
            yield from self._of_part(part, state)

    def _of_part(self, path: Path, state: _Channels) -> Iterator[LogMessage]:
        for opcode, record in self._records(path, _SKIP_INDEXES):
            if opcode == Opcode.CHUNK:
                found: list[LogMessage] = []
                try:
                    found.extend(within(chunk_content(record), state))
                except DAMAGE as error:
                    self.problems.append(f"damaged chunk stepped over: {_why(error)}")
                # A writer may keep a chunk's topics apart, as ours does.
                yield from sorted(found, key=_log_ns)
            else:
                yield from self._one(opcode, record, state)

    def _one(self, opcode: int, record: bytes, state: _Channels) -> Iterator[LogMessage]:
        """Read a record that stands outside chunks."""
        try:
            if opcode == Opcode.MESSAGE:
                channel_id, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(record)
                channel = state.wanted.get(channel_id)
                if channel is not None:
                    data = record[_MESSAGE.size :]
                    yield LogMessage(channel, log_ns, publish_ns, sequence, data)
            else:
                state.take(opcode, record)
        except DAMAGE as error:
            self.problems.append(f"damaged record stepped over: {_why(error)}")

    @staticmethod
    def _records(path: Path, skip: frozenset[int]) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of every record up to the end of the data."""
        with opened(path) as data:
            for found in records(data):
                if isinstance(found, Damage):
                    continue  # told once, by the constructor
                opcode, _, start, end = found
                if opcode == Opcode.DATA_END:
                    return
                if opcode not in skip:
                    yield opcode, data[start:end]


class ChunkReader:
    """Messages out of records that come one by one."""

    def __init__(self, topics: Container[str] | None = None) -> None:
        self._state = _Channels(topics)

    @staticmethod
    def is_end(opcode: int) -> bool:
        """Whether this record ends the data."""
        return opcode == Opcode.DATA_END

    def messages(self, opcode: int, record: bytes) -> list[LogMessage]:
        """What a record holds.

        Raises:
            Exception: one of what the library raises on damage.

        """
        if opcode in _SKIP_INDEXES:
            return []
        if opcode == Opcode.CHUNK:
            return sorted(within(chunk_content(record), self._state), key=_log_ns)
        if opcode == Opcode.MESSAGE:
            return list(within(HEAD.pack(opcode, len(record)) + record, self._state))
        self._state.take(opcode, record)
        return []


_SKIP_BULK = frozenset({int(Opcode.CHUNK), int(Opcode.MESSAGE), int(Opcode.MESSAGE_INDEX)})
_SKIP_INDEXES = frozenset({int(Opcode.MESSAGE_INDEX), int(Opcode.ATTACHMENT), int(Opcode.METADATA)})


class _Channels:
    """Channels and schemas met so far, and which of them are asked for."""

    def __init__(self, topics: Container[str] | None) -> None:
        self.wanted: dict[int, LogChannel] = {}
        self._topics = topics
        self._schemas: dict[int, Schema] = {}
        self._preloaded: set[int] = set()
        self._factories = (ProtobufDecoderFactory(), RosDecoderFactory())

    def preload(self, declared: list[tuple[int, bytes]]) -> None:
        """Take what the summary declares, until the data declare it themselves."""
        for opcode, record in declared:
            with contextlib.suppress(*DAMAGE):
                self.take(opcode, record)
        self._preloaded = set(self.wanted)

    def take(self, opcode: int, record: bytes) -> None:
        """Take a schema or a channel; all other records are left out."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(record))
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(record))
            if channel.id in self._preloaded:
                self._preloaded.discard(channel.id)
                del self.wanted[channel.id]
            if channel.id not in self.wanted and (
                self._topics is None or channel.topic in self._topics
            ):
                self.wanted[channel.id] = self._describe(channel)

    def _describe(self, channel: Channel) -> LogChannel:
        schema = self._schemas.get(channel.schema_id)
        decode = None
        for factory in self._factories:
            try:
                decode = decode or factory.decoder_for(channel.message_encoding, schema)
            except Exception:  # noqa: BLE001, S112 - a schema that no parser takes has no decoder
                continue
        name = schema.name if schema is not None else ""
        return LogChannel(channel.topic, name, channel.message_encoding, decode)


def within(content: bytes, state: _Channels) -> Iterator[LogMessage]:
    """The messages of a chunk's content; its declarations go to ``state``."""
    position, end = 0, len(content)
    wanted, unpack = state.wanted, _MESSAGE.unpack_from
    while position < end:
        opcode, length = HEAD.unpack_from(content, position)
        position += HEAD.size
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_ns, publish_ns = unpack(content, position)
            channel = wanted.get(channel_id)
            if channel is not None:
                data = content[position + _MESSAGE.size : position + length]
                yield LogMessage(channel, log_ns, publish_ns, sequence, data)
        else:
            state.take(opcode, content[position : position + length])
        position += length


def _stream(record: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(record))


def chunk_content(record: bytes) -> bytes:
    """Unpack a chunk's records; its CRC is checked.

    Raises:
        Exception: one of what the library raises on damage.

    """
    _, _, size, crc = CHUNK_HEAD.unpack_from(record)
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"it claims {size} bytes")
    begin = CHUNK_HEAD.size + _TEXT.size
    (length,) = _TEXT.unpack_from(record, CHUNK_HEAD.size)
    compression, begin = record[begin : begin + length], begin + length + _SIZE.size
    (length,) = _SIZE.unpack_from(record, begin - _SIZE.size)
    packed = memoryview(record)[begin : begin + length]
    if compression not in {b"zstd", b""}:  # the library knows what else there may be
        stream, length = get_chunk_data_stream(Chunk.read(_stream(record)), validate_crc=True)
        return stream.read(length)
    if compression:
        content: bytes = zstandard.decompress(packed, max_output_size=size)
    else:
        content = bytes(packed)
    if crc and zlib.crc32(content) != crc:
        raise ValueError("its checksum does not hold")
    return content


def attachment_is_damaged(record: bytes) -> bool:
    """Whether an attachment's own CRC says so; 0: it has none."""
    stored = int.from_bytes(record[-4:], "little")
    return stored != 0 and stored != zlib.crc32(record[:-4])


def _why(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
