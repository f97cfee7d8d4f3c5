"""How the bytes of a message are read as columns: many messages of one shape at once.

Messages of one topic mostly differ in their values only: tags, text lengths and list lengths
are the same. So the first of them is taken apart byte by byte into a :class:`Template`, and
all others whose structure bytes are equal are read as one array. What is never twice alike
goes a message at a time, through the library that knows its encoding.
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
"""Of one topic: a schema that somebody else wrote may nest messages into millions of them."""
MAX_FIELDS = 4 * MAX_COLUMNS
"""Most fields that are looked at for a topic's columns: messages without fields make no column, and
nest as others do."""
STRUCTURE, VARINT, VALUE = 0xFF, 0x80, 0x00
"""Of a byte: all of it must be as in the template, or whether more follow, or nothing."""


class Column(NamedTuple):
    """One column of a topic's table."""

    name: str
    type: str
    """A numpy type (``<f8``), ``bool``, ``text``, ``bytes`` or ``json`` (text of anything)."""
    is_list: bool = False
    default: Any = None
    """Of what is left out of a message; None: then it is not there."""


class Leaf(NamedTuple):
    """Where a column's value stands in a message of one shape."""

    column: Column
    offset: int
    size: int
    """In bytes."""
    how: str
    """``fixed``, ``varint``, ``zigzag``, or ``same``: equal in all messages of the shape."""
    value: Any = None
    """Of ``same``."""


class Template:
    """The shape of one message, all structure until values are marked in it."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        """The message that it is made of."""
        self.head = np.frombuffer(data, np.uint8)
        self.mask = np.full(len(data), STRUCTURE, np.uint8)
        self.leaves: dict[str, Leaf] = {}
        """By the column's name."""

    def mark(self, start: int, end: int, kind: int = VALUE) -> None:
        """Say what some bytes are."""
        self.mask[start:end] = kind


class Form(ABC):
    """How one schema's messages are read."""

    columns: tuple[Column, ...]

    @abstractmethod
    def template(self, data: bytes) -> Template | None:
        """Take a message apart; None where its shape cannot be that of others."""

    @abstractmethod
    def row(self, data: bytes) -> Mapping[str, Any]:
        """Read one message by itself: values by column, what is absent left out.

        Raises:
            ValueError: it is damaged.

        """


class Opaque(Form):
    """Messages in an encoding that is not known: their bytes, or their text."""

    def __init__(self, encoding: str) -> None:
        is_text = encoding.lower() in {"json", "text", "utf-8"}
        self.columns = (Column("json" if is_text else "data", "json" if is_text else "bytes"),)

    def template(self, data: bytes) -> Template | None:
        """Nothing but values."""
        (column,) = self.columns
        template = Template(data)
        template.mark(0, len(data))
        template.leaves[column.name] = Leaf(column, 0, len(data), "fixed")
        return template

    def row(self, data: bytes) -> Mapping[str, Any]:
        """The bytes, or the text that they are."""
        (column,) = self.columns
        value = data if column.type == "bytes" else data.decode("utf-8", "replace")
        return {column.name: value}


class Budget:
    """Counts the fields of a schema that are looked at."""

    def __init__(self) -> None:
        self._left = MAX_FIELDS

    def spend(self) -> None:
        """Look at one more.

        Raises:
            ValueError: they are too many.

        """
        self._left -= 1
        if self._left < 0:
            raise ValueError(f"it has more than {MAX_FIELDS} fields")


def few(columns: Iterable[_T]) -> tuple[_T, ...]:
    """All columns, where there are not too many: messages in messages multiply.

    Raises:
        ValueError: there are.

    """
    found = tuple(islice(columns, MAX_COLUMNS + 1))
    if len(found) > MAX_COLUMNS:
        raise ValueError(f"it has more than {MAX_COLUMNS} fields")
    return found


def varints(rows: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Protobuf's variable-length integers, one a row, all of one length."""
    values = np.zeros(len(rows), np.uint64)
    for i in range(rows.shape[1]):
        values |= (rows[:, i] & np.uint8(0x7F)).astype(np.uint64) << np.uint64(7 * i)
    return values


def unzigzag(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Protobuf's ``sint`` values from what was written for them."""
    half = (values >> np.uint64(1)).astype(np.int64)
    signed: NDArray[np.int64] = half ^ -(values & np.uint64(1)).astype(np.int64)
    return signed
