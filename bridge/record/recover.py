"""What can be saved of a damaged log: everything that still proves to be whole.

Chunks are copied as they are, after their content was unpacked and its CRC compared. A damaged
one is left out, wherever it stands, and what was in it is told from the message indexes that
follow it. Of a last chunk that was cut, what still unpacks is kept. A schema or a channel that
was declared in a lost chunk is taken from the file's summary.
"""

from __future__ import annotations

import contextlib
import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, MessageIndex, Schema

from bridge.record.copied import McapCopy, Places
from bridge.record.errors import LogReadError, LogWriteError
from bridge.record.reader import DAMAGE, attachment_is_damaged, chunk_content
from bridge.record.scan import CHUNK_HEAD, HEAD, Damage, is_whole, opened, records

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bridge.record.scan import Bytes

_MESSAGE = struct.Struct("<HIQQ")
_LONGEST_SHOWN = 4


@dataclass(slots=True)
class Loss:
    """One stretch of the file that could not be kept."""

    offset: int
    bytes: int
    what: str
    start_ns: int | None = None
    """Log time of the first message that it is known to have held."""
    end_ns: int | None = None
    messages: dict[str, int] = field(default_factory=dict)
    """How many of each topic, where the file still says so."""

    def text(self) -> str:
        """In one line."""
        line = f"{self.what} at byte {self.offset} ({self.bytes} bytes)"
        total = sum(self.messages.values())
        if total:
            most = sorted(self.messages.items(), key=lambda item: -item[1])
            names = ", ".join(f"{topic} {n}" for topic, n in most[:_LONGEST_SHOWN])
            more = ", …" if len(most) > _LONGEST_SHOWN else ""
            line += f": {total} messages ({names}{more})"
        return line


@dataclass(slots=True)
class Recovery:
    """What became of a file."""

    source: Path
    target: Path
    whole: bool
    """The source had its end."""
    messages: int = 0
    chunks: int = 0
    rescued: int = 0
    """Of the messages, those out of a chunk that was cut."""
    attachments: int = 0
    metadata: int = 0
    undeclared: int = 0
    """Messages whose channel's declaration is lost: kept, under ``/undeclared/<channel>``."""
    losses: list[Loss] = field(default_factory=list)

    @property
    def lost_messages(self) -> int:
        """As far as the file still says; what was cut off is not counted."""
        return sum(sum(loss.messages.values()) for loss in self.losses)

    def as_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        return {
            "source": str(self.source),
            "out": str(self.target),
            "whole": self.whole,
            "messages": self.messages,
            "chunks": self.chunks,
            "rescued_from_a_cut_chunk": self.rescued,
            "attachments": self.attachments,
            "metadata": self.metadata,
            "undeclared": self.undeclared,
            "lost_messages": self.lost_messages,
            "losses": [
                {
                    "offset": loss.offset,
                    "bytes": loss.bytes,
                    "what": loss.what,
                    "start_ns": loss.start_ns,
                    "end_ns": loss.end_ns,
                    "messages": loss.messages,
                }
                for loss in self.losses
            ],
        }


def recover(source: Path, target: Path, *, force: bool = False) -> Recovery:
    """Copy what is whole of one file into another.

    Raises:
        LogReadError: the source is missing, cannot be read, or is no MCAP file.
        LogExistsError: the target exists and ``force`` is not set.
        LogWriteError: the target cannot be written, or is the source itself.

    """
    with opened(source) as data:
        if target.exists() and target.samefile(source):
            raise LogWriteError(target, "it is the file to recover; give another name")
        with McapCopy(target, force=force) as copy:
            work = _Recoverer(data, copy, Recovery(source, target, is_whole(data)))
            work.run()
            copy.finish()
            work.result.messages, work.result.chunks = copy.messages, copy.chunks
            return work.result


