"""Reading logs: ours, those of other programs, and those whose end is missing.

The file is read from front to back, so that one without a summary (its writer was killed)
reads like any other, as far as whole chunks go.
"""

from __future__ import annotations

import contextlib
import io
import struct
from array import array
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory

from bridge.record.family import parts_of
from bridge.record.mcap_records import (
    Attachment,
    Channel,
    Declared,
    Metadata,
    Opcode,
    Schema,
    parse,
)
from bridge.record.names import METADATA, SUMMARY_ATTACHMENT
from bridge.record.scan import DamagedBytes, first_end, opened, records
from bridge.record.summaries import read_summary
from bridge.record.unpack import (
    DAMAGE,
    HEAD,
    attachment_is_damaged,
    chunk_content,
    content_records,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator
    from pathlib import Path

    from bridge.record.scan import Bytes

_MESSAGE = struct.Struct("<HIQQ")
_log_ns = attrgetter("log_ns")

_LARGE_BYTES = 16 << 20
"""Size of a chunk's content from which its messages are not all made at once, bytes: they take
up to nine times the content's memory."""
_MAX_HELD_BYTES = 64 << 20
"""Largest attachment whose content is held in memory, bytes; ours have some thousands."""
_HEAD_BYTES = 4096
"""Of a larger attachment: as much as its name needs, bytes."""
_MAX_DECODED_BYTES = 32 << 20
"""Largest message that is decoded, bytes: decoded messages take up to fifty times the memory."""


MISREAD = (
    *(ValueError, AttributeError, TypeError, KeyError, IndexError),
    *(ArithmeticError, RecursionError),
)
"""What reading a decoded message may raise: another program's topic of the same name has other
fields, fields of other types, or values that nobody meant."""
LATEST_NS = (1 << 63) - 1
"""Last moment of Unix time that dates and viewers take, nanoseconds: in the year 2262."""


@dataclass(frozen=True)
class LogChannel:
    """A topic and how its messages are written."""

    topic: str
    schema_name: str
    message_encoding: str
    schema: Schema | None = field(default=None, repr=False, compare=False)

    @cached_property
    def decode(self) -> Callable[[bytes], Any] | None:
        """To a protobuf message, or an object with the ROS message's fields; None: not known.

        It is made when the first message is decoded: a file may declare a channel for each of
        65 535 numbers.
        """
        for factory in (ProtobufDecoderFactory(), RosDecoderFactory()):
            # The library prints what it cannot parse, whatever stands in it.
            with contextlib.suppress(Exception), contextlib.redirect_stderr(io.StringIO()):
                made = factory.decoder_for(self.message_encoding, self.schema)
                if made is not None:
                    return made
        return None


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
        decode = self.channel.decode
        if decode is None:
            raise ValueError(f"{self.topic}: no decoder for {self.channel.message_encoding!r}")
        if len(self.data) > _MAX_DECODED_BYTES:
            raise ValueError(f"{self.topic}: {len(self.data)} bytes are too many to decode")
        try:
            return decode(self.data)
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
        """By name; without those that are too large to be held."""
        self.attachment_bytes: dict[str, int] = {}
        """Size of each, held or not."""
        self.metadata: dict[str, dict[str, str]] = {}
        self.truncated = False
        """The end (of one of the files) is missing: the program that wrote it was killed, or the
        disk was full."""
        self.problems: list[str] = []
        """Damage that was stepped over while messages were read, a line each."""
        self.bytes = 0
        self._head_problems: list[str] = []
        self._declared: list[Declared] = []
        """Schemas and channels of each file's summary: those whose own place is damaged."""
        for part in self.parts:
            self._declared.append(Declared())
            self.truncated |= not self._read_head(part, self._declared[-1])
        if len(self.parts) > 1:
            for name in ("part", "previous"):  # of the last file
                self.run.pop(name, None)
        self.problems = self._head_problems

    def _read_head(self, path: Path, declared: Declared) -> bool:
        """Take what stands around the messages; whether the file is whole."""
        where = f"{path.name}: " if len(self.parts) > 1 else ""
        with opened(path) as data:
            self.bytes += len(data)
            end, whole = first_end(data)
            if end < len(data) and whole:
                rest = f"{len(data) - end} bytes follow the end of the file"
                self._head_problems.append(f"{where}{rest}, as of files joined; see recover")
            in_summary = False
            for found in records(data):
                if isinstance(found, DamagedBytes):
                    if not found.is_tail and not in_summary:
                        size = found.end - found.offset
                        damage = f"{size} bytes at offset {found.offset} are damaged, stepped over"
                        self._head_problems.append(where + damage)
                    continue
                opcode, _, start, end = found
                if opcode in _SKIP_BULK:
                    continue
                if opcode == Opcode.DATA_END:
                    in_summary = True
                elif in_summary and opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                    with contextlib.suppress(*DAMAGE):
                        declared.take(opcode, data[start:end])
                elif not in_summary:
                    try:
                        self._take_head(opcode, data, start, end)
                    except DAMAGE as error:
                        self._head_problems.append(f"damaged record stepped over: {_why(error)}")
        return whole

    def _take_head(self, opcode: int, data: Bytes, start: int, end: int) -> None:
        if opcode == Opcode.ATTACHMENT:
            head = data[start : min(end, start + _HEAD_BYTES)]
            size = end - start
            if size > _MAX_HELD_BYTES:
                name_bytes = int.from_bytes(head[16:20], "little")
                name = head[20 : 20 + name_bytes].decode("utf-8", "replace")
                self._head_problems.append(f"attachment {name} has {size} bytes, too many to read")
                self.attachment_bytes[name] = size
                return
            record = data[start:end]
            attachment = parse(Attachment, record)
            if attachment_is_damaged(record):
                self._head_problems.append(f"attachment {attachment.name} is damaged")
            self.attachments[attachment.name] = attachment.data
            self.attachment_bytes[attachment.name] = len(attachment.data)
            held = sum(map(len, self.attachments.values()))
            if held > _MAX_HELD_BYTES:
                self.attachments[attachment.name] = b""
                self._head_problems.append(
                    f"attachment {attachment.name} is not read: all of them have {held} bytes"
                )
        elif opcode == Opcode.METADATA:
            metadata = parse(Metadata, data[start:end])
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
                try:
                    content = chunk_content(record)
                except DAMAGE as error:
                    self.problems.append(f"damaged chunk stepped over: {_why(error)}")
                    continue
                # A writer may keep a chunk's topics apart, as ours does.
                if len(content) > _LARGE_BYTES:
                    yield from self._of_large(content, state)
                    continue
                found: list[LogMessage] = []
                try:
                    found.extend(within(content, state))
                except DAMAGE as error:
                    self.problems.append(f"damaged chunk stepped over: {_why(error)}")
                yield from sorted(found, key=_log_ns)
            else:
                yield from self._one(opcode, record, state)

    def _of_large(self, content: bytes, state: _Channels) -> Iterator[LogMessage]:
        """Messages of a large chunk, one by one: only their times and places are held."""
        times, places = array("Q"), array("Q")
        try:
            for opcode, start, stop in content_records(content):
                if opcode == Opcode.MESSAGE:
                    channel_id, _, log_ns, _ = _MESSAGE.unpack_from(content, start)
                    if channel_id in state.wanted:
                        times.append(log_ns)
                        places.extend((start, stop))
                else:
                    state.take(opcode, content[start:stop])
        except DAMAGE as error:
            self.problems.append(f"damaged chunk stepped over: {_why(error)}")
        for index in np.argsort(np.frombuffer(times, np.uint64), kind="stable"):
            start, stop = places[2 * index], places[2 * index + 1]
            channel_id, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content, start)
            data = content[start + _MESSAGE.size : stop]
            yield LogMessage(state.wanted[channel_id], log_ns, publish_ns, sequence, data)

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
                if isinstance(found, DamagedBytes):
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
        self._declared = Declared()

    def preload(self, declared: Declared) -> None:
        """Take what the summary declares, until the data declare it themselves."""
        self._declared.preload(declared)
        for channel in self._declared.channels.values():
            self._choose(channel)

    def take(self, opcode: int, record: bytes) -> None:
        """Take a schema or a channel; all other records are left out."""
        channel = self._declared.take(opcode, record)
        if channel is not None:
            self._choose(channel)

    def _choose(self, channel: Channel) -> None:
        self.wanted.pop(channel.id, None)
        if self._topics is None or channel.topic in self._topics:
            schema = self._declared.schemas.get(channel.schema_id)
            name = schema.name if schema is not None else ""
            self.wanted[channel.id] = LogChannel(
                channel.topic, name, channel.message_encoding, schema
            )


def within(content: bytes, state: _Channels) -> Iterator[LogMessage]:
    """The messages of a chunk's content; its declarations go to ``state``."""
    wanted, unpack = state.wanted, _MESSAGE.unpack_from
    for opcode, start, stop in content_records(content):
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_ns, publish_ns = unpack(content, start)
            channel = wanted.get(channel_id)
            if channel is not None:
                data = content[start + _MESSAGE.size : stop]
                yield LogMessage(channel, log_ns, publish_ns, sequence, data)
        else:
            state.take(opcode, content[start:stop])


def _why(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
