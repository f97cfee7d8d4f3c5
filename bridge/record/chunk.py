"""The open chunk of an MCAP file: messages, rows and their packing."""

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
"""Maximum size of a chunk's content, bytes."""
CHUNK_NS = 250_000_000
"""Maximum time span of a chunk, ns. A killed process loses at most the last 0.5 s of records: the
open chunk, which the recorder writes 0.2 s after its last record."""

_MESSAGE = struct.Struct("<BQHIQQ")
_FIXED = _MESSAGE.size - RECORD_HEAD


class OpenChunk:
    """Collects messages in the order of arrival. The object is reused for each chunk.

    Messages of a fixed form are stored as rows of numbers; their place in the content is reserved.
    """

    def __init__(self) -> None:
        """Create an empty chunk without rows."""
        self._zstd = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._parts: list[tuple[int, bytes]] = []
        """Offset and bytes of all content except rows."""
        self._entries: list[array[int]] = []
        """Log time and offset of each single message, by channel."""
        self._rows: list[Rows] = []
        self.size = 0
        """Size of the content with the reserved rows, bytes. The next message starts at this
        offset."""
        self.earliest_ns = self.deadline_ns = 0
        """Range of log times of this chunk's messages, ns."""

    def declare(self, record: bytes) -> None:
        """Add a record that is not a message."""
        self._parts.append((self.size, record))
        self.size += len(record)

    def add_channel(self, record: bytes) -> None:
        """Add the record of the next channel. Channels are numbered from 1."""
        self._entries.append(array("q"))
        self.declare(record)

    def rows(self, ints: int, floats: int, messages: Iterable[RowMessage]) -> Rows:
        """Declare messages that always occur together; see :class:`Rows`."""
        made = Rows(ints, floats, messages)
        self._rows.append(made)
        return made

    def begin(self, log_ns: int) -> None:
        """Start the chunk with a message of this time."""
        # The lower limit closes the chunk if the clock is set back. Otherwise the chunk would stay
        # open until it is full.
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
        """Return the packed chunk and start a new one. Return None if there is no message."""
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
    """Sort the index of a channel with several forms by time, then by offset."""
    rows = np.frombuffer(entries, dtype=np.int64).reshape(-1, 2)
    return rows[np.lexsort((rows[:, 1], rows[:, 0]))].tobytes()
