"""Protobuf's descriptions of messages, written by hand; a library for it costs a start 0.1 s.

Only what the log's schemas need: messages of singular fields, one enumeration within one,
in the field order in which Google's library writes them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

WIRE_VARINT, WIRE_FIXED64, WIRE_DELIMITED, WIRE_FIXED32 = 0, 1, 2, 5
"""Wire types."""
_OPTIONAL = 1


class Type(IntEnum):
    """``FieldDescriptorProto.Type``."""

    DOUBLE = 1
    INT64 = 3
    INT32 = 5
    FIXED64 = 6
    FIXED32 = 7
    STRING = 9
    MESSAGE = 11
    BYTES = 12
    ENUM = 14
    SFIXED32 = 15
    SFIXED64 = 16


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


def _integer(number: int, value: int) -> bytes:
    return tag(number, WIRE_VARINT) + varint(value)


@dataclass(frozen=True, slots=True)
class FieldType:
    """One field: its number, its type, and of a message or an enumeration the full name."""

    name: str
    number: int
    type: Type
    type_name: str = ""

    def encode(self) -> bytes:
        """``FieldDescriptorProto``."""
        data = delimited(1, self.name) + _integer(3, self.number) + _integer(4, _OPTIONAL)
        data += _integer(5, self.type)
        return data + (delimited(6, self.type_name) if self.type_name else b"")


@dataclass(frozen=True, slots=True)
class MessageType:
    """One message in a file of its own."""

    file: str
    package: str
    name: str
    fields: tuple[FieldType, ...]
    syntax: str = "proto3"
    uses: tuple[MessageType, ...] = ()
    """Messages of other files, in the order in which they are imported."""
    enums: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Enumerations declared within it: names of the values 0, 1, 2, ..."""

    @property
    def full_name(self) -> str:
        """Package and name, as a schema is called."""
        return f"{self.package}.{self.name}"

    def encode(self) -> bytes:
        """``FileDescriptorProto``."""
        message = delimited(1, self.name)
        message += b"".join(delimited(2, f.encode()) for f in self.fields)
        for name, values in self.enums.items():
            numbered = (delimited(1, v) + _integer(2, n) for n, v in enumerate(values))
            message += delimited(
                4, delimited(1, name) + b"".join(delimited(2, v) for v in numbered)
            )
        file = delimited(1, self.file) + delimited(2, self.package)
        file += b"".join(delimited(3, used.file) for used in self.uses)
        return file + delimited(4, message) + delimited(12, self.syntax)


def descriptor_set(message: MessageType) -> bytes:
    """``FileDescriptorSet``: the message's file after every file that it needs."""
    files: dict[str, bytes] = {}

    def visit(types: Iterable[MessageType]) -> None:
        for one in types:
            visit(one.uses)
            files.setdefault(one.file, one.encode())

    visit((message,))
    return b"".join(delimited(1, file) for file in files.values())
