"""ROS 2 messages of fixed layout in CDR: one ``struct.pack`` a message.

Plain CDR, little-endian: every value aligned to its size, counted from after the four bytes
that say so; a text is its length with the closing zero, then its bytes.
"""

from __future__ import annotations

import struct
from typing import Any

from bridge.record.encode.packer import Packer, Part

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_NANOSECONDS = 1_000_000_000


class CdrLayout:
    """Encoder of one message form whose texts and array lengths never change.

    ``parts`` are the message's values in order: a ``struct`` code for what differs from
    message to message (``"d"``, or ``"3d"`` for three), a text, or a (code, value) pair for
    what stays.
    """

    def __init__(self, *parts: str | tuple[str, Any]) -> None:
        self.parts: list[Part] = [LITTLE_ENDIAN]
        """Constants and values in their places, alignment included."""
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
        """Add a constant or a value, aligned to its size."""
        size = struct.calcsize(f"<{code}")
        padding = -self._size % size
        self.parts += (bytes(padding), part)
        self._size += padding + size

    def encode(self, *values: float) -> bytes:
        """Serialise the values that vary, in their order.

        Raises:
            ValueError: there are more or fewer of them than the layout has places.

        """
        return self._packer.pack(values)


def stamp(time_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds, as ``builtin_interfaces/Time`` has them."""
    return divmod(time_ns, _NANOSECONDS)