class _Recoverer:
    def __init__(self, data: Bytes, copy: McapCopy, result: Recovery) -> None:
        self.result = result
        self._data, self._copy = data, copy
        self._declared = summary_declarations(data)
        self._loss: Loss | None = None
        """The last one, as long as message indexes may follow that say what it held."""

    def run(self) -> None:
        handlers = {
            int(Opcode.SCHEMA): self._schema,
            int(Opcode.CHANNEL): self._channel,
            int(Opcode.MESSAGE): self._message,
            int(Opcode.CHUNK): self._chunk,
            int(Opcode.MESSAGE_INDEX): self._index,
            int(Opcode.ATTACHMENT): self._attachment,
            int(Opcode.METADATA): self._metadata,
        }
        for found in records(self._data):
            if isinstance(found, Damage):
                self._damaged(found)
                continue
            opcode, offset, start, end = found
            if opcode == Opcode.DATA_END:
                return
            if opcode != Opcode.MESSAGE_INDEX:
                self._loss = None
            handler = handlers.get(opcode)
            if handler is not None:
                handler(offset, self._data[start:end])
            elif opcode == Opcode.HEADER or opcode > Opcode.DATA_END:
                self._copy.record(opcode, self._data[start:end])

    # ---- damage

    def _lose(self, offset: int, size: int, what: str) -> Loss:
        self._loss = Loss(offset, size, what)
        self.result.losses.append(self._loss)
        return self._loss

    def _damaged(self, damage: Damage) -> None:
        offset, end, is_tail = damage
        if is_tail and self._rescue_tail(offset, end):
            return
        what = "a record that was cut" if is_tail else "damaged bytes"
        loss = self._lose(offset, end - offset, what)
        with contextlib.suppress(struct.error):
            opcode, _ = HEAD.unpack_from(self._data, offset)
            if opcode == Opcode.CHUNK:
                loss.what = "a chunk that was cut" if is_tail else "a damaged chunk"

    def _rescue_tail(self, offset: int, end: int) -> bool:
        """Keep the messages of a cut chunk that still unpack; True where it is all told."""
        data = self._data
        if offset + HEAD.size + CHUNK_HEAD.size + 12 > end or data[offset] != Opcode.CHUNK:
            return False
        begin = offset + HEAD.size + CHUNK_HEAD.size
        size = int.from_bytes(data[begin : begin + 4], "little")
        name, body = bytes(data[begin + 4 : begin + 4 + size]), begin + 4 + size + 8
        compressed = bytes(data[body:end])
        content = compressed if name == b"" else b""
        if name == b"zstd":
            with contextlib.suppress(zstandard.ZstdError):
                content = zstandard.ZstdDecompressor().decompressobj().decompress(compressed)
        kept = 0
        with contextlib.suppress(*DAMAGE):
            for opcode, start, stop in _within(content):
                if opcode == Opcode.MESSAGE:
                    self._message(offset, content[start:stop])
                    kept += 1
                elif opcode == Opcode.SCHEMA:
                    self._schema(offset, content[start:stop])
                elif opcode == Opcode.CHANNEL:
                    self._channel(offset, content[start:stop])
        self.result.rescued += kept
        self._lose(
            offset,
            end - offset,
            "the rest of a chunk that was cut" if kept else "a chunk that was cut",
        )
        return True

    # ---- records, each with its content

    def _schema(self, offset: int, content: bytes) -> None:
        try:
            self._copy.declare(Schema.read(_stream(content)))
        except DAMAGE:
            self._lose(offset, len(content), "a damaged schema")

    def _channel(self, offset: int, content: bytes) -> None:
        try:
            self._copy.declare(Channel.read(_stream(content)))
        except DAMAGE:
            self._lose(offset, len(content), "a damaged channel")

    def _message(self, offset: int, content: bytes) -> None:
        try:
            channel_id, _, log_ns, _ = _MESSAGE.unpack_from(content)
        except struct.error:
            self._lose(offset, len(content), "a damaged message")
            return
        self._know({channel_id: 1})
        self._copy.message(content, channel_id, log_ns)

    def _chunk(self, offset: int, content: bytes) -> None:
        copy = self._copy
        try:
            unpacked = chunk_content(content)
            places, declared = Places(), list[Schema | Channel]()
            for opcode, start, stop in _within(unpacked):
                if opcode == Opcode.MESSAGE:
                    channel_id, _, log_ns, _ = _MESSAGE.unpack_from(unpacked, start)
                    places.add(channel_id, log_ns, start - HEAD.size)
                elif opcode == Opcode.SCHEMA:
                    declared.append(Schema.read(_stream(unpacked[start:stop])))
                elif opcode == Opcode.CHANNEL:
                    declared.append(Channel.read(_stream(unpacked[start:stop])))
        except DAMAGE:
            loss = self._lose(offset, HEAD.size + len(content), "a damaged chunk")
            loss.start_ns, loss.end_ns, _, _ = CHUNK_HEAD.unpack_from(content)
            return
        for record in declared:
            copy.note(record)
        self._know({c: len(entries) // 2 for c, entries in places.by_channel.items()})
        copy.chunk(content, places)

    def _index(self, _offset: int, content: bytes) -> None:
        """What a lost chunk held, from the index that follows it."""
        if self._loss is None:
            return
        with contextlib.suppress(*DAMAGE):
            index = MessageIndex.read(_stream(content))
            topic = self._topic(index.channel_id)
            counts, times = self._loss.messages, [entry[0] for entry in index.records]
            counts[topic] = counts.get(topic, 0) + len(times)
            if times:
                self._loss.start_ns = min([*times, self._loss.start_ns or times[0]])
                self._loss.end_ns = max([*times, self._loss.end_ns or 0])

    def _attachment(self, offset: int, content: bytes) -> None:
        if attachment_is_damaged(content):
            self._lose(offset, len(content), "a damaged attachment")
            return
        self.result.attachments += 1
        self._copy.record(Opcode.ATTACHMENT, content)

    def _metadata(self, _offset: int, content: bytes) -> None:
        self.result.metadata += 1
        self._copy.record(Opcode.METADATA, content)

    # ---- channels

    def _topic(self, channel_id: int) -> str:
        known = self._copy.channels.get(channel_id)
        if known is None:
            declared = self._declared.get((Channel, channel_id))
            known = declared if isinstance(declared, Channel) else None
        return known.topic if known is not None else f"channel {channel_id}"

    def _know(self, counts: dict[int, int]) -> None:
        """See to it that every channel is declared before its messages."""
        copy = self._copy
        for channel_id, count in counts.items():
            if channel_id not in copy.channels:
                channel = self._declared.get((Channel, channel_id))
                if not isinstance(channel, Channel):
                    topic = f"/undeclared/{channel_id}"
                    channel = Channel(channel_id, topic, "", {}, 0)
                schema = self._declared.get((Schema, channel.schema_id))
                if isinstance(schema, Schema) and channel.schema_id not in copy.schemas:
                    copy.declare(schema)
                copy.declare(channel)
            if copy.channels[channel_id].topic == f"/undeclared/{channel_id}":
                self.result.undeclared += count


def _within(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of every record of a chunk's content.

    Raises:
        ValueError: the content ends within one.

    """
    position, size = 0, len(content)
    while position < size:
        opcode, length = HEAD.unpack_from(content, position)
        start = position + HEAD.size
        position = start + length
        if position > size:
            raise ValueError("a record ends beyond its chunk")
        yield opcode, start, position


def summary_declarations(data: Bytes) -> dict[tuple[type, int], Schema | Channel]:
    """Schemas and channels of the file's summary, by kind and id; none where it is damaged."""
    size = len(data)
    declared: dict[tuple[type, int], Schema | Channel] = {}
    if not is_whole(data):
        return declared
    footer = size - 8 - HEAD.size - 20
    with contextlib.suppress(*DAMAGE, LogReadError):
        opcode, _, start, _, _ = struct.unpack_from("<BQQQI", data, footer)
        if opcode != Opcode.FOOTER or not 0 < start < size:
            return declared
        for found in records(data, start):
            if isinstance(found, Damage):
                break
            content = data[found.start : found.end]
            if found.opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(content))
                declared[Schema, schema.id] = schema
            elif found.opcode == Opcode.CHANNEL:
                channel = Channel.read(_stream(content))
                declared[Channel, channel.id] = channel
    return declared


def _stream(record: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(record))
