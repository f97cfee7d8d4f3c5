"""ROS 2 messages of fixed layout in CDR: one ``struct.pack`` a message.

Plain CDR, little-endian: every value aligned to its size, counted from after the four bytes
that say so; a text is its length with the closing zero, then its bytes.
"""

from __future__ import annotations

import struct
from typing import Any

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_NANOSECONDS = 1_000_000_000


class CdrLayout:
    """Encoder of one message form whose texts and array lengths never change.

    ``parts`` are the message's values in order: a ``struct`` code for what differs from
    message to message (``"d"``, or ``"3d"`` for three), a text, or a (code, value) pair for
    what stays.
    """

    def __init__(self, *parts: str | tuple[str, Any]) -> None:
        # What stays is packed here once: constant bytes at even places, values at odd ones.
        self._format = ["<"]
        self._template: list[Any] = []
        self._constant = LITTLE_ENDIAN
        for part in parts:
            if isinstance(part, tuple):
                code, value = part
                if code == "text":
                    data = str(value).encode() + b"\0"
                    self._append_constant("I", len(data))
                    self._constant += data
                else:
                    self._append_constant(code, value)
            else:
                count, code = int(part[:-1] or 1), part[-1]
                for _ in range(count):
                    self._append_varying(code)
        self._end_constant()
        self._pack = struct.Struct("".join(self._format)).pack

    def _align(self, code: str) -> None:
        done = struct.calcsize("".join(self._format)) + len(self._constant)
        self._constant += bytes(-(done - len(LITTLE_ENDIAN)) % struct.calcsize(f"<{code}"))

    def _append_constant(self, code: str, value: object) -> None:
        self._align(code)
        self._constant += struct.pack(f"<{code}", value)

    def _append_varying(self, code: str) -> None:
        self._align(code)
        self._end_constant()
        self._format.append(code)
        self._template.append(0)

    def _end_constant(self) -> None:
        self._format.append(f"{len(self._constant)}s")
        self._template.append(self._constant)
        self._constant = b""

    def encode(self, *values: float) -> bytes:
        """Serialise the values that vary, in their order.

        Raises:
            ValueError: there are more or fewer of them than the layout has places.

        """
        parts = self._template.copy()
        parts[1::2] = values
        return self._pack(*parts)


def stamp(time_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds, as ``builtin_interfaces/Time`` has them."""
    return divmod(time_ns, _NANOSECONDS)
