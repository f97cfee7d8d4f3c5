"""A log's messages in blocks: the bytes of many chunks, and where in them each topic's stand."""

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
"""Opcode and length."""
MESSAGE_HEAD = 31
"""All that stands before a message's data, ..."""
_MESSAGE_FIXED = MESSAGE_HEAD - _FRONT
SEQUENCE, LOG_NS, PUBLISH_NS = (11, 4), (15, 8), (23, 8)
"""... and where in it these are, and their size."""


@dataclass(frozen=True, slots=True)
class Block:
    """Messages of some chunks on end."""

    data: bytes
    starts: dict[int, NDArray[np.int64]]
    """By channel: where each message's record begins in ``data``."""
    lengths: dict[int, NDArray[np.int64]]
    """By channel: how long each message is, in bytes."""


def blocks(
    path: Path, declared: Declared, problems: list[str], block_bytes: int = BLOCK_BYTES
) -> Iterator[Block]:
    """Read a log from front to back; what is damaged is stepped over and named.

    Raises:
        LogReadError: it is missing, cannot be read, or is no MCAP file.

    """
    with opened(path) as data:
        declared.preload(read_file_summary(data, 0, first_end(data)[0]).declared)
        work = _Gatherer(declared)
        for found in records(data, indexes=False):
            if isinstance(found, DamagedBytes):
                what = "all from there on is cut or damaged" if found.is_tail else "skipped"
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
    """Walks chunks and notes where messages stand."""

    def __init__(self, declared: Declared) -> None:
        self.size = 0
        self._declared = declared
        self._contents: list[bytes] = []
        self._found: list[NDArray[np.int64]] = []
        """Channels, places and lengths, chunk by chunk."""
        self._room = np.empty((3, 0), np.int64)

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
        if most > self._room.shape[1]:
            self._room = np.empty((3, most), np.int64)
        channels, places, lengths = self._room
        count = find_records(np.frombuffer(content, np.uint8), places, lengths, channels)
        cut, count = count < 0, count if count >= 0 else -count - 1
        declared = np.flatnonzero(channels[:count] < 0)
        if len(declared) > MAX_DECLARED:
            raise ValueError("it holds bytes that are no records")
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
            raise ValueError("a record ends beyond its chunk")

    def block(self) -> Block:
        """What was gathered; begins anew."""
        found = np.concatenate([np.empty((3, 0), np.int64), *self._found], axis=1)
        order = np.argsort(found[0].astype(np.uint16), kind="stable")  # of 16 bits: by radix
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
