"""Conversion of a parameter's value to and from its 32 bits in a message."""

from __future__ import annotations

import struct

from protocol.messages.values import ParameterKind

_F32 = struct.Struct("<f")
_U32 = struct.Struct("<I")


def to_raw(kind: ParameterKind, value: float) -> int:
    """Return the 32 bits of a value, which is in range."""
    if kind == ParameterKind.F32:
        raw: int = _U32.unpack(_F32.pack(value))[0]
        return raw
    return int(value)


def from_raw(kind: int, raw: int) -> float:
    """Return the value that 32 bits represent; a float may be infinite or NaN."""
    if kind == ParameterKind.F32:
        value: float = _F32.unpack(_U32.pack(raw))[0]
        return value
    return raw


def rounded_f32(value: float) -> float:
    """Return the nearest value of 32 bits.

    Raises:
        OverflowError: the value is beyond the range of 32 bits.

    """
    nearest: float = _F32.unpack(_F32.pack(value))[0]
    return nearest
