"""Frames from the run's process to the server's process: a kind, a length and content."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO

_HEAD = struct.Struct("<BI")


class FrameKind(IntEnum):
    """Kind of a frame."""

    FILE = 1
    """A log file begins; no content."""
    RECORDS = 2
    """Whole MCAP records: schemas, channels, a chunk."""
    DROPPED = 3
    """Number of messages that were dropped so far, as text."""
    PARAMETERS = 4
    """Parameters of the run: a JSON object of names and values."""


class PipeFrame(NamedTuple):
    """One frame."""

    kind: FrameKind
    content: bytes = b""

    def to_bytes(self) -> bytes:
        """Return the frame with its header."""
        return _HEAD.pack(self.kind, len(self.content)) + self.content


def read_frames(stream: BinaryIO) -> Iterator[PipeFrame]:
    """Yield the frames until the end of the stream. An incomplete last frame is ignored."""
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        kind, length = _HEAD.unpack(head)
        content = stream.read(length)
        if len(content) != length:
            return
        yield PipeFrame(FrameKind(kind), content)
