"""Reader of logs: sweepctl's logs, logs of other programs, and incomplete logs.

It reads a file from start to end. If the writer was killed, the file has no summary. Such a file is
read like any other file, up to its last whole chunk.
"""

from __future__ import annotations

import contextlib
import io
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
    MESSAGE_HEAD,
    attachment_is_damaged,
    chunk_content,
    content_records,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator
    from pathlib import Path

    from bridge.record.scan import Bytes

_log_ns = attrgetter("log_ns")

_LARGE_BYTES = 16 << 20
"""Size of a chunk's content above which its messages are created one by one, bytes. All messages of
a chunk together need up to nine times the memory of its content."""
_MAX_HELD_BYTES = 64 << 20
"""Maximum size of an attachment that is read, bytes. Sweepctl's attachments have some kilobytes."""
_HEAD_BYTES = 4096
"""Number of bytes that are read from a larger attachment, to get its name."""
_MAX_DECODED_BYTES = 32 << 20
"""Maximum size of a message that is decoded, bytes. A decoded message needs up to fifty times as
much memory."""


MISREAD = (
    *(ValueError, AttributeError, TypeError, KeyError, IndexError),
    *(ArithmeticError, RecursionError),
)
"""Exceptions that access to a decoded message may raise. In a log of another program, a topic with
a known name may have other fields, types or values."""
LATEST_NS = (1 << 63) - 1
"""Maximum Unix time that date libraries and viewers support, ns: in the year 2262."""


@dataclass(frozen=True)
class LogChannel:
    """A topic and the encoding of its messages."""

    topic: str
    schema_name: str
    message_encoding: str
    schema: Schema | None = field(default=None, repr=False, compare=False)

    @cached_property
    def decode(self) -> Callable[[bytes], Any] | None:
        """Function that decodes to a protobuf message or a ROS object; None: unknown encoding.

        It is created at the first message, because a file may declare 65 535 channels.
        """
        for factory in (ProtobufDecoderFactory(), RosDecoderFactory()):
            # The library prints errors to stderr.
            with contextlib.suppress(Exception), contextlib.redirect_stderr(io.StringIO()):
                made = factory.decoder_for(self.message_encoding, self.schema)
                if made is not None:
                    return made
        return None


