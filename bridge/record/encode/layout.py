"""Flat protobuf messages of fixed layout: descriptor and encoder from one list of fields.

Integers have fixed-width protobuf types. One ``struct.pack`` with constant tags between the values
therefore encodes a message without text. For the IMU message (16 fields) this takes 1.9 µs. A new
google.protobuf message takes 8.4 µs, a reused one 6.3 µs. Fixed-width integers are larger, but zstd
compression removes the additional size.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from bridge.record.encode.packer import Packer, Part
from bridge.record.encode.protobuf_wire import (
    WIRE_DELIMITED,
    WIRE_FIXED32,
    WIRE_FIXED64,
    tag,
    varint,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PACKAGE = "sweepctl"
_Proto = FieldDescriptorProto


class FieldKind(Enum):
    """A protobuf type: number in the descriptor, wire type and ``struct`` code."""

    DOUBLE = (_Proto.TYPE_DOUBLE, WIRE_FIXED64, "d")
    FIXED32 = (_Proto.TYPE_FIXED32, WIRE_FIXED32, "I")
    SFIXED32 = (_Proto.TYPE_SFIXED32, WIRE_FIXED32, "i")
    FIXED64 = (_Proto.TYPE_FIXED64, WIRE_FIXED64, "Q")
    SFIXED64 = (_Proto.TYPE_SFIXED64, WIRE_FIXED64, "q")
    STRING = (_Proto.TYPE_STRING, WIRE_DELIMITED, "")
    BYTES = (_Proto.TYPE_BYTES, WIRE_DELIMITED, "")

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
    kind: FieldKind
    number: int

    @property
    def tag(self) -> bytes:
        """Protobuf key (field number and wire type) before the field's value."""
        return tag(self.number, self.kind.wire_type)


class FlatMessage:
    """A protobuf message with scalars, text and bytes. A value of None is omitted."""

    def __init__(self, name: str, fields: Sequence[FlatField]) -> None:
        self.name = name
        self.fields = tuple(fields)
        self._fixed = [i for i, f in enumerate(fields) if f.kind.code]
        self._variable = [(i, f.tag, f.kind) for i, f in enumerate(fields) if not f.kind.code]
        self._packers: dict[tuple[int, ...], Packer] = {}
        self.all_parts = self.parts(self._fixed)
        """Parts of all fields except text and bytes."""
        self._all = Packer(self.all_parts)

    @property
    def is_fixed(self) -> bool:
        """True without text and bytes. The set of present fields then determines the length."""
        return not self._variable

    def parts(self, present: Iterable[int]) -> list[Part]:
        """Return key and value code of each of these fields, given by index."""
        fields = [self.fields[i] for i in present]
        return [part for f in fields for part in (f.tag, f.kind.code)]

    @property
    def full_name(self) -> str:
        """Package and name, as in a schema."""
        return f"{PACKAGE}.{self.name}"

    def descriptor_set(self) -> bytes:
        """Return the message's ``FileDescriptorSet``, as in an MCAP schema."""
        # Use proto2, because it distinguishes an absent field from a field with its default value.
        path = f"{PACKAGE}/{self.name}.proto"
        file = FileDescriptorProto(name=path, package=PACKAGE, syntax="proto2")
        message = file.message_type.add(name=self.name)
        for field in self.fields:
            message.field.add(
                name=field.name,
                number=field.number,
                type=field.kind.proto_type,
                label=_Proto.LABEL_OPTIONAL,
            )
        return FileDescriptorSet(file=[file]).SerializeToString()

    def encode(self, values: list[Any]) -> bytes:
        """Serialise one value per field, in the order of the fields."""
        if self._variable:
            fixed = [values[i] for i in self._fixed]
            return self._encode_fixed(fixed) + self._encode_variable(values)
        return self._encode_fixed(values)

    def _encode_fixed(self, values: list[Any]) -> bytes:
        if None not in values:
            return self._all.pack(values)
        present = tuple(i for i, v in zip(self._fixed, values, strict=True) if v is not None)
        packer = self._packers.get(present)
        if packer is None:
            packer = self._packers[present] = Packer(self.parts(present))
        return packer.pack(v for v in values if v is not None)

    def _encode_variable(self, values: list[Any]) -> bytes:
        out = b""
        for index, key, kind in self._variable:
            value = values[index]
            if value is not None:
                # A lone surrogate must not fail.
                data = value.encode(errors="replace") if kind is FieldKind.STRING else value
                out += key + varint(len(data)) + data
        return out
