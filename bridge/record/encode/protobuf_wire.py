"""The bytes of a protobuf message: keys, variable-length integers, delimited fields."""

from __future__ import annotations

WIRE_VARINT, WIRE_FIXED64, WIRE_DELIMITED, WIRE_FIXED32 = 0, 1, 2, 5
"""Wire types."""


def varint(value: int) -> bytes:
    """Protobuf's variable-length form of an unsigned integer."""
    out = bytearray()
    while value > 0x7F:  # noqa: PLR2004 - seven bits a byte
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def tag(number: int, wire_type: int) -> bytes:
    """The key that stands before a field's value."""
    return varint(number << 3 | wire_type)


def delimited(number: int, content: bytes | str) -> bytes:
    """A field of text, bytes or another message."""
    data = content.encode() if isinstance(content, str) else content
    return tag(number, WIRE_DELIMITED) + varint(len(data)) + data
