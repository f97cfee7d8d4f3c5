"""Decompression of chunks. All sizes are limited.

A chunk record contains the size of its content. Content that is larger, or a size above
:data:`MAX_CHUNK_BYTES`, counts as damage, because a few bytes may unpack to gigabytes. Reading ends
at opcode 0. No record has this opcode. Without this rule a run of zeros would be parsed as empty
records of nine bytes each.
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

MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel id, sequence number, log time and publish time of a message."""
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""First and last log time, size and CRC of a chunk's content. The compression's name follows."""
_TEXT, _SIZE = struct.Struct("<I"), struct.Struct("<Q")

MAX_CHUNK_BYTES = 128 << 20
"""Maximum size of a chunk's content, bytes. Writers close chunks at 1 to 4 MiB. A chunk is larger
only if it has a large single message."""
MAX_DECLARED = 1 << 18
"""Maximum number of schemas and channels in one chunk. Ids have 16 bits. Even a chunk that declares
every schema id and every channel id twice does not exceed this number (4 times 65 536)."""
MAX_SCHEMA_BYTES = 64 << 20
"""Maximum size of all schemas of one file, bytes. All schemas are kept in memory."""
_PIECE_BYTES = 128 << 10
"""Number of bytes of a truncated chunk that are unpacked in one step: one zstd block."""

DAMAGE = (
    *(McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, IndexError, TypeError),
    *(EOFError, OverflowError, RuntimeError, MemoryError, ArithmeticError),
)
"""Exceptions that the libraries raise on damaged content."""


class ChunkParts(NamedTuple):
    """Fields of a chunk record."""

    first_ns: int
    last_ns: int
    size: int
    """Declared size of the content, bytes."""
    crc: int
    """CRC of the content; 0: no CRC."""
    compression: bytes
    packed: memoryview


def chunk_parts(record: bytes) -> ChunkParts:
    """Parse a chunk record.

    Raises:
        struct.error: the record is too short.
        ValueError: a field exceeds the record.

    """
    first_ns, last_ns, size, crc = CHUNK_HEAD.unpack_from(record)
    begin = CHUNK_HEAD.size + _TEXT.size
    (length,) = _TEXT.unpack_from(record, CHUNK_HEAD.size)
    compression, begin = bytes(record[begin : begin + length]), begin + length + _SIZE.size
    (length,) = _SIZE.unpack_from(record, begin - _SIZE.size)
    packed = memoryview(record)[begin : begin + length]
    if len(packed) != length:
        raise ValueError("the content exceeds the chunk")
    return ChunkParts(first_ns, last_ns, size, crc, compression, packed)


def chunk_content(record: bytes) -> bytes:
    """Decompress a chunk's records and check the CRC.

    Raises:
        Exception: one of :data:`DAMAGE`.

    """
    parts = chunk_parts(record)
    if parts.size > MAX_CHUNK_BYTES:
        raise ValueError(f"the chunk declares {parts.size} bytes; the maximum is {MAX_CHUNK_BYTES}")
    content = unpacked(parts.compression, parts.packed, parts.size)
    check(content, parts.crc)
    return content


def check(content: bytes, crc: int) -> None:
    """Compare a chunk's content with its CRC.

    Raises:
        ValueError: the CRCs differ.

    """
    if crc and zlib.crc32(content) != crc:
        raise ValueError("the chunk's CRC is wrong")


def unpacked(compression: bytes, packed: memoryview, limit: int) -> bytes:
    """Decompress to at most ``limit`` bytes.

    Raises:
        Exception: one of :data:`DAMAGE`.

    """
    if compression == b"zstd":
        stated = zstandard.frame_content_size(packed)
        if stated > limit:
            raise ValueError(f"the chunk unpacks to {stated} bytes but declares {limit}")
        if not limit:  # for the library, 0 means unlimited
            if unpacked_start(compression, packed, 1):
                raise ValueError("the chunk is not empty but declares 0 bytes")
            return b""
        # If the compressed data do not state their size, the library raises an error at the limit.
        content: bytes = zstandard.decompress(packed, max_output_size=limit)
        return content
    if compression == b"lz4":
        work = lz4.frame.LZ4FrameDecompressor()
        content = work.decompress(packed, max_length=limit + 1)
        if len(content) > limit:
            raise ValueError(f"the chunk unpacks to more than the {limit} bytes that it declares")
        if not work.eof or work.unused_data:
            raise ValueError("the chunk's compressed content has a wrong end")
        return content
    if compression:
        name = compression[:20].decode("utf-8", "replace")
        raise ValueError(f"unknown compression {name!r}")
    if len(packed) > limit:
        raise ValueError(f"the chunk has {len(packed)} bytes but declares {limit}")
    return bytes(packed)


def unpacked_start(compression: bytes, packed: memoryview, limit: int) -> bytes:
    """Return the part of a truncated chunk that can be decompressed, at most ``limit`` bytes."""
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
    """Yield opcode, start and end of every record of a chunk's content.

    Raises:
        ValueError: the bytes are invalid, or a record exceeds the content.
        struct.error: the head of a record is truncated.

    """
    position, size, declared = 0, len(content), 0
    while position < size:
        opcode, length = HEAD.unpack_from(content, position)
        start = position + HEAD.size
        position = start + length
        if position > size:
            raise ValueError("a record exceeds its chunk")
        if opcode != Opcode.MESSAGE:
            declared += 1
            if opcode == 0 or declared > MAX_DECLARED:
                raise ValueError("the chunk has bytes that are not records")
        yield opcode, start, position


def attachment_is_damaged(record: bytes) -> bool:
    """Return True if the attachment has a wrong CRC. A CRC of 0 means that there is no CRC."""
    stored = int.from_bytes(record[-4:], "little")
    return stored != 0 and stored != zlib.crc32(memoryview(record)[:-4])
