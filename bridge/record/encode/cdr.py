"""Encoder of ROS 2 messages with a fixed layout in CDR: one ``struct.pack`` per message.

The encoding is plain CDR, little-endian: each value is aligned to its size, counted from the end of
the 4-byte header. A string is encoded as its length, which includes a final zero byte, then its
bytes.
"""

from __future__ import annotations

import struct
from typing import Any

from bridge.record.encode.packer import Packer, Part

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_NANOSECONDS = 1_000_000_000


class CdrLayout:
    """Encoder of a message whose texts and array lengths are constant.

    ``parts`` are the message's values in order. A value that varies is a ``struct`` code (``"d"``,
    or ``"3d"`` for three values). A constant is a (code, value) pair. A constant string has the
    code ``"text"``.
    """

    def __init__(self, *parts: str | tuple[str, Any]) -> None:
        self.parts: list[Part] = [LITTLE_ENDIAN]
        """Constants and codes in order, with alignment."""
        self._size = 0
        for part in parts:
            if isinstance(part, tuple):
                code, value = part
                if code == "text":
                    data = str(value).encode() + b"\0"
                    self._append("I", struct.pack("<I", len(data)))
                    self.parts.append(data)
                    self._size += len(data)
                else:
                    self._append(code, struct.pack(f"<{code}", value))
            else:
                for _ in range(int(part[:-1] or 1)):
                    self._append(part[-1], part[-1])
        self._packer = Packer(self.parts)

    def _append(self, code: str, part: Part) -> None:
        """Add a constant or a code, aligned to its size."""
        size = struct.calcsize(f"<{code}")
        padding = -self._size % size
        self.parts += (bytes(padding), part)
        self._size += padding + size

    def encode(self, *values: float) -> bytes:
        """Serialise the varying values, in order.

        Raises:
            ValueError: the number of values differs from the layout's.

        """
        return self._packer.pack(values)


def stamp(time_ns: int) -> tuple[int, int]:
    """Return seconds and nanoseconds, as in ``builtin_interfaces/Time``."""
    return divmod(time_ns, _NANOSECONDS)
