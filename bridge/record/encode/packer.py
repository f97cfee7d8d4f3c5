"""A row of constants and values as one ``struct.pack``: what every fixed form is made of."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

Part = bytes | str
"""Constant bytes, or the ``struct`` code of one value; ``"12s"`` is a value of twelve bytes."""


class Packer:
    """Packs the values of a form whose other bytes never change, little-endian."""

    def __init__(self, parts: Iterable[Part]) -> None:
        # Constants that meet are joined here once, so that between two values there is at most
        # one: constant bytes at even places of the argument list, values at odd ones.
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
        """What ``form`` packs, values to be put in at odd places."""
        for code, constant in zip(codes, constants[1:], strict=True):
            layout += f"{code}{len(constant)}s"
            self.template += (0, constant)
        form = struct.Struct(layout)
        self.form = form.pack
        self.size = form.size
        """Bytes of the whole."""

    def pack(self, values: Iterable[Any]) -> bytes:
        """Serialise one value for each code, in their order.

        Raises:
            ValueError: there are more or fewer of them than the form has places.

        """
        parts = self.template.copy()
        parts[1::2] = values
        return self.form(*parts)
