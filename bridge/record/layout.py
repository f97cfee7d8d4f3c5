"""Flat protobuf messages of fixed layout: descriptor and encoder from one list of fields.

Integers go as fixed-width protobuf types, so that a message without text is one
``struct.pack`` call with its tags as constants between the values. Measured on the IMU
message (16 fields): 1.9 µs, against 8.4 µs to build and serialise a google.protobuf message
and 6.3 µs to refill one. What fixed width costs in bytes, zstd takes back.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PACKAGE = "sweepctl"

_FIXED64, _LENGTH_DELIMITED, _FIXED32 = 1, 2, 5


class Kind(Enum):
    """A protobuf type: its descriptor's number, wire type and ``struct`` code."""

    DOUBLE = (FieldDescriptorProto.TYPE_DOUBLE, _FIXED64, "d")
    FIXED32 = (FieldDescriptorProto.TYPE_FIXED32, _FIXED32, "I")
    SFIXED32 = (FieldDescriptorProto.TYPE_SFIXED32, _FIXED32, "i")
    FIXED64 = (FieldDescriptorProto.TYPE_FIXED64, _FIXED64, "Q")
    SFIXED64 = (FieldDescriptorProto.TYPE_SFIXED64, _FIXED64, "q")
    STRING = (FieldDescriptorProto.TYPE_STRING, _LENGTH_DELIMITED, "")
    BYTES = (FieldDescriptorProto.TYPE_BYTES, _LENGTH_DELIMITED, "")

    def __init__(
        self, proto_type: FieldDescriptorProto.Type.ValueType, wire_type: int, code: str
    ) -> None:
        self.proto_type = proto_type
        self.wire_type = wire_type
        self.code = code


@dataclass(frozen=True, slots=True)
class FlatField:
    """One field of a flat message."""

    name: str
    kind: Kind
    number: int

    @property
    def tag(self) -> bytes:
        """The key that stands before the value."""
        return varint(self.number << 3 | self.kind.wire_type)


def varint(value: int) -> bytes:
    """Protobuf's variable-length form of an unsigned integer."""
    out = bytearray()
    while value > 0x7F:  # noqa: PLR2004 - seven bits a byte
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


class FlatMessage:
    """A protobuf message of scalars, text and bytes; a value of None is left out."""

    def __init__(self, name: str, fields: Sequence[FlatField]) -> None:
        self.name = name
        self.fields = tuple(fields)
        self._fixed = [i for i, f in enumerate(fields) if f.kind.code]
        self._variable = [(i, f.tag, f.kind) for i, f in enumerate(fields) if not f.kind.code]
        self._packers: dict[tuple[int, ...], Callable[[list[Any]], bytes]] = {}
        self._pack_all = self._packer(tuple(self._fixed))

    @property
    def full_name(self) -> str:
        """Package and name, as a schema is called."""
        return f"{PACKAGE}.{self.name}"

    def descriptor_set(self) -> bytes:
        """The message's ``FileDescriptorSet``, as an MCAP schema holds it."""
        file = FileDescriptorProto(
            name=f"{PACKAGE}/{self.name}.proto",
            package=PACKAGE,
            syntax="proto2",  # where every field may be absent, and says so
        )
        message = file.message_type.add(name=self.name)
        for field in self.fields:
            message.field.add(
                name=field.name,
                number=field.number,
                type=field.kind.proto_type,
                label=FieldDescriptorProto.LABEL_OPTIONAL,
            )
        return FileDescriptorSet(file=[file]).SerializeToString()

    def encode(self, values: list[Any]) -> bytes:
        """Serialise one value per field, in the fields' order."""
        if self._variable:
            fixed = [values[i] for i in self._fixed]
            return self._encode_fixed(fixed) + self._encode_variable(values)
        return self._encode_fixed(values)

    def _encode_fixed(self, values: list[Any]) -> bytes:
        if None not in values:
            return self._pack_all(values)
        present = tuple(i for i, v in zip(self._fixed, values, strict=True) if v is not None)
        packer = self._packers.get(present)
        if packer is None:
            packer = self._packers[present] = self._packer(present)
        return packer([v for v in values if v is not None])

    def _encode_variable(self, values: list[Any]) -> bytes:
        out = b""
        for index, tag, kind in self._variable:
            value = values[index]
            if value is not None:
                # A lone surrogate must not end a recording.
                data = value.encode(errors="replace") if kind is Kind.STRING else value
                out += tag + varint(len(data)) + data
        return out

    def _packer(self, present: tuple[int, ...]) -> Callable[[list[Any]], bytes]:
        """Packer of these fixed fields: tags at even places, values at odd ones."""
        fields = [self.fields[i] for i in present]
        layout = struct.Struct("<" + "".join(f"{len(f.tag)}s{f.kind.code}" for f in fields))
        template: list[Any] = [part for f in fields for part in (f.tag, 0)]
        pack = layout.pack

        def packer(values: list[Any]) -> bytes:
            parts = template.copy()
            parts[1::2] = values
            return pack(*parts)

        return packer
