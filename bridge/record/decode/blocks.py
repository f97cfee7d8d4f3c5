"""Messages of a log in blocks. A block has the bytes of many chunks and the offsets of messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from mcap.opcode import Opcode

from bridge.record.file_summary import read_file_summary
from bridge.record.records_kernel import find_records
from bridge.record.scan import DamagedBytes, first_end, opened, records
from bridge.record.unpack import DAMAGE, MAX_DECLARED, chunk_content

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from bridge.record.mcap_records import Declared
    from bridge.record.scan import Bytes, Found

BLOCK_BYTES = 24 << 20
_FRONT = 9
"""Size of opcode and length, bytes."""
MESSAGE_HEAD = 31
"""Size of a record before its message data, bytes."""
_MESSAGE_FIXED = MESSAGE_HEAD - _FRONT
SEQUENCE, LOG_NS, PUBLISH_NS = (11, 4), (15, 8), (23, 8)
"""Offset and size of three fields in a message record, bytes."""


@dataclass(frozen=True, slots=True)
class Block:
    """Messages of consecutive chunks."""

    data: bytes
    starts: dict[int, NDArray[np.int64]]
    """Offset of each message's record in ``data``, by channel."""
    lengths: dict[int, NDArray[np.int64]]
    """Length of each message, bytes, by channel."""


def blocks(
    path: Path, declared: Declared, problems: list[str], block_bytes: int = BLOCK_BYTES
) -> Iterator[Block]:
    """Read a log from start to end. Damage is skipped and listed in ``problems``.

    Raises:
        LogReadError: the file is missing, cannot be read, or is not an MCAP file.

    """
    with opened(path) as data:
        declared.preload(read_file_summary(data, 0, first_end(data)[0]).declared)
        work = _Gatherer(declared)
        for found in records(data, indexes=False):
            if isinstance(found, DamagedBytes):
                what = "the rest is truncated or damaged" if found.is_tail else "skipped"
                problems.append(f"damaged bytes at offset {found.offset}: {what}")
                continue
            if found.opcode == Opcode.DATA_END:
                break
            try:
                work.record(data, found)
            except DAMAGE:
                problems.append(f"a damaged record at offset {found.offset} skipped")
            if work.size >= block_bytes:
                yield work.block()
        yield work.block()


class _Gatherer:
    """Collects the offsets of the messages in chunks."""

    def __init__(self, declared: Declared) -> None:
        self.size = 0
        self._declared = declared
        self._contents: list[bytes] = []
        self._found: list[NDArray[np.int64]] = []
        """Channels, offsets and lengths of each chunk."""
        self._room = np.empty((3, 0), np.int64)

    def record(self, data: Bytes, found: Found) -> None:
        """Handle one record of the file."""
        opcode, offset, start, end = found
        if opcode == Opcode.CHUNK:
            self._content(chunk_content(data[start:end]))
        elif opcode == Opcode.MESSAGE:
            self._content(data[offset:end])
        else:
            self._declared.take(opcode, data[start:end])

    def _content(self, content: bytes) -> None:
        """Handle the records of one chunk."""
        most = len(content) // _FRONT + 1
        if most > self._room.shape[1]:
            self._room = np.empty((3, most), np.int64)
        channels, places, lengths = self._room
        count = find_records(np.frombuffer(content, np.uint8), places, lengths, channels)
        cut, count = count < 0, count if count >= 0 else -count - 1
        declared = np.flatnonzero(channels[:count] < 0)
        if len(declared) > MAX_DECLARED:
            raise ValueError("the chunk has bytes that are not records")
        for index in declared.tolist():
            begin = int(places[index]) + _FRONT
            end = begin + int(lengths[index])
            self._declared.take(-int(channels[index]), content[begin:end])
        found = self._room[:, :count]
        found = found[:, channels[:count] >= 0]
        found[1] += self.size
        self._found.append(found)
        self._contents.append(content)
        self.size += len(content)
        if cut:
            raise ValueError("a record exceeds its chunk")

    def block(self) -> Block:
        """Return the collected messages and reset them."""
        found = np.concatenate([np.empty((3, 0), np.int64), *self._found], axis=1)
        order = np.argsort(found[0].astype(np.uint16), kind="stable")  # 16 bits: radix sort
        channels, places, lengths = np.take(found, order, axis=1)
        bounds = np.flatnonzero(np.diff(channels)) + 1
        known = channels[np.concatenate([[0], bounds])].tolist() if len(channels) else []
        made = Block(
            b"".join(self._contents),
            dict(zip(known, np.split(places, bounds), strict=False)),
            dict(zip(known, np.split(lengths - _MESSAGE_FIXED, bounds), strict=False)),
        )
        self._contents, self._found, self.size = [], [], 0
        return made
