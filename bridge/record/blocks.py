"""A log's messages in blocks: the bytes of many chunks, and where in them each topic's stand."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from bridge.record.reader import DAMAGE, chunk_content
from bridge.record.records_kernel import find_records
from bridge.record.recover import summary_declarations
from bridge.record.scan import Damage, opened, records

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from bridge.record.scan import Bytes, Found

BLOCK_BYTES = 16 << 20
_LENGTH = struct.Struct("<Q")
_FRONT = 9
"""Opcode and length."""
MESSAGE_HEAD = 31
"""All that stands before a message's data."""


@dataclass(slots=True)
class Declared:
    """What the file has said of its channels by now."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def take(self, opcode: int, content: bytes) -> None:
        """Note a schema or a channel."""
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels.setdefault(channel.id, channel)


@dataclass(frozen=True, slots=True)
class Block:
    """Messages of some chunks on end."""

    data: bytes
    starts: dict[int, NDArray[np.int64]]
    """By channel: where each message's record begins in ``data``."""

    def heads(self, channel_id: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Heads]:
        """Where one channel's messages begin, how long their data are, and their headers."""
        starts = self.starts[channel_id]
        # One overlapping item at each byte: numpy then copies whole headers.
        places = len(self.data) - MESSAGE_HEAD + 1
        items = np.ndarray((places,), f"V{MESSAGE_HEAD}", self.data, 0, (1,))
        heads = items[starts].view(HEAD_DTYPE)
        lengths = heads["length"].astype(np.int64) - (MESSAGE_HEAD - _FRONT)
        return starts + MESSAGE_HEAD, lengths, heads


HEAD_DTYPE = np.dtype(
    {
        "names": ["length", "sequence", "log_ns", "publish_ns"],
        "formats": ["<u8", "<u4", "<u8", "<u8"],
        "offsets": [1, 11, 15, 23],
        "itemsize": MESSAGE_HEAD,
    }
)
Heads = np.ndarray  # of HEAD_DTYPE


def blocks(
    path: Path, declared: Declared, problems: list[str], block_bytes: int = BLOCK_BYTES
) -> Iterator[Block]:
    """Read a log from front to back; what is damaged is stepped over and named.

    Raises:
        LogReadError: it is missing, cannot be read, or is no MCAP file.

    """
    with opened(path) as data:
        for record in summary_declarations(data).values():
            if isinstance(record, Schema):
                declared.schemas[record.id] = record
            else:
                declared.channels[record.id] = record
        work = _Gatherer(declared)
        for found in records(data, indexes=False):
            if isinstance(found, Damage):
                if not found.is_tail:
                    problems.append(f"damaged bytes at offset {found.offset} stepped over")
                continue
            if found.opcode == Opcode.DATA_END:
                break
            try:
                work.record(data, found)
            except DAMAGE:
                problems.append(f"a damaged record at offset {found.offset} stepped over")
            if work.size >= block_bytes:
                yield work.block()
        yield work.block()


class _Gatherer:
    """Walks chunks and notes where messages stand."""

    def __init__(self, declared: Declared) -> None:
        self.size = 0
        self._declared = declared
        self._contents: list[bytes] = []
        self._found: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
        """Places and channels, chunk by chunk."""
        self._places = self._channels = np.empty(0, np.int64)

    def record(self, data: Bytes, found: Found) -> None:
        """Take one record of the file."""
        opcode, offset, start, end = found
        if opcode == Opcode.CHUNK:
            self._content(chunk_content(data[start:end]))
        elif opcode == Opcode.MESSAGE:
            self._content(data[offset:end])
        else:
            self._declared.take(opcode, data[start:end])

    def _content(self, content: bytes) -> None:
        """Take the records of one chunk."""
        most = len(content) // _FRONT + 1
        if most > len(self._places):
            self._places, self._channels = np.empty(most, np.int64), np.empty(most, np.int64)
        places, channels = self._places, self._channels
        count = find_records(np.frombuffer(content, np.uint8), places, channels)
        cut, count = count < 0, count if count >= 0 else -count - 1
        for index in np.flatnonzero(channels[:count] < 0).tolist():
            begin = int(places[index]) + _FRONT
            (length,) = _LENGTH.unpack_from(content, begin - _LENGTH.size)
            self._declared.take(-int(channels[index]), content[begin : begin + length])
        self._found.append((places[:count] + self.size, channels[:count].copy()))
        self._contents.append(content)
        self.size += len(content)
        if cut:
            raise ValueError("a record ends beyond its chunk")

    def block(self) -> Block:
        """What was gathered; begins anew."""
        nothing = np.empty(0, np.int64)
        starts = np.concatenate([nothing, *(places for places, _ in self._found)])
        channels = np.concatenate([nothing, *(channels for _, channels in self._found)])
        order = np.argsort(channels, kind="stable")
        sorted_channels = channels[order]
        known, first = np.unique(sorted_channels, return_index=True)
        parts = np.split(starts[order], first[1:])
        made = Block(
            b"".join(self._contents),
            {c: part for c, part in zip(known.tolist(), parts, strict=False) if c >= 0},
        )
        self._contents, self._found, self.size = [], [], 0
        return made
