"""Protobuf wire format: keys, variable-length integers, length-delimited fields."""

from __future__ import annotations

WIRE_VARINT, WIRE_FIXED64, WIRE_DELIMITED, WIRE_FIXED32 = 0, 1, 2, 5
"""Wire types of protobuf."""


def varint(value: int) -> bytes:
    """Encode an unsigned integer as a protobuf varint."""
    out = bytearray()
    while value > 0x7F:  # noqa: PLR2004 - seven bits per byte
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def tag(number: int, wire_type: int) -> bytes:
    """Return the key before a field's value."""
    return varint(number << 3 | wire_type)


def delimited(number: int, content: bytes | str) -> bytes:
    """Encode a field of text, bytes or a message."""
    data = content.encode() if isinstance(content, str) else content
    return tag(number, WIRE_DELIMITED) + varint(len(data)) + data
