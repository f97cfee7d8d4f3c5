"""Decoding of protobuf messages to columns, with the descriptor in the file."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from bridge.record.decode.forms import VALUE, VARINT, Budget, Column, Form, Leaf, Template, few
from bridge.record.encode.protobuf_wire import WIRE_VARINT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from google.protobuf.descriptor import Descriptor

_DEEPEST = 8
_LONGEST_VARINT_BITS = 70
"""Maximum number of bits of a varint: ten bytes with seven bits each."""
_F = FieldDescriptor
_TYPES: dict[int, tuple[str, str]] = {
    _F.TYPE_DOUBLE: ("<f8", "fixed"),
    _F.TYPE_FLOAT: ("<f4", "fixed"),
    _F.TYPE_FIXED32: ("<u4", "fixed"),
    _F.TYPE_FIXED64: ("<u8", "fixed"),
    _F.TYPE_SFIXED32: ("<i4", "fixed"),
    _F.TYPE_SFIXED64: ("<i8", "fixed"),
    _F.TYPE_INT32: ("<i4", "varint"),
    _F.TYPE_INT64: ("<i8", "varint"),
    _F.TYPE_UINT32: ("<u4", "varint"),
    _F.TYPE_UINT64: ("<u8", "varint"),
    _F.TYPE_SINT32: ("<i4", "zigzag"),
    _F.TYPE_SINT64: ("<i8", "zigzag"),
    _F.TYPE_BOOL: ("bool", "varint"),
    _F.TYPE_ENUM: ("<i4", "varint"),
    _F.TYPE_STRING: ("text", "fixed"),
    _F.TYPE_BYTES: ("bytes", "fixed"),
}
_NESTED = {_F.TYPE_MESSAGE, _F.TYPE_GROUP}


class ProtobufForm(Form):
    """Messages of one protobuf type. Fields of nested messages have names with dots."""

    def __init__(self, type_name: str, descriptor_set: bytes) -> None:
        """Parse the descriptors.

        Raises:
            ValueError: the descriptors do not describe the type.

        """
        pool = DescriptorPool()
        try:
            for file in FileDescriptorSet.FromString(descriptor_set).file:
                pool.Add(file)
            self._descriptor = pool.FindMessageTypeByName(type_name)
            self._class = GetMessageClass(self._descriptor)
        except (DecodeError, KeyError, TypeError) as error:
            raise ValueError(f"no valid descriptor of {type_name}: {error}") from None
        self._by_path: dict[tuple[int, ...], Column] = dict(
            few(_columns(self._descriptor, (), "", Budget()))
        )
        self.columns = tuple(self._by_path.values())

    def template(self, data: bytes) -> Template | None:
        """Return a template; None if a field is repeated or the message is damaged."""
        template = Template(data)
        present: set[tuple[int, ...]] = {()}
        try:
            whole = self._walk(template, (0, len(data)), self._descriptor, (), present)
        except IndexError:
            return None
        for path, column in self._by_path.items():
            # An omitted field has its default value if the message that contains it is present.
            if column.default is not None and path[:-1] in present:
                template.leaves.setdefault(column.name, Leaf(column, 0, 0, "same", column.default))
        return template if whole else None

    def _walk(
        self,
        template: Template,
        span: tuple[int, int],
        descriptor: Descriptor | None,
        path: tuple[int, ...],
        present: set[tuple[int, ...]],
    ) -> bool:
        """Mark the values of a nested message; return False if its structure is not fixed."""
        position, end = span
        while position < end:
            key, position = _varint(template.data, position)
            here, wire = (*path, key >> 3), key & 7
            start, position = _content(template.data, position, wire)
            if position > end:
                return False
            field = descriptor.fields_by_number.get(key >> 3) if descriptor else None
            column = self._by_path.get(here)
            if column is None and field is not None:
                present.add(here)
                inner = (start, position)
                if not self._walk(template, inner, field.message_type, here, present):
                    return False
                continue
            template.mark(start, position, VARINT if wire == WIRE_VARINT else VALUE)
            if column is None or field is None:
                continue  # a field of a newer schema
            if column.is_list or column.type == "json":
                return False
            how = _TYPES[field.type][1]
            template.leaves[column.name] = Leaf(column, start, position - start, how)
        return True

    def row(self, data: bytes) -> Mapping[str, Any]:
        """Decode one message.

        Raises:
            ValueError: the message is damaged.

        """
        try:
            message = self._class.FromString(data)
        except DecodeError as error:
            raise ValueError(str(error)) from None
        return {
            column.name: value
            for path, column in self._by_path.items()
            if (value := _value(message, path, column)) is not None
        }


def _columns(
    descriptor: Descriptor | None, path: tuple[int, ...], prefix: str, budget: Budget
) -> Iterator[tuple[tuple[int, ...], Column]]:
    for field in descriptor.fields if descriptor is not None else ():
        budget.spend()
        here, name = (*path, field.number), f"{prefix}{field.name}"
        if field.type in _NESTED:
            if field.is_repeated or len(path) >= _DEEPEST:
                yield here, Column(name, "json")
            else:
                yield from _columns(field.message_type, here, f"{name}.", budget)
            continue
        kind = _TYPES[field.type][0]
        # An absent value becomes null if the schema can express absence. Sweepctl's schemas can.
        default = None if field.has_presence or field.is_repeated else field.default_value
        yield here, Column(name, kind, field.is_repeated, default)


def _content(data: bytes, position: int, wire: int) -> tuple[int, int]:
    """Return the start and the end of a field's value.

    Raises:
        IndexError: the wire type is unknown, or the value exceeds the data.

    """
    match wire:
        case 0:
            return position, _varint(data, position)[1]
        case 1:
            return position, position + 8
        case 2:
            size, start = _varint(data, position)
            return start, start + size
        case 5:
            return position, position + 4
    raise IndexError(wire)


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """Return a varint's value and the offset after it.

    Raises:
        IndexError: the varint has more than 64 bits or exceeds the data.

    """
    value = shift = 0
    while shift < _LONGEST_VARINT_BITS:
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < VARINT:
            return value, position
        shift += 7
    raise IndexError(position)


def _value(message: Any, path: tuple[int, ...], column: Column) -> Any:  # noqa: ANN401 - decoded
    for number in path[:-1]:
        field = message.DESCRIPTOR.fields_by_number[number]
        if not message.HasField(field.name):
            return None
        message = getattr(message, field.name)
    field = message.DESCRIPTOR.fields_by_number[path[-1]]
    if column.type == "json":
        made = MessageToDict(message, preserving_proto_field_name=True)
        return json.dumps(made.get(field.name))
    if column.is_list:
        return list(getattr(message, field.name))
    if field.has_presence and not message.HasField(field.name):
        return None
    return getattr(message, field.name)
