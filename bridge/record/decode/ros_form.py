"""Decoding of ROS 2 messages in CDR to columns, with the definition in the file."""

from __future__ import annotations

import json
import re
import struct
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from bridge.record.decode.forms import Budget, Column, Form, Leaf, Template, few

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


_LITTLE_ENDIAN = b"\x00\x01"
_HEAD = 4
_PRIMITIVES = {
    "bool": "bool",
    "byte": "<u1",
    "char": "<u1",
    "int8": "<i1",
    "uint8": "<u1",
    "int16": "<i2",
    "uint16": "<u2",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "uint64": "<u8",
    "float32": "<f4",
    "float64": "<f8",
    "string": "text",
}
_SHORT = {"time": ("int32 sec", "uint32 nanosec"), "duration": ("int32 sec", "uint32 nanosec")}
_FIELD = re.compile(r"^(\S+?)(\[(?:<=)?\d*\])?\s+(\w+)\s*(=)?")
_DEEPEST = 12


class _Field(NamedTuple):
    """One line of a definition."""

    name: str
    type: str
    array: int | None
    """Length of a fixed array; 0: sequence; None: single value."""


class RosForm(Form):
    """Messages of one ROS 2 type. Fields of nested messages have names with dots."""

    def __init__(self, type_name: str, definition: str) -> None:
        """Parse the definition.

        Raises:
            ValueError: a used type is missing, the text is invalid, or there are too many fields.

        """
        self._types = _definitions(definition)
        self._fixed = True
        self._budget = Budget()
        self.columns = few(self._columns("", "", 0))
        self._by_name = {column.name: column for column in self.columns}
        schema = Schema(id=1, name=type_name, encoding="ros2msg", data=definition.encode())
        try:
            self._decode = DecoderFactory().decoder_for("cdr", schema)
        except Exception as error:  # noqa: BLE001 - any error of the library's parser
            raise ValueError(f"the definition of {type_name} is invalid: {error}") from None

    def _columns(self, type_name: str, prefix: str, depth: int) -> Iterator[Column]:
        if type_name not in self._types:
            raise ValueError(f"the definition of {type_name} is missing")
        for field in self._types[type_name]:
            self._budget.spend()
            name, kind = f"{prefix}{field.name}", _PRIMITIVES.get(field.type)
            if kind is not None:
                yield Column(name, kind, field.array is not None)
            elif field.array is not None or depth >= _DEEPEST:
                self._fixed = False
                yield Column(name, "json")
            else:
                yield from self._columns(field.type, f"{name}.", depth + 1)

    def template(self, data: bytes) -> Template | None:
        """Return a template; None if the message has a list of messages or is damaged."""
        if not self._fixed or data[:2] != _LITTLE_ENDIAN:
            return None
        template = Template(data)
        try:
            end = self._walk(template, _HEAD, "", "")
        except (struct.error, UnicodeDecodeError):
            return None
        return template if end <= len(data) else None

    def _walk(self, template: Template, position: int, type_name: str, prefix: str) -> int:
        """Mark the values of a nested message; return the offset after it."""
        data, leaves = template.data, template.leaves
        for field in self._types[type_name]:
            name = f"{prefix}{field.name}"
            column = self._by_name.get(name)
            if column is None:
                position = self._walk(template, position, field.type, f"{name}.")
                continue
            count = 1 if field.array is None else field.array
            if field.array == 0:
                count, position = _number(data, position)
            if column.type == "text":
                begin, texts = position, []
                for _ in range(count):
                    size, position = _number(data, position)
                    texts.append(data[position : position + size].rstrip(b"\0").decode())
                    position += size
                value = texts if column.is_list else texts[0]
                leaves[name] = Leaf(column, begin, position - begin, "same", value)
                continue
            size = 1 if column.type == "bool" else int(column.type[2:])
            position = _aligned(position, size) if count else position
            leaves[name] = Leaf(column, position, size * count, "fixed")
            template.mark(position, position + size * count)
            position += size * count
        return position

    def row(self, data: bytes) -> Mapping[str, Any]:
        """Decode one message.

        Raises:
            ValueError: the message is damaged.

        """
        if self._decode is None:
            raise ValueError("no decoder for this type")
        try:
            message = self._decode(data)
            return {column.name: _value(message, column) for column in self.columns}
        except Exception as error:  # noqa: BLE001 - any error of the library
            raise ValueError(str(error)) from None


def _number(data: bytes, position: int) -> tuple[int, int]:
    position = _aligned(position, 4)
    value: int = struct.unpack_from("<I", data, position)[0]
    return value, position + 4


def _aligned(position: int, size: int) -> int:
    """Align an offset. CDR counts the alignment from the end of the 4-byte header."""
    return position + -(position - _HEAD) % size


def _definitions(text: str) -> dict[str, list[_Field]]:
    """Return the fields by type name. The name of the message's own type is empty."""
    parts = re.split(r"^=+\s*\nMSG: *(\S+) *\n", text, flags=re.MULTILINE)
    found = {"": _fields(parts[0], "")}
    for name, body in zip(parts[1::2], parts[2::2], strict=True):
        found[name] = _fields(body, name.rpartition("/")[0])
    # A type may be named without its package, or with "/msg/" in the middle.
    aliases = {name.replace("/msg/", "/"): fields for name, fields in found.items()}
    aliases |= {name.rpartition("/")[2]: fields for name, fields in found.items() if name}
    for short, lines in _SHORT.items():
        aliases.setdefault(short, _fields("\n".join(lines), ""))
    resolved = {**aliases, **found}
    for fields in list(found.values()):
        for field in fields:
            if field.type not in _PRIMITIVES and field.type not in resolved:
                alias = field.type.replace("/msg/", "/")
                if alias in resolved:
                    resolved[field.type] = resolved[alias]
    return resolved


def _fields(body: str, package: str) -> list[_Field]:
    found = []
    for line in body.splitlines():
        match = _FIELD.match(line.split("#", 1)[0].strip())
        if match is None or match[4]:  # a comment, or a constant
            continue
        kind, array, name, _ = match.groups()
        kind = "string" if kind.startswith("string<=") else kind
        if "/" not in kind and kind not in _PRIMITIVES and kind not in _SHORT and package:
            kind = f"{package}/{kind}"
        length = None
        if array is not None:
            digits = array[1:-1]
            length = int(digits) if digits.isdigit() else 0
        found.append(_Field(name, kind, length))
    return found


def _value(message: Any, column: Column) -> Any:  # noqa: ANN401 - type of a decoded value
    for part in column.name.split("."):
        message = getattr(message, part)
    if column.type == "json":
        return json.dumps(message, default=_plain)
    return list(message) if column.is_list else message


def _plain(value: Any) -> Any:  # noqa: ANN401 - any decoded value
    if isinstance(value, (bytes, bytearray, memoryview)):
        return list(value)
    names = getattr(value, "__slots__", None) or vars(value)
    return {name: getattr(value, name) for name in names}
