"""Damaged logs of several writers, and the messages that the mcap library reads from them."""

from __future__ import annotations

import functools
import io
import struct
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer

from bridge.convert.recover import recover
from support.synthetic_run import small_log

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mcap.reader import McapReader

    from bridge.convert.recover import Recovery

MAGIC = b"\x89MCAP0\r\n"
CHUNK = 0x06


class Message(NamedTuple):
    """One message with its topic and the name of its schema."""

    topic: str
    schema: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Log(NamedTuple):
    """An intact log."""

    name: str
    data: bytes
    messages: Counter[Message]
    chunks: list[tuple[int, int, Counter[Message]]]
    """First byte, end and messages of each chunk."""
    has_summary: bool


@functools.cache
def logs() -> tuple[Log, ...]:
    """Return a log of sweepctl, and a log of each kind that other programs write."""
    made = [_log("ours", small_log())]
    made += [_log(kind.name.lower(), foreign(kind)) for kind in CompressionType]
    made.append(_log("outside chunks", foreign(CompressionType.NONE, chunked=False)))
    made.append(_log("no summary", foreign(CompressionType.ZSTD, summary=False), summary=False))
    return tuple(made)


def foreign(compression: CompressionType, *, chunked: bool = True, summary: bool = True) -> bytes:
    """Return a log by the writer of the mcap library: three topics, small chunks."""
    file = io.BytesIO()
    writer = Writer(
        file,
        compression=compression,
        use_chunking=chunked,
        chunk_size=600,
        index_types=IndexType.ALL if summary else IndexType.NONE,
        repeat_schemas=summary,
        repeat_channels=summary,
        use_statistics=summary,
        use_summary_offsets=summary,
    )
    writer.start(profile="other", library="another program")
    thing = writer.register_schema("thing", "jsonschema", b"{}")
    other = writer.register_schema("other", "jsonschema", b'{"a": 1}')
    first = writer.register_channel("/first", "json", thing)
    second = writer.register_channel("/second", "application/octet-stream", 0)
    third = writer.register_channel("/third", "json", other)
    for i in range(60):
        writer.add_message(first, i, b'{"i": %d}' % i, i, i)
        writer.add_message((second, third)[i % 2], i + 1, bytes([i]) * 19, i, i)
    writer.add_attachment(5, 5, "notes", "text/plain", b"hello")
    writer.add_metadata("made", {"by": "another program"})
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return file.getvalue()


def _log(name: str, data: bytes, *, summary: bool = True) -> Log:
    messages = _messages(NonSeekingReader(io.BytesIO(data), validate_crcs=True))
    named = {(m.log_ns, m.sequence, m.data): m for m in messages}
    chunks, position = [], len(MAGIC)
    while position < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, position)
        end = position + 9 + length
        if opcode == CHUNK:
            alone = StreamReader(io.BytesIO(MAGIC + data[position:end]), emit_chunks=True)
            chunk = next(alone.records)
            assert isinstance(chunk, Chunk)
            records = [r for r in breakup_chunk(chunk) if isinstance(r, Record)]
            held = Counter(named[r.log_time, r.sequence, r.data] for r in records)
            chunks.append((position, end, held))
        position = end
    return Log(name, data, messages, chunks, summary)


def _messages(reader: McapReader) -> Counter[Message]:
    return Counter(
        Message(
            channel.topic,
            schema.name if schema is not None else "",
            message.log_time,
            message.publish_time,
            message.sequence,
            message.data,
        )
        for schema, channel, message in reader.iter_messages()
    )


def read_whole(data: bytes) -> Counter[Message]:
    """Read a file with both readers of the mcap library and all their checks."""
    messages = _messages(NonSeekingReader(io.BytesIO(data), validate_crcs=True))
    seeking = make_reader(io.BytesIO(data), validate_crcs=True)
    assert _messages(seeking) == messages
    reported = seeking.get_summary()
    assert reported is not None
    assert reported.statistics is not None
    assert reported.statistics.message_count == messages.total()
    assert reported.statistics.attachment_count == len(list(seeking.iter_attachments()))
    assert reported.statistics.metadata_count == len(list(seeking.iter_metadata()))
    seeking.get_header()
    return messages


def recovered(data: bytes) -> tuple[Recovery, Counter[Message]]:
    """Return the report of ``recover`` on a file, and the messages in the recovered file."""
    with tempfile.TemporaryDirectory() as folder:
        broken, out = Path(folder) / "broken.mcap", Path(folder) / "out.mcap"
        broken.write_bytes(data)
        result = recover(broken, out)
        messages = read_whole(out.read_bytes())
    assert result.messages == messages.total()
    return result, messages


def flipped(data: bytes, bits: Iterable[int]) -> bytes:
    """Invert single bits, counted from the file's first."""
    changed = bytearray(data)
    for bit in bits:
        changed[bit >> 3] ^= 1 << (bit & 7)
    return bytes(changed)


def contents(messages: Iterable[Message]) -> Counter[tuple[int, int, int, bytes]]:
    """Return the messages without topics and schemas, whose names may be lost."""
    return Counter(m[2:] for m in messages)


def check_flip(log: Log, bit: int) -> None:
    """Check that one inverted bit costs at most its chunk, and that the report says so."""
    result, got = recovered(flipped(log.data, [bit]))
    hit = next((held for begin, end, held in log.chunks if begin <= bit >> 3 < end), Counter())
    left = contents(log.messages.elements())
    if log.chunks:  # a message outside chunks has no checksum
        assert not contents(got.elements()) - left
        assert not left - contents(got.elements()) - contents(hit.elements())
    if log.has_summary:
        assert result.lost_messages == max(0, log.messages.total() - got.total())
        if log.chunks:
            assert got <= log.messages, "with their topics and schemas"