class LogMessage(NamedTuple):
    """One message of a log."""

    channel: LogChannel
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes

    @property
    def topic(self) -> str:
        """Topic of the message."""
        return self.channel.topic

    @property
    def decoded(self) -> Any:  # noqa: ANN401 - the type depends on the file's schema
        """The decoded message, with an attribute for each field of the file's schema.

        Raises:
            ValueError: the schema is not usable, the message is too large, or its data are damaged.

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
    """One MCAP file, or a run of several files that starts with this file.

    Each call of ``messages`` reads the file again; only small data are kept in memory.
    ``truncated`` is valid after the constructor. ``problems`` is complete after all messages were
    read.
    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        """Read attachments and metadata, and check whether the file is complete.

        Args:
            path: Path of the file.
            alone: Read only this file, even if the run has several files.

        Raises:
            LogReadError: the file is missing, cannot be read, or is not an MCAP file.

        """
        self.path = path
        self.parts = [path] if alone else parts_of(path)
        """Files of the run."""
        self.attachments: dict[str, bytes] = {}
        """Attachments by name, without those that are too large."""
        self.attachment_bytes: dict[str, int] = {}
        """Size of each attachment, bytes."""
        self.metadata: dict[str, dict[str, str]] = {}
        self.truncated = False
        """True if the end of a file is missing: its writer was killed, or the disk was full."""
        self.problems: list[str] = []
        """Damage that was skipped, one line each."""
        self.bytes = 0
        self._head_problems: list[str] = []
        self._declared: list[Declared] = []
        """Declarations in the summary of each file, used if the declarations in the data are
        damaged."""
        for part in self.parts:
            self._declared.append(Declared())
            self.truncated |= not self._read_head(part, self._declared[-1])
        if len(self.parts) > 1:
            for name in ("part", "previous"):  # these are the last file's
                self.run.pop(name, None)
        self.problems = self._head_problems

    def _read_head(self, path: Path, declared: Declared) -> bool:
        """Read everything except messages; return True if the file is complete."""
        where = f"{path.name}: " if len(self.parts) > 1 else ""
        with opened(path) as data:
            self.bytes += len(data)
            end, whole = first_end(data)
            if end < len(data) and whole:
                rest = f"{len(data) - end} bytes follow the end of the file"
                self._head_problems.append(f"{where}{rest}, joined files; use sweepctl recover")
            in_summary = False
            for found in records(data):
                if isinstance(found, DamagedBytes):
                    if not found.is_tail and not in_summary:
                        size = found.end - found.offset
                        damage = f"{size} bytes at offset {found.offset} are damaged, skipped"
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
                        self._head_problems.append(f"skipped a damaged record: {_why(error)}")
        return whole

    def _take_head(self, opcode: int, data: Bytes, start: int, end: int) -> None:
        if opcode == Opcode.ATTACHMENT:
            head = data[start : min(end, start + _HEAD_BYTES)]
            size = end - start
            if size > _MAX_HELD_BYTES:
                name_bytes = int.from_bytes(head[16:20], "little")
                name = head[20 : 20 + name_bytes].decode("utf-8", "replace")
                self._head_problems.append(f"attachment {name} not read: {size} bytes are too many")
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
                    f"attachment {attachment.name} not read: all together have {held} bytes"
                )
        elif opcode == Opcode.METADATA:
            metadata = parse(Metadata, data[start:end])
            self.metadata.setdefault(metadata.name, {}).update(metadata.metadata)

    @property
    def run(self) -> dict[str, str]:
        """Metadata of the run; empty for a file of another program."""
        return self.metadata.get(METADATA, {})

    @property
    def summary(self) -> dict[str, Any] | None:
        """Summary of the run; None: the log ends before the summary."""
        data = self.attachments.get(SUMMARY_ATTACHMENT)
        return None if data is None else read_summary(data)

    def messages(self, topics: Container[str] | None = None) -> Iterator[LogMessage]:
        """Yield the messages of ``topics`` (None: all), sorted by log time within each chunk.

        Damaged chunks are skipped and listed in ``problems``.
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
                    self.problems.append(f"skipped a damaged chunk: {_why(error)}")
                    continue
                # A writer may group a chunk's messages by topic. Sweepctl's writer does so.
                if len(content) > _LARGE_BYTES:
                    yield from self._of_large(content, state)
                    continue
                found: list[LogMessage] = []
                try:
                    found.extend(within(content, state))
                except DAMAGE as error:
                    self.problems.append(f"skipped a damaged chunk: {_why(error)}")
                yield from sorted(found, key=_log_ns)
            else:
                yield from self._one(opcode, record, state)

    def _of_large(self, content: bytes, state: _Channels) -> Iterator[LogMessage]:
        """Yield a large chunk's messages one by one. Only times and offsets are in memory."""
        times, places = array("Q"), array("Q")
        try:
            for opcode, start, stop in content_records(content):
                if opcode == Opcode.MESSAGE:
                    channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, start)
                    if channel_id in state.wanted:
                        times.append(log_ns)
                        places.extend((start, stop))
                else:
                    state.take(opcode, content[start:stop])
        except DAMAGE as error:
            self.problems.append(f"skipped a damaged chunk: {_why(error)}")
        for index in np.argsort(np.frombuffer(times, np.uint64), kind="stable"):
            start, stop = places[2 * index], places[2 * index + 1]
            channel_id, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(content, start)
            data = content[start + MESSAGE_HEAD.size : stop]
            yield LogMessage(state.wanted[channel_id], log_ns, publish_ns, sequence, data)

    def _one(self, opcode: int, record: bytes, state: _Channels) -> Iterator[LogMessage]:
        """Read a record that is not in a chunk."""
        try:
            if opcode == Opcode.MESSAGE:
                channel_id, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(record)
                channel = state.wanted.get(channel_id)
                if channel is not None:
                    data = record[MESSAGE_HEAD.size :]
                    yield LogMessage(channel, log_ns, publish_ns, sequence, data)
            else:
                state.take(opcode, record)
        except DAMAGE as error:
            self.problems.append(f"skipped a damaged record: {_why(error)}")

    @staticmethod
    def _records(path: Path, skip: frozenset[int]) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of every record before the end of the data."""
        with opened(path) as data:
            for found in records(data):
                if isinstance(found, DamagedBytes):
                    continue  # reported by the constructor
                opcode, _, start, end = found
                if opcode == Opcode.DATA_END:
                    return
                if opcode not in skip:
                    yield opcode, data[start:end]


class ChunkReader:
    """Reads messages from single records."""

    def __init__(self, topics: Container[str] | None = None) -> None:
        self._state = _Channels(topics)

    @staticmethod
    def is_end(opcode: int) -> bool:
        """Return True if this record ends the data."""
        return opcode == Opcode.DATA_END

    def messages(self, opcode: int, record: bytes) -> list[LogMessage]:
        """Return the messages in a record.

        Raises:
            Exception: any error that the library raises on damage.

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
    """Declared channels and schemas, and the selection of channels."""

    def __init__(self, topics: Container[str] | None) -> None:
        self.wanted: dict[int, LogChannel] = {}
        self._topics = topics
        self._declared = Declared()

    def preload(self, declared: Declared) -> None:
        """Use the declarations of a summary for ids that the data have not declared yet."""
        self._declared.preload(declared)
        for channel in self._declared.channels.values():
            self._choose(channel)

    def take(self, opcode: int, record: bytes) -> None:
        """Handle a schema or channel record and ignore others."""
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
    """Yield the messages of a chunk's content. Declarations are added to ``state``."""
    wanted, unpack = state.wanted, MESSAGE_HEAD.unpack_from
    for opcode, start, stop in content_records(content):
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_ns, publish_ns = unpack(content, start)
            channel = wanted.get(channel_id)
            if channel is not None:
                data = content[start + MESSAGE_HEAD.size : stop]
                yield LogMessage(channel, log_ns, publish_ns, sequence, data)
        else:
            state.take(opcode, content[start:stop])


def _why(error: Exception) -> str:
    """Return an error's text as one line."""
    return " ".join(str(error).split()) or type(error).__name__
