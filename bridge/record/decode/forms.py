"""Decoding of messages to columns: many messages of one shape at once.

Most messages of a topic differ in their values only; tags, text lengths and list lengths are equal.
The first message becomes a :class:`Template`, and all messages with equal structure bytes are
decoded as one array. Messages without a common shape are decoded one by one by the library of
their encoding.
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
"""Maximum number of columns of a topic. A foreign schema may nest messages into millions."""
MAX_FIELDS = 4 * MAX_COLUMNS
"""Maximum number of fields that are visited for a topic's columns. Messages without fields create
no column but nest too."""
STRUCTURE, VARINT, VALUE = 0xFF, 0x80, 0x00
"""Mask of a byte: all bits must be equal, only the continuation bit, or none."""


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
    """Shape of one message. All bytes are structure until values are marked."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        """The message that the template is made from."""
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
        """Return a template of a message; None if other messages cannot share its shape."""

    @abstractmethod
    def row(self, data: bytes) -> Mapping[str, Any]:
        """Decode one message: values by column, without absent ones.

        Raises:
            ValueError: the message is damaged.

        """


class Opaque(Form):
    """Messages of an unknown encoding: their bytes, or their text."""

    def __init__(self, encoding: str) -> None:
        is_text = encoding.lower() in {"json", "text", "utf-8"}
        self.columns = (Column("json" if is_text else "data", "json" if is_text else "bytes"),)

    def template(self, data: bytes) -> Template | None:
        """Return a template that has values only."""
        (column,) = self.columns
        template = Template(data)
        template.mark(0, len(data))
        template.leaves[column.name] = Leaf(column, 0, len(data), "fixed")
        return template

    def row(self, data: bytes) -> Mapping[str, Any]:
        """Return the bytes, or the text if they are text."""
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
            ValueError: there are too many.

        """
        self._left -= 1
        if self._left < 0:
            raise ValueError(f"the schema has more than {MAX_FIELDS} fields")


def few(columns: Iterable[_T]) -> tuple[_T, ...]:
    """Return all columns if there are not too many. Nested messages multiply them.

    Raises:
        ValueError: there are too many.

    """
    found = tuple(islice(columns, MAX_COLUMNS + 1))
    if len(found) > MAX_COLUMNS:
        raise ValueError(f"the schema has more than {MAX_COLUMNS} fields")
    return found


def varints(rows: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Decode protobuf varints, one per row, all of one length."""
    values = np.zeros(len(rows), np.uint64)
    for i in range(rows.shape[1]):
        values |= (rows[:, i] & np.uint8(0x7F)).astype(np.uint64) << np.uint64(7 * i)
    return values


def unzigzag(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Decode protobuf's ``sint`` values."""
    half = (values >> np.uint64(1)).astype(np.int64)
    signed: NDArray[np.int64] = half ^ -(values & np.uint64(1)).astype(np.int64)
    return signed
