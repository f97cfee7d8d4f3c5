"""Unpacking chunks: the one place that decompresses what a file holds, bounded in every case.

A chunk states the size of its content. What unpacks to more is damage, and so is a statement above
:data:`MAX_CHUNK_BYTES`: a few bytes may unpack to gigabytes. Within the content, an opcode of 0
ends the reading, for no record has it and zeros would be walked nine bytes at a time.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from typing import TYPE_CHECKING, NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode

if TYPE_CHECKING:
    from collections.abc import Iterator

HEAD = struct.Struct("<BQ")
"""Opcode and length of what follows."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""First and last log time, size and CRC of the content; then the compression's name."""
_TEXT, _SIZE = struct.Struct("<I"), struct.Struct("<Q")

MAX_CHUNK_BYTES = 128 << 20
"""Largest content of a chunk that is unpacked, bytes. Writers close chunks at 1 to 4 MiB; only a
single message that is larger makes a larger chunk."""
MAX_DECLARED = 1 << 18
"""Most schemas and channels that one chunk may declare. Their numbers have 16 bits, so a chunk that
declares every number twice stays below."""
MAX_SCHEMA_BYTES = 64 << 20
"""Largest sum of all schemas of one file, bytes: all of them are held in memory."""
_PIECE_BYTES = 128 << 10
"""Bytes of a cut chunk that are unpacked at a time: a zstd block, which unpacks whole or not."""

DAMAGE = (
    *(McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, IndexError, TypeError),
    *(EOFError, OverflowError, RuntimeError, MemoryError, ArithmeticError),
)
"""What the libraries raise on content that is not what it should be."""


class ChunkParts(NamedTuple):
    """A chunk's fields, as they stand in the file."""

    first_ns: int
    last_ns: int
    size: int
    """Of the content, as stated."""
    crc: int
    """Of the content; 0: none was computed."""
    compression: bytes
    packed: memoryview


def chunk_parts(record: bytes) -> ChunkParts:
    """Take a chunk record apart.

    Raises:
        struct.error: it is too short.
        ValueError: a field ends beyond the record.

    """
    first_ns, last_ns, size, crc = CHUNK_HEAD.unpack_from(record)
    begin = CHUNK_HEAD.size + _TEXT.size
    (length,) = _TEXT.unpack_from(record, CHUNK_HEAD.size)
    compression, begin = bytes(record[begin : begin + length]), begin + length + _SIZE.size
    (length,) = _SIZE.unpack_from(record, begin - _SIZE.size)
    packed = memoryview(record)[begin : begin + length]
    if len(packed) != length:
        raise ValueError("its content ends beyond it")
    return ChunkParts(first_ns, last_ns, size, crc, compression, packed)


def chunk_content(record: bytes) -> bytes:
    """Unpack a chunk's records; its CRC is checked.

    Raises:
        Exception: one of :data:`DAMAGE`.

    """
    parts = chunk_parts(record)
    if parts.size > MAX_CHUNK_BYTES:
        raise ValueError(f"it claims {parts.size} bytes; at most {MAX_CHUNK_BYTES} are unpacked")
    content = unpacked(parts.compression, parts.packed, parts.size)
    check(content, parts.crc)
    return content


def check(content: bytes, crc: int) -> None:
    """Compare a chunk's content with its CRC.

    Raises:
        ValueError: they differ.

    """
    if crc and zlib.crc32(content) != crc:
        raise ValueError("its checksum does not hold")


def unpacked(compression: bytes, packed: memoryview, limit: int) -> bytes:
    """Decompress to at most ``limit`` bytes.

    Raises:
        Exception: one of :data:`DAMAGE`.

    """
    if compression == b"zstd":
        stated = zstandard.frame_content_size(packed)
        if stated > limit:
            raise ValueError(f"it unpacks to {stated} bytes, and claims {limit}")
        if not limit:  # to the library no limit at all
            if unpacked_start(compression, packed, 1):
                raise ValueError("it unpacks to something, and claims to be empty")
            return b""
        # Where the frame states no size, this is an error as soon as the limit is passed.
        content: bytes = zstandard.decompress(packed, max_output_size=limit)
        return content
    if compression == b"lz4":
        work = lz4.frame.LZ4FrameDecompressor()
        content = work.decompress(packed, max_length=limit + 1)
        if len(content) > limit:
            raise ValueError(f"it unpacks to more than the {limit} bytes that it claims")
        if not work.eof or work.unused_data:
            raise ValueError("its compressed content does not end where it should")
        return content
    if compression:
        name = compression[:20].decode("utf-8", "replace")
        raise ValueError(f"its compression {name!r} is not known")
    if len(packed) > limit:
        raise ValueError(f"it holds {len(packed)} bytes, and claims {limit}")
    return bytes(packed)


def unpacked_start(compression: bytes, packed: memoryview, limit: int) -> bytes:
    """What still unpacks of a chunk that was cut, at most ``limit`` bytes; nothing is an answer."""
    out = bytearray()
    if not compression:
        out += packed[:limit]
    elif compression == b"zstd":
        with (
            contextlib.suppress(*DAMAGE),
            zstandard.ZstdDecompressor().stream_reader(packed) as stream,
        ):
            while len(out) < limit and (piece := stream.read(_PIECE_BYTES)):
                out += piece
    elif compression == b"lz4":
        with contextlib.suppress(*DAMAGE):
            work = lz4.frame.LZ4FrameDecompressor()
            out += work.decompress(packed, max_length=_PIECE_BYTES)
            while len(out) < limit and not work.needs_input and not work.eof:
                out += work.decompress(b"", max_length=_PIECE_BYTES)
    return bytes(out[:limit])


def content_records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of every record of a chunk's content.

    Raises:
        ValueError: what stands there is no record, or ends beyond the content.
        struct.error: a head is cut.

    """
    position, size, declared = 0, len(content), 0
    while position < size:
        opcode, length = HEAD.unpack_from(content, position)
        start = position + HEAD.size
        position = start + length
        if position > size:
            raise ValueError("a record ends beyond its chunk")
        if opcode != Opcode.MESSAGE:
            declared += 1
            if opcode == 0 or declared > MAX_DECLARED:
                raise ValueError("it holds bytes that are no records")
        yield opcode, start, position


def attachment_is_damaged(record: bytes) -> bool:
    """Whether an attachment's own CRC says so; 0: it has none."""
    stored = int.from_bytes(record[-4:], "little")
    return stored != 0 and stored != zlib.crc32(memoryview(record)[:-4])
