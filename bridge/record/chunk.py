"""The chunk in progress of an MCAP file: messages one by one, rows, and what it closes to."""

from __future__ import annotations

import struct
import zlib
from array import array
from typing import TYPE_CHECKING

import numpy as np
import zstandard

from bridge.record.encode.rows import OP_MESSAGE, RECORD_HEAD, Rows
from bridge.record.mcap_file import ZSTD_LEVEL, Chunk

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bridge.record.encode.rows import RowMessage

CHUNK_BYTES = 256 * 1024
CHUNK_NS = 250_000_000
"""Half of what a kill may lose; the other half is the recorder's patience with an idle line."""

_MESSAGE = struct.Struct("<BQHIQQ")
_FIXED = _MESSAGE.size - RECORD_HEAD


class OpenChunk:
    """Collects messages, in the order in which they come; the same object begins anew each time.

    Those of fixed form wait as rows of numbers, for which their place is kept free.
    """

    def __init__(self) -> None:
        """Nothing in it, and no kinds of rows."""
        self._zstd = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._parts: list[tuple[int, bytes]] = []
        """What is no row: where it begins, and its bytes."""
        self._entries: list[array[int]] = []
        """By channel: log time and place of each of its messages that came one by one."""
        self._rows: list[Rows] = []
        self.size = 0
        """Bytes so far, rows that wait included: the place of what comes next."""
        self.earliest_ns = self.deadline_ns = 0
        """A message belongs into it whose log time is in between, while it is not full."""

    def declare(self, record: bytes) -> None:
        """Add a record that is no message."""
        self._parts.append((self.size, record))
        self.size += len(record)

    def add_channel(self, record: bytes) -> None:
        """Add the record of the next channel; they are numbered from 1."""
        self._entries.append(array("q"))
        self.declare(record)

    def rows(self, ints: int, floats: int, messages: Iterable[RowMessage]) -> Rows:
        """Declare messages that always come together; see :class:`Rows`."""
        made = Rows(ints, floats, messages)
        self._rows.append(made)
        return made

    def begin(self, log_ns: int) -> None:
        """Begin with a message of this time."""
        # Also closed by a clock that was set back, or the chunk would stay open until it is full.
        self.earliest_ns, self.deadline_ns = log_ns - CHUNK_NS, log_ns + CHUNK_NS

    def add(
        self, channel_id: int, log_ns: int, publish_ns: int, sequence: int, data: bytes
    ) -> None:
        """Add one message."""
        place = self.size
        self._entries[channel_id - 1].extend((log_ns, place))
        size = _FIXED + len(data)
        head = _MESSAGE.pack(OP_MESSAGE, size, channel_id, sequence, log_ns, publish_ns)
        self._parts.append((place, head + data))
        self.size = place + RECORD_HEAD + size

    def close(self) -> Chunk | None:
        """Give what is in it, and begin anew; None: no message."""
        if not any(self._entries) and not any(rows.ints for rows in self._rows):
            return None
        indexes: dict[int, list[bytes]] = {}
        spans: list[int] = []
        content = bytearray(self.size)
        for place, data in self._parts:
            content[place : place + len(data)] = data
        self._parts.clear()
        chunk = np.frombuffer(content, dtype=np.uint8)
        for channel_id, entries in enumerate(self._entries, 1):
            if entries:
                indexes[channel_id] = [entries.tobytes()]
                times = entries[::2]
                spans += (min(times), max(times))
                del entries[:]
        for rows in self._rows:
            if rows.ints:
                packed = rows.take(chunk)
                spans += (packed.first_ns, packed.last_ns)
                for channel_id, index in zip(rows.channels, packed.entries, strict=True):
                    indexes.setdefault(channel_id, []).append(index.tobytes())
        self.size = self.earliest_ns = self.deadline_ns = 0
        return Chunk(
            "zstd",
            self._zstd.compress(content),
            len(content),
            zlib.crc32(content),
            min(spans),
            max(spans),
            {
                channel_id: parts[0] if len(parts) == 1 else _in_order(b"".join(parts))
                for channel_id, parts in sorted(indexes.items())
            },
        )


def _in_order(entries: bytes) -> bytes:
    """Of several forms of one channel: by time, then by place."""
    rows = np.frombuffer(entries, dtype=np.int64).reshape(-1, 2)
    return rows[np.lexsort((rows[:, 1], rows[:, 0]))].tobytes()
