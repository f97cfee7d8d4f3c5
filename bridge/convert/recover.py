"""Recovery of damaged logs: all data that are provably intact are copied.

Chunks are copied if their content's CRC is valid. A damaged chunk is omitted, and the message
indexes after it show which messages are lost. If the last chunk is truncated, the part that can be
decompressed is copied. A record with valid fields and CRC is copied even if its opcode or length is
damaged. A lost declaration is copied from the file's summary or from a later declaration in the
file; otherwise a stub replaces it. Joined files are recovered one after the other. If ids of a
later file conflict with earlier ids, they are changed.
"""

from __future__ import annotations

import contextlib
import struct
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from bridge.record.errors import LogWriteError
from bridge.record.file_summary import is_summary_of, read_file_summary
from bridge.record.mcap_copy import McapCopy, Places
from bridge.record.mcap_file import MAGIC, bytes_of
from bridge.record.mcap_records import (
    Attachment,
    Channel,
    Header,
    MessageIndex,
    Metadata,
    Opcode,
    Schema,
    parse,
)
from bridge.record.scan import (
    LAST_KNOWN,
    DamagedBytes,
    RecordSearch,
    has_shape,
    inner_end,
    next_file,
    opened,
    records,
)
from bridge.record.unpack import (
    CHUNK_HEAD,
    DAMAGE,
    HEAD,
    MAX_CHUNK_BYTES,
    MESSAGE_HEAD,
    ChunkParts,
    attachment_is_damaged,
    check,
    chunk_parts,
    content_records,
    unpacked,
    unpacked_start,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bridge.record.scan import Bytes, Found

_ID = struct.Struct("<H")
_LONGEST_SHOWN = 4
"""Maximum number of topics in the text of a loss."""
_COMPRESSIONS = {b"", b"zstd", b"lz4"}
_OF_SUMMARY = frozenset(
    int(opcode)
    for opcode in (
        *(Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX),
        *(Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET),
    )
)
_OVERSIZE_BYTES = 4 * MAX_CHUNK_BYTES
"""Maximum total size by which a file's chunks may exceed their declared sizes, bytes. A declared
size may be damaged, so a chunk may be larger. The limit bounds the time."""
_GUESSED_BYTES = 512 << 20
"""Maximum number of bytes per file that are read because an opcode or length may be damaged. Each
byte needs a copy and a checksum, which take about 1 ns."""
_GUESSED_TIMES = 16
"""Additional number of such bytes for each byte of the file. A log decompresses to about 5 times
its size, so each chunk may be read three times."""


@dataclass(slots=True)
class Loss:
    """A range of the file that could not be copied."""

    offset: int
    bytes: int
    what: str
    start_ns: int | None = None
    """Log time of the first known message; None: unknown."""
    end_ns: int | None = None
    messages: dict[str, int] = field(default_factory=dict)
    """Number of lost messages by topic, as far as known."""
    kept: Counter[int] = field(default_factory=Counter)
    """Number of messages of this range that were copied, by channel. An index counts them too."""

    def text(self) -> str:
        """Return the loss as one line."""
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
    """Result of a recovery."""

    source: Path
    target: Path
    whole: bool = True
    """True if the source has an end and no data after it."""
    files: int = 1
    """Number of joined files in the source."""
    messages: int = 0
    chunks: int = 0
    rescued: int = 0
    """Number of messages copied from a truncated chunk."""
    attachments: int = 0
    metadata: int = 0
    undeclared: int = 0
    """Number of messages without a declaration. They are in the topic ``/undeclared/<channel>``."""
    stub_schemas: int = 0
    """Number of lost schemas, replaced by stubs ``lost_schema_<number>``."""
    losses: list[Loss] = field(default_factory=list)

    @property
    def lost_messages(self) -> int:
        """Known number of lost messages, without the messages of a truncated end."""
        return sum(sum(loss.messages.values()) for loss in self.losses)

    def as_json(self) -> dict[str, Any]:
        """Return all fields as values for JSON."""
        return {
            "source": str(self.source),
            "out": str(self.target),
            "whole": self.whole,
            "files": self.files,
            "messages": self.messages,
            "chunks": self.chunks,
            "rescued_from_a_cut_chunk": self.rescued,
            "attachments": self.attachments,
            "metadata": self.metadata,
            "undeclared": self.undeclared,
            "stub_schemas": self.stub_schemas,
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
    """Copy the intact content of a file to another file.

    Raises:
        LogReadError: the source is missing, cannot be read, or is not an MCAP file.
        OutputExistsError: the target exists, and ``force`` is False.
        LogWriteError: the target cannot be written, or is the source itself.

    """
    with opened(source) as data:
        if target.exists() and target.samefile(source):
            raise LogWriteError(target, "it is the source file; give another name")
        result = Recovery(source, target)
        with McapCopy(target, force=force) as copy:
            begin: int | None = 0
            last_is_taken = False
            while begin is not None:
                work = _Recoverer(data, begin, copy, result, last_is_taken=last_is_taken)
                last_is_taken |= work.took_last
                work.run()
                begin = next_file(data, work.end, len(data))
                between = (len(data) if begin is None else begin) - work.end
                if between:
                    result.losses.append(Loss(work.end, between, "bytes after the file's end"))
                    result.whole = False
                result.files += begin is not None
            copy.finish()
            result.messages, result.chunks = copy.messages, copy.chunks
        return result


class _Recoverer:
    """Recovers one of the joined files. Usually a source has only one file."""

    def __init__(
        self,
        data: Bytes,
        begin: int,
        copy: McapCopy,
        result: Recovery,
        *,
        last_is_taken: bool,
    ) -> None:
        self.end = begin + len(MAGIC)
        """End of the file, as soon as it is known."""
        self._begin = self.end
        self._data, self._copy, self._result = data, copy, result
        following = next_file(data, self.end, len(data))
        self._summary = read_file_summary(data, begin, following or len(data))
        self.took_last = (
            following is not None  # the next file may be inside an attachment
            and not last_is_taken
            and self._summary.start is None
            and is_summary_of(data, begin, len(data))
        )
        """True to use the summary at the end of the data although another file seems to start
        before it. Only one of several joined files uses it, to limit the time."""
        if self.took_last:
            self._summary = read_file_summary(data, begin, len(data))
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        """Channel declarations by their id in this file."""
        self._numbers: dict[int, int] = {}
        """Map of a channel's id in this file to its id in the copy."""
        self._looked_ahead = False
        self._kept: Counter[int] = Counter()
        """Number of copied messages by channel."""
        self._first_loss = len(result.losses)
        self._oversize = _OVERSIZE_BYTES
        self._guesses = _GUESSED_BYTES + _GUESSED_TIMES * ((following or len(data)) - begin)
        """Number of bytes that may still be read because of a possibly damaged opcode or length."""
        self._search, self._search_inner = RecordSearch(data), RecordSearch(data)
        self._last: dict[int, list[tuple[int, int]]] = {}
        """Message indexes of the last copied chunk."""
        self._is_chunked = Opcode.CHUNK in self._summary.kinds.values()
        self._loss: Loss | None = None
        """The last loss, as long as its message indexes may follow."""
        self._handlers: dict[int, Callable[[int, bytes], None]] = {
            int(Opcode.SCHEMA): partial(self._declaration, Opcode.SCHEMA),
            int(Opcode.CHANNEL): partial(self._declaration, Opcode.CHANNEL),
            int(Opcode.MESSAGE): self._message,
            int(Opcode.CHUNK): self._chunk,
            int(Opcode.MESSAGE_INDEX): self._index,
            int(Opcode.ATTACHMENT): self._attachment,
            int(Opcode.METADATA): self._metadata,
        }

    def run(self) -> None:
        """Copy the intact content of the file."""
        profile, library = self._header()
        self._copy.header(profile, library)
        position: int | None = self._begin
        while position is not None:
            position = self._from(position)
        self._account()

    def _header(self) -> tuple[str, str]:
        with contextlib.suppress(*DAMAGE):
            _, length = HEAD.unpack_from(self._data, self._begin)
            start = self._begin + HEAD.size
            if has_shape(self._data, Opcode.HEADER, start, start + length):
                header = parse(Header, self._data[start : start + length])
                return header.profile, header.library
        return "", ""

    def _from(self, position: int) -> int | None:
        """Handle the records from an offset; return where to continue, None at the end."""
        whole = False
        for found in records(self._data, position, search=self._search):
            if isinstance(found, DamagedBytes):
                going_on = self._damaged(found)
                self.end = max(self.end, found.end)
            else:
                self.end = found.end
                if found.opcode == Opcode.FOOTER:
                    following = self._data[found.end : found.end + len(MAGIC)]
                    whole = following == MAGIC
                    self.end += len(following)
                    break
                going_on = self._record(found)
            if going_on is not None:
                self.end = going_on
                return going_on
        self._result.whole &= whole
        return None

    def _record(self, found: Found) -> int | None:
        """Handle one record; return where to continue if not at its end."""
        opcode, offset, start, end = found
        if offset == self._begin and has_shape(self._data, Opcode.HEADER, start, end):
            return None
        expected = self._summary.kinds.get(offset, opcode)
        if opcode != expected or opcode > LAST_KNOWN or self._is_misplaced(opcode, offset):
            going_on = self._mislabelled(offset, expected)
            if going_on is not None:
                return going_on
        if opcode == Opcode.MESSAGE and self._is_chunked and self._loss is not None:
            # It belongs to the lost chunk, and only the lost chunk's checksum covered it.
            self._loss.bytes = max(self._loss.bytes, end - self._loss.offset)
            return None
        if opcode != Opcode.MESSAGE_INDEX:
            self._loss = None
        handler = self._handlers.get(opcode)
        if handler is not None:
            return self._handle(handler, found)
        if opcode > LAST_KNOWN:
            self._copy.record(opcode, self._data[start:end])
        elif self._is_misplaced(opcode, offset):
            self._lose(offset, end - offset, "a misplaced record")
        return None

    def _handle(self, handler: Callable[[int, bytes], None], found: Found) -> int | None:
        """Handle one data record; return where to continue if not at its end."""
        opcode, offset, start, end = found
        own = inner_end(self._data, opcode, start)
        # A damaged length may overlap intact records.
        is_longer = own is not None and own < end and self._stands(own)
        if own is not None and is_longer:
            end = own
        try:
            handler(offset, self._data[start:end])
        except DAMAGE:
            self._lose(offset, end - offset, f"a damaged {_KINDS.get(opcode, 'record')}")
        if self._loss is not None and self._loss.offset == offset:
            following = next_file(self._data, start, end)
            if following is None and opcode == Opcode.ATTACHMENT and not self._stands_known(end):
                following = self._search_inner.after(start)
            elif following is None and opcode == Opcode.CHUNK:
                following = self._next_chunk(start, end)
            # Bytes of the record are missing, so its length overlaps the next record.
            if following is not None and following < end:
                self._loss.bytes = following - offset
                return following
        return end if is_longer else None

    def _next_chunk(self, start: int, end: int) -> int | None:
        """Return the chunk or attachment that a damaged chunk's length overlaps.

        A message may itself contain a chunk, which ends inside the message. Such a chunk does not
        count if there is a record at ``end``.
        """
        if self._stands_known(end):
            return self._search.reached(start, end)
        following = self._search.after(start, only_sized=True)
        return following if following is not None and following < end else None

    def _stands(self, position: int) -> bool:
        """Return True if there is a whole record at ``position``."""
        found = next(records(self._data, position, search=self._search_inner), None)
        return found is not None and not isinstance(found, DamagedBytes)

    def _stands_known(self, position: int) -> bool:
        """Return True if there is a whole record of a known kind, or the end of the data."""
        found = next(records(self._data, position, search=self._search_inner), None)
        if found is None:
            return True
        return not isinstance(found, DamagedBytes) and found.opcode <= LAST_KNOWN

    def _is_misplaced(self, opcode: int, offset: int) -> bool:
        """Return True for a summary record before the summary, or a second header."""
        if opcode == Opcode.HEADER:
            return offset != self._begin
        start = self._summary.start if self._summary.is_proven else None
        return opcode in _OF_SUMMARY and start is not None and offset < start

    # ---- damage

    def _lose(self, offset: int, size: int, what: str) -> Loss:
        self._loss = Loss(offset, size, what)
        self._result.losses.append(self._loss)
        return self._loss

    def _damaged(self, damage: DamagedBytes) -> int | None:
        """Copy the intact part of damaged bytes; return where to continue if known."""
        offset, end, is_tail = damage
        expected = self._summary.kinds.get(offset)
        going_on = self._mislabelled(offset, expected)
        if going_on is not None:
            return going_on
        if is_tail and self._rescue_tail(offset, end):
            return None
        what = "a truncated record" if is_tail else "damaged bytes"
        opcode = expected or self._data[offset]
        if opcode == Opcode.CHUNK:
            what = "a truncated chunk" if is_tail else "a damaged chunk"
        self._lose(offset, end - offset, what)
        return None

    def _mislabelled(self, offset: int, expected: int | None) -> int | None:
        """Copy a record with a damaged opcode or length if its content is intact.

        Returns its end; None: no such record.
        """
        end = self._chunk_at(offset)
        if end is not None:
            return end
        start = offset + HEAD.size
        end = inner_end(self._data, Opcode.ATTACHMENT, start)
        if end is not None and self._may_guess(end - start):
            record = self._data[start:end]
            if record[-4:] != bytes(4) and not attachment_is_damaged(record):
                with contextlib.suppress(*DAMAGE):
                    self._attachment(offset, record)
                    return end
        if Opcode.METADATA in {expected, self._data[offset]}:
            end = inner_end(self._data, Opcode.METADATA, start)
            if end is not None and _may_follow(self._data, end) and self._may_guess(end - start):
                with contextlib.suppress(*DAMAGE):
                    self._metadata(offset, self._data[start:end])
                    return end
        return None

    def _chunk_at(self, offset: int) -> int | None:
        """Copy a chunk with a valid CRC but a damaged opcode or length.

        Returns its end; None: no such chunk.
        """
        data, start = self._data, offset + HEAD.size
        with contextlib.suppress(*DAMAGE):
            _, length = HEAD.unpack_from(data, offset)
            first_ns, last_ns, size, crc = CHUNK_HEAD.unpack_from(data, start)
            name_bytes = int.from_bytes(data[start + 28 : start + 32], "little")
            compression = data[start + 32 : start + 32 + min(name_bytes, 8)]
            if not crc or compression not in _COMPRESSIONS:
                return None
            body = start + 32 + name_bytes + 8
            ends = {start + length, inner_end(data, Opcode.CHUNK, start) or 0}
            found: list[int] = [end for end in ends if body < end <= len(data)]
            for end in sorted(found, key=lambda end: not self._stands(end)):
                if not self._may_guess(end - body + min(size, MAX_CHUNK_BYTES)):
                    continue
                with contextlib.suppress(*DAMAGE):
                    packed = memoryview(data[body:end])
                    parts = ChunkParts(first_ns, last_ns, size, crc, compression, packed)
                    content, _ = self._content(parts)
                    self._loss = None
                    self._keep(offset, data[start:end], content, None)
                    return end
        return None

    def _may_guess(self, size: int) -> bool:
        """Return True if ``size`` more bytes may be read within the limits, and count them."""
        if size > self._guesses:
            return False
        self._guesses -= size
        return True

    def _rescue_tail(self, offset: int, end: int) -> bool:
        """Copy the messages that a truncated chunk still contains; return False for no chunk."""
        data, start = self._data, offset + HEAD.size
        if data[offset] != Opcode.CHUNK or start + 32 > end:
            return False
        record = data[start:end]
        size = int.from_bytes(record[28:32], "little")
        name, body = record[32 : 32 + size], 32 + size + 8
        content = unpacked_start(name, memoryview(record)[body:], MAX_CHUNK_BYTES)
        taken, _ = self._take_apart(offset, content)
        for opcode, begin, stop in taken:
            if opcode == Opcode.MESSAGE:
                self._message(offset, content[begin:stop])
        kept = Counter(
            _ID.unpack_from(content, begin)[0]
            for opcode, begin, _ in taken
            if opcode == Opcode.MESSAGE
        )
        self._result.rescued += kept.total()
        what = "the rest of a truncated chunk" if kept else "a truncated chunk"
        self._lose(offset, end - offset, what).kept = kept
        return True

    # ---- handlers of record types

    def _declaration(self, opcode: int, offset: int, content: bytes) -> None:
        """Handle a schema or channel outside chunks.

        In a damaged summary, use only new declarations.
        """
        start = self._summary.start
        if start is not None and offset >= start and not self._summary.is_proven:
            self._take_missing(opcode, content, 0, len(content))
        elif opcode == Opcode.SCHEMA:
            self._schema(offset, content)
        else:
            self._channel(offset, content)

    def _schema(self, _offset: int, content: bytes) -> None:
        schema = parse(Schema, content)
        proven = self._summary.declared.schemas.get(schema.id) if self._summary.is_proven else None
        schema = proven or schema
        if schema.id and self._schemas.get(schema.id) != schema:
            self._schemas[schema.id] = schema
            self._copy.schema(schema)

    def _channel(self, _offset: int, content: bytes) -> None:
        channel = parse(Channel, content)
        proven = (
            self._summary.declared.channels.get(channel.id) if self._summary.is_proven else None
        )
        channel = proven or channel
        if self._channels.get(channel.id) != channel:
            self._channels[channel.id] = channel
            self._numbers.pop(channel.id, None)
        self._number(channel.id)

    def _message(self, _offset: int, content: bytes) -> None:
        channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content)
        if self._is_index(content):
            return
        number = self._number(channel_id)
        self._count(Counter({channel_id: 1}))
        self._copy.message(_ID.pack(number) + content[_ID.size :], number, log_ns)

    def _chunk(self, offset: int, record: bytes) -> None:
        self._is_chunked = True
        try:
            parts = chunk_parts(record)
            content, is_sound = self._content(parts)
        except DAMAGE:
            if self._chunk_at(offset) is not None:
                return
            loss = self._lose(offset, HEAD.size + len(record), "a damaged chunk")
            with contextlib.suppress(struct.error):
                loss.start_ns, loss.end_ns = struct.unpack_from("<QQ", record)
            return
        self._keep(offset, record, content, parts if is_sound else None)

    def _content(self, parts: ChunkParts) -> tuple[bytes, bool]:
        """Unpack a chunk with a valid CRC.

        The second value is True if its packed bytes can be copied.

        Raises:
            Exception: any error that the libraries raise on damage.

        """
        is_sound = False
        try:
            if parts.size > MAX_CHUNK_BYTES:
                raise ValueError("the declared size is too large")
            content = unpacked(parts.compression, parts.packed, parts.size)
            is_sound = bool(content)  # some readers reject an empty frame
        except DAMAGE:
            # The declared size itself may be damaged.
            if not parts.crc or self._oversize <= 0:
                raise
            limit = min(self._oversize, MAX_CHUNK_BYTES)
            content = unpacked_start(parts.compression, parts.packed, limit)
            self._oversize -= len(content)
        check(content, parts.crc)
        return content, is_sound

    def _take_apart(
        self, offset: int, content: bytes
    ) -> tuple[list[tuple[int, int, int]], int | None]:
        """Return a chunk's records and the start of invalid bytes; store its declarations."""
        taken, end = [], 0
        broken = None
        try:
            for opcode, start, stop in content_records(content):
                if opcode == Opcode.MESSAGE and stop - start < MESSAGE_HEAD.size:
                    raise ValueError("a message without a head")
                taken.append((opcode, start, stop))
                end = stop
        except DAMAGE:
            broken = end
        for kind, take in ((Opcode.SCHEMA, self._schema), (Opcode.CHANNEL, self._channel)):
            for opcode, start, stop in taken:
                if opcode != kind:
                    continue
                try:
                    if not has_shape(content, opcode, start, stop):
                        raise ValueError("the fields exceed the record")
                    take(offset, content[start:stop])
                except DAMAGE:
                    self._lose(offset, stop - start, f"a damaged {_KINDS[opcode]}")
        return taken, broken

    def _keep(self, offset: int, record: bytes, content: bytes, packed: ChunkParts | None) -> None:
        """Copy a chunk. Copy its packed bytes if nothing has to be changed."""
        taken, broken = self._take_apart(offset, content)
        places, counts = Places(), Counter[int]()
        same = broken is None
        numbers: dict[int, int] = {}
        for opcode, start, stop in taken:
            if opcode == Opcode.MESSAGE:
                channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, start)
                number = numbers.get(channel_id)
                if number is None:
                    number = numbers[channel_id] = self._number(channel_id)
                    same = same and number == channel_id
                counts[channel_id] += 1
                places.add(number, log_ns, start - HEAD.size)
            elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                same = same and self._is_declared(opcode, content[start:stop])
            else:
                same = False
        if same and packed is not None:
            self._copy.chunk(packed.compression.decode(), packed.packed, content, places)
        else:
            for opcode, start, stop in taken:
                if opcode == Opcode.MESSAGE:
                    channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, start)
                    number = numbers[channel_id]
                    message = _ID.pack(number) + content[start + _ID.size : stop]
                    self._copy.message(message, number, log_ns)
        self._count(counts)
        entries = {c: places.by_channel[number] for c, number in numbers.items()}
        self._last = {c: list(zip(e[::2], e[1::2], strict=True)) for c, e in entries.items()}
        if broken is not None:
            rest = len(content) - broken
            loss = self._lose(offset, HEAD.size + len(record), f"{rest} bytes inside a chunk")
            loss.kept = counts

    def _is_declared(self, opcode: int, content: bytes) -> bool:
        """Return True if the copy has exactly this declaration."""
        copy = self._copy
        known: Schema | Channel | None
        if opcode == Opcode.SCHEMA:
            schema = self._schemas.get(_ID.unpack_from(content)[0])
            known = None if schema is None else copy.schemas.get(schema.id)
        else:
            known = copy.channels.get(_ID.unpack_from(content)[0])
        return known is not None and bytes_of(known)[HEAD.size :] == content

    def _index(self, _offset: int, content: bytes) -> None:
        """Count a lost chunk's messages from the message index after the chunk."""
        if self._loss is None:
            return
        index = parse(MessageIndex, content)
        if self._last.get(index.channel_id) == index.records:
            return  # of a copied chunk; only an index was lost
        topic = self._topic(index.channel_id)
        counts, times = self._loss.messages, [entry[0] for entry in index.records]
        lost = len(times) - self._loss.kept[index.channel_id]
        if lost > 0:
            counts[topic] = counts.get(topic, 0) + lost
            self._loss.start_ns = min([*times, self._loss.start_ns or times[0]])
            self._loss.end_ns = max([*times, self._loss.end_ns or 0])

    def _is_index(self, content: bytes) -> bool:
        """Return True if a supposed message is a message index of the last chunk."""
        entries = self._last.get(_ID.unpack_from(content)[0])
        if entries is None or len(content) != 6 + 16 * len(entries):
            return False
        return bool(parse(MessageIndex, content).records == entries)

    def _attachment(self, offset: int, content: bytes) -> None:
        if attachment_is_damaged(content):
            self._lose(offset, len(content), "a damaged attachment")
            return
        parse(Attachment, content)
        self._result.attachments += 1
        self._copy.record(Opcode.ATTACHMENT, content)

    def _metadata(self, _offset: int, content: bytes) -> None:
        metadata = parse(Metadata, content)
        self._result.metadata += 1
        self._copy.record(Opcode.METADATA, bytes_of(metadata)[HEAD.size :])

    # ---- channels

    def _topic(self, channel_id: int) -> str:
        known = self._channels.get(channel_id) or self._summary.declared.channels.get(channel_id)
        return known.topic if known is not None else f"channel {channel_id}"

    def _number(self, channel_id: int) -> int:
        """Return a channel's id in the copy; declare it there with its schema."""
        number = self._numbers.get(channel_id)
        if number is None:
            channel = self._find_channel(channel_id)
            schema_id = 0
            if channel.schema_id:
                schema_id = self._copy.schema(self._find_schema(channel.schema_id))
            number = self._numbers[channel_id] = self._copy.channel(channel, schema_id)
        return number

    def _find_channel(self, channel_id: int) -> Channel:
        found = self._channels.get(channel_id) or self._summary.declared.channels.get(channel_id)
        if found is None:
            self._look_ahead()
            found = self._channels.get(channel_id)
        return found or Channel(channel_id, f"/undeclared/{channel_id}", "", {}, 0)

    def _find_schema(self, schema_id: int) -> Schema:
        found = self._schemas.get(schema_id) or self._summary.declared.schemas.get(schema_id)
        if found is None:
            self._look_ahead()
            found = self._schemas.get(schema_id)
        if found is None:
            self._result.stub_schemas += 1
            found = Schema(id=schema_id, data=b"", encoding="", name=f"lost_schema_{schema_id}")
            self._schemas[schema_id] = found
        return found

    def _look_ahead(self) -> None:
        """Read the declarations of the whole file. Some writers repeat them in every chunk."""
        if self._looked_ahead:
            return
        self._looked_ahead = True
        for found in records(self._data, self._begin):
            if isinstance(found, DamagedBytes):
                continue
            content = self._data[found.start : found.end]
            with contextlib.suppress(*DAMAGE):
                if found.opcode == Opcode.CHUNK:
                    unpacked_, _ = self._content(chunk_parts(content))
                    for opcode, start, stop in content_records(unpacked_):
                        self._take_missing(opcode, unpacked_, start, stop)
                else:
                    self._take_missing(found.opcode, content, 0, len(content))

    def _take_missing(self, opcode: int, content: bytes, start: int, stop: int) -> None:
        if opcode not in {Opcode.SCHEMA, Opcode.CHANNEL}:
            return
        if not has_shape(content, opcode, start, stop):
            return
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, content[start:stop])
            self._schemas.setdefault(schema.id, schema)
        else:
            channel = parse(Channel, content[start:stop])
            self._channels.setdefault(channel.id, channel)

    # ---- statistics

    def _count(self, counts: Counter[int]) -> None:
        self._kept.update(counts)
        for channel_id, count in counts.items():
            if self._copy.channels[self._numbers[channel_id]].topic.startswith("/undeclared/"):
                self._result.undeclared += count

    def _account(self) -> None:
        """Report messages in the file's statistics that are not among copied or lost messages."""
        counts = self._summary.counts if self._summary.is_proven else None
        if counts is None:
            return
        named: Counter[str] = Counter()
        for loss in self._result.losses[self._first_loss :]:
            named.update(loss.messages)
        expected: Counter[str] = Counter()
        for channel_id, count in counts.items():
            expected[self._topic(channel_id)] += count - self._kept[channel_id]
        missing = {t: n - named[t] for t, n in expected.items() if n > named[t]}
        # Outside chunks a damaged id assigns a message to another channel.
        if missing and sum(counts.values()) > self._kept.total() + named.total():
            self._loss = None
            loss = self._lose(self._begin, 0, "messages in the damaged bytes")
            loss.messages = missing


_KINDS: dict[int, str] = {
    Opcode.SCHEMA: "schema",
    Opcode.CHANNEL: "channel",
    Opcode.MESSAGE: "message",
    Opcode.CHUNK: "chunk",
    Opcode.MESSAGE_INDEX: "message index",
    Opcode.ATTACHMENT: "attachment",
    Opcode.METADATA: "metadata record",
}


def _may_follow(data: Bytes, position: int) -> bool:
    """Return True if there is a record of a known kind or the file's end."""
    return position >= len(data) or 0 < data[position] <= LAST_KNOWN
