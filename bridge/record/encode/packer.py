"""Packing of constants and values with one ``struct.pack``."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

Part = bytes | str
"""Constant bytes, or the ``struct`` code of one value; ``"12s"`` is a value of twelve bytes."""


class Packer:
    """Packs values between constant bytes, little-endian."""

    def __init__(self, parts: Iterable[Part]) -> None:
        # Join adjacent constants. Constants are then the arguments with even indices, and values
        # are the arguments with odd indices.
        codes: list[str] = []
        constants = [b""]
        for part in parts:
            if isinstance(part, bytes):
                constants[-1] += part
            else:
                codes.append(part)
                constants.append(b"")
        layout = f"<{len(constants[0])}s"
        self.template: list[Any] = [constants[0]]
        """Arguments of ``form.pack``. Values are at the odd indices."""
        for code, constant in zip(codes, constants[1:], strict=True):
            layout += f"{code}{len(constant)}s"
            self.template += (0, constant)
        form = struct.Struct(layout)
        self.form = form.pack
        self.size = form.size
        """Size of the result, bytes."""

    def pack(self, values: Iterable[Any]) -> bytes:
        """Serialise one value per code, in order.

        Raises:
            ValueError: the number of values differs from the number of codes.

        """
        parts = self.template.copy()
        parts[1::2] = values
        return self.form(*parts)
