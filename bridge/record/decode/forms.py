"""Decoding of messages to columns: many messages with an equal structure at once.

Most messages of a topic differ in their values only; tags, text lengths and list lengths are equal.
These equal bytes are the structure. Messages with an equal structure have one shape and are decoded
as one array, with the first message as the :class:`Template`. Messages without a common shape are
decoded one by one with the library for their encoding.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

_T = TypeVar("_T")
MAX_COLUMNS = 4096
"""Maximum number of columns of a topic. Nested messages in an unknown schema may have millions."""
MAX_FIELDS = 4 * MAX_COLUMNS
"""Maximum number of fields that are visited for a topic's columns. A nested message without fields
creates no column, so :data:`MAX_COLUMNS` does not limit the work."""
STRUCTURE, VARINT, VALUE = 0xFF, 0x80, 0x00
"""Masks of the bits in a byte that belong to the structure: all, only the continuation bit,
none."""


class Column(NamedTuple):
    """One column of a topic's table."""

    name: str
    type: str
    """A numpy type (``<f8``), ``bool``, ``text``, ``bytes`` or ``json`` (any value as text)."""
    is_list: bool = False
    default: Any = None
    """Value of an omitted field; None: the value is absent."""


class Leaf(NamedTuple):
    """Location of a column's value in a message of one shape."""

    column: Column
    offset: int
    size: int
    """Size, bytes."""
    how: str
    """``fixed``, ``varint``, ``zigzag``, or ``same``: equal in all messages of the shape."""
    value: Any = None
    """Value for ``same``."""


class Template:
    """Shape of one message. All bytes belong to the structure until values are marked."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        """The message from which the template is made."""
        self.head = np.frombuffer(data, np.uint8)
        self.mask = np.full(len(data), STRUCTURE, np.uint8)
        self.leaves: dict[str, Leaf] = {}
        """Location of each column's value, by column name."""

    def mark(self, start: int, end: int, kind: int = VALUE) -> None:
        """Set the kind of some bytes."""
        self.mask[start:end] = kind


class Form(ABC):
    """Decoder of one schema's messages."""

    columns: tuple[Column, ...]

    @abstractmethod
    def template(self, data: bytes) -> Template | None:
        """Return a template of a message; None if other messages cannot have its shape."""

    @abstractmethod
    def row(self, data: bytes) -> Mapping[str, Any]:
        """Decode one message: values by column, without absent ones.

        Raises:
            ValueError: the message is damaged.

        """


class Opaque(Form):
    """Messages of an unknown encoding. The only column is the bytes, or the text."""

    def __init__(self, encoding: str) -> None:
        is_text = encoding.lower() in {"json", "text", "utf-8"}
        self.columns = (Column("json" if is_text else "data", "json" if is_text else "bytes"),)

    def template(self, data: bytes) -> Template | None:
        """Return a template in which all bytes are values."""
        (column,) = self.columns
        template = Template(data)
        template.mark(0, len(data))
        template.leaves[column.name] = Leaf(column, 0, len(data), "fixed")
        return template

    def row(self, data: bytes) -> Mapping[str, Any]:
        """Return the bytes, or the text if the encoding is a text."""
        (column,) = self.columns
        value = data if column.type == "bytes" else data.decode("utf-8", "replace")
        return {column.name: value}


class Budget:
    """Limits the number of visited fields of a schema."""

    def __init__(self) -> None:
        self._left = MAX_FIELDS

    def spend(self) -> None:
        """Count one field.

        Raises:
            ValueError: the schema has too many fields.

        """
        self._left -= 1
        if self._left < 0:
            raise ValueError(f"the schema has more than {MAX_FIELDS} fields")


def few(columns: Iterable[_T]) -> tuple[_T, ...]:
    """Return all columns, or raise an error if there are too many.

    Nested messages multiply columns.

    Raises:
        ValueError: there are more than :data:`MAX_COLUMNS` columns.

    """
    found = tuple(islice(columns, MAX_COLUMNS + 1))
    if len(found) > MAX_COLUMNS:
        raise ValueError(f"the schema has more than {MAX_COLUMNS} fields")
    return found


def varints(rows: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Decode protobuf varints of equal length, one per row."""
    values = np.zeros(len(rows), np.uint64)
    for i in range(rows.shape[1]):
        values |= (rows[:, i] & np.uint8(0x7F)).astype(np.uint64) << np.uint64(7 * i)
    return values


def unzigzag(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Decode protobuf's ``sint`` values, which use zigzag encoding."""
    half = (values >> np.uint64(1)).astype(np.int64)
    signed: NDArray[np.int64] = half ^ -(values & np.uint64(1)).astype(np.int64)
    return signed
