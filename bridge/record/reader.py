"""Reading logs: ours, those of other programs, and those whose end is missing.

The file is read from front to back, so that one without a summary (its writer was killed)
reads like any other, as far as whole chunks go.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory
from zstandard import ZstdError

from bridge.record.chunked import MAGIC
from bridge.record.errors import LogReadError
from bridge.record.writer import METADATA, SUMMARY_ATTACHMENT

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator
    from pathlib import Path
    from typing import BinaryIO

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")

MAX_CHUNK_BYTES = 512 * 1024 * 1024
"""A chunk that claims more is taken for damage, not for a reason to fill the memory."""

_DAMAGE = (
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
    """One MCAP file. Every call reads the file anew; nothing is kept but small things.

    ``truncated`` and ``problems`` are complete once the file has been read to its end, which
    the constructor does for everything but the messages.
    """

    def __init__(self, path: Path) -> None:
        """Read attachments and metadata, and see whether the file is whole.

        Raises:
            LogReadError: it is missing, cannot be read, or is no MCAP file.

        """
        self.path = path
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.truncated = True
        """The end is missing: the program that wrote it was killed, or the disk was full."""
        self.problems: list[str] = []
        """Damage that was stepped over while messages were read, a line each."""
        self.bytes = 0
        self._head_problems: list[str] = []
        for opcode, record in self._records(_SKIP_BULK):
            try:
                self._take_head(opcode, record)
            except _DAMAGE as error:
                self._head_problems.append(f"damaged record stepped over: {error!r}")
        self.problems = self._head_problems

    def _take_head(self, opcode: int, record: bytes) -> None:
        if opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(_stream(record))
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
        try:
            value = json.loads(self.attachments[SUMMARY_ATTACHMENT])
        except (KeyError, ValueError):
            return None
        return value if isinstance(value, dict) else None

    def messages(self, topics: Container[str] | None = None) -> Iterator[LogMessage]:
        """Every message (of these topics), in the order of the file.

        A damaged chunk is stepped over and named in ``problems``.
        """
        state = _Channels(topics)
        self.problems = self._head_problems.copy()
        for opcode, record in self._records(_SKIP_INDEXES):
            if opcode == Opcode.CHUNK:
                try:
                    content = _chunk_content(record)
                    yield from self._within(content, state)
                except _DAMAGE as error:
                    self.problems.append(f"damaged chunk stepped over: {error!r}")
            else:
                yield from self._one(opcode, record, state)

    def _within(self, content: bytes, state: _Channels) -> Iterator[LogMessage]:
        position, end = 0, len(content)
        wanted, unpack = state.wanted, _MESSAGE.unpack_from
        while position < end:
            opcode, length = _HEAD.unpack_from(content, position)
            position += _HEAD.size
            if opcode == Opcode.MESSAGE:
                channel_id, sequence, log_ns, publish_ns = unpack(content, position)
                channel = wanted.get(channel_id)
                if channel is not None:
                    data = content[position + _MESSAGE.size : position + length]
                    yield LogMessage(channel, log_ns, publish_ns, sequence, data)
            else:
                state.take(opcode, content[position : position + length])
            position += length

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
        except _DAMAGE as error:
            self.problems.append(f"damaged record stepped over: {error!r}")

    def _records(self, skip: frozenset[int]) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of every whole record up to the end of the data."""
        self.truncated = True
        try:
            with self.path.open("rb") as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise LogReadError(self.path, "it is not an MCAP file")
                self.bytes = self.path.stat().st_size
                yield from self._data_records(file, skip)
        except OSError as error:
            raise LogReadError(self.path, error.strerror or str(error)) from None

    def _data_records(self, file: BinaryIO, skip: frozenset[int]) -> Iterator[tuple[int, bytes]]:
        while True:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return
            opcode, length = _HEAD.unpack(head)
            if file.tell() + length > self.bytes:
                return
            if opcode == Opcode.DATA_END:
                file.seek(self.bytes - len(MAGIC))
                self.truncated = file.read() != MAGIC
                return
            if opcode in skip:
                file.seek(length, 1)
            else:
                yield opcode, file.read(length)


_SKIP_BULK = frozenset({int(Opcode.CHUNK), int(Opcode.MESSAGE), int(Opcode.MESSAGE_INDEX)})
_SKIP_INDEXES = frozenset({int(Opcode.MESSAGE_INDEX), int(Opcode.ATTACHMENT), int(Opcode.METADATA)})


class _Channels:
    """Channels and schemas met so far, and which of them are asked for."""

    def __init__(self, topics: Container[str] | None) -> None:
        self.wanted: dict[int, LogChannel] = {}
        self._topics = topics
        self._schemas: dict[int, Schema] = {}
        self._factories = (ProtobufDecoderFactory(), RosDecoderFactory())

    def take(self, opcode: int, record: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(record))
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(record))
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


def _stream(record: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(record))


def _chunk_content(record: bytes) -> bytes:
    chunk = Chunk.read(_stream(record))
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError(f"it claims {chunk.uncompressed_size} bytes")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(length)
