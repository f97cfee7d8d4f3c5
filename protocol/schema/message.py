"""Converts an annotated class to a message type and its specification.

``@message(...)`` converts a class of annotated fields to an immutable tuple type. The decoder
creates an instance directly from the result of ``struct.unpack``. For type checkers, the class is a
frozen dataclass.
"""

from __future__ import annotations

import inspect
import re
import struct
from collections import namedtuple
from dataclasses import dataclass
from enum import Enum
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    NamedTuple,
    TypeVar,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from protocol.schema.fields import Field, SiValue, SiValueOrNone

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from types import ModuleType


class Message:
    """Base of every message: raw wire values by field name, immutable, comparable.

    At run time every message is also a ``tuple`` of its fields in wire order.
    """

    __slots__ = ()

    if TYPE_CHECKING:

        def __iter__(self) -> Iterator[Any]: ...

    def __eq__(self, other: object) -> bool:
        """Return whether type and values are equal."""
        return (
            isinstance(other, Message) and type(self) is type(other) and tuple(self) == tuple(other)
        )

    def __ne__(self, other: object) -> bool:
        """Negate :meth:`__eq__`; the inherited ``tuple.__ne__`` would compare only the values."""
        return not self == other

    def __hash__(self) -> int:
        """Hash of type and values."""
        return hash((type(self).__name__, tuple(self)))

    def __repr__(self) -> str:
        """Return a readable text: values in SI units if available, else raw values."""
        cls = type(self)
        in_si = {
            value.bound_to: name
            for name, value in vars(cls).items()
            if isinstance(value, SiValue | SiValueOrNone)
        }
        names = [in_si.get(field.name, field.name) for field in _DECLARATIONS[cls].fields]
        values = (getattr(self, name) for name in names)
        shown = (f"{v:.6g}" if isinstance(v, float) else repr(v) for v in values)
        return f"{cls.__name__}({', '.join(map('='.join, zip(names, shown, strict=True)))})"


MAX_TYPE = 0x7E
MAKERS_TYPES = range(0x50, 0x60)
"""Message types reserved for manufacturers. The project never uses them."""
_ANY_CASE = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


M = TypeVar("M", bound=Message)


class Direction(Enum):
    """The sender of a message."""

    DEVICE = "device"
    HOST = "host"


class RateClass(Enum):
    """Timing of a message; it determines the maximum size and the CAN encoding."""

    STREAM = "stream"
    """Periodic; at most 25 B on UART and self-contained CAN frames of 6 B."""
    COMMAND = "command"
    """Command with an id; it is retried until it is acknowledged or rejected."""
    RARE = "rare"
    """Occasional; may be long."""


class CanPart(NamedTuple):
    """One of several CAN frames that carry a periodic message."""

    can_type: int
    """Type in the frame's identifier. Part 0 has the type of the message."""
    name: str = ""
    """Suffix of the message's name in the DBC."""
    slow_us: int = 0
    """Minimum time between two transmissions, µs; 0: sent with every message. Receivers store the
    last value."""


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """All properties of one message."""

    type_id: int
    name: str
    cls: type[Message]
    direction: Direction
    rate: RateClass
    default_hz: float
    bootstrap: bool
    """True: needed for the handshake. Such a message never changes and needs no negotiation."""
    to_all: bool
    """True: may be addressed to node 0, which means every device."""
    minimal: bool
    """True: part of the smallest set of messages that the generated C can contain."""
    needs_tag: bool
    """True: a device with a key accepts this host message only with a tag."""
    can_parts: tuple[CanPart, ...]
    """CAN frames of a periodic message, by part number."""
    full_stamp: bool
    """True: on CAN the message starts with the full ``t_us`` instead of the short stamp."""
    doc: str
    fields: tuple[Field, ...]
    layout: struct.Struct
    """Layout of the fixed part; a text field follows it."""
    text_field: Field | None
    """Trailing text field, if any."""
    is_numeric: bool
    """True: all fields are integers, so ``struct`` alone packs them and rejects values out of
    range."""

    def canonical(self) -> list[str]:
        """Return the input lines of the schema hash: the message, then each of its fields."""
        lines = [f"{self.name}|{self.direction.value}|{self.rate.value}"]
        for field in self.fields:
            part = self.can_parts[field.can_part].can_type if field.can_part else None
            lines.append(field.canonical() + ("|" if part is None else f"|{part:02x}"))
        return lines

    @property
    def is_bare(self) -> bool:
        """True if the message has no fields and every sender sends the same frame."""
        return not self.fields

    def prefix_layout(self, count: int) -> struct.Struct:
        """Return the layout of the first ``count`` fields, which an older peer declares."""
        return struct.Struct("<" + "".join(f.wire.code for f in self.fields[:count]))


class _Declaration(NamedTuple):
    type_id: int
    direction: Direction
    rate: RateClass
    default_hz: float
    bootstrap: bool
    to_all: bool
    minimal: bool
    needs_tag: bool
    can_parts: tuple[CanPart, ...]
    full_stamp: bool
    fields: tuple[Field, ...]


_DECLARATIONS: dict[type[Message], _Declaration] = {}


@dataclass_transform(frozen_default=True)
def message(  # noqa: PLR0913 - the properties of a message
    type_id: int,
    direction: Direction,
    rate: RateClass,
    *,
    default_hz: float = 0.0,
    bootstrap: bool = False,
    to_all: bool = False,
    minimal: bool = False,
    tagged: bool = True,
    can_parts: tuple[CanPart, ...] = (),
    full_stamp: bool = False,
) -> Callable[[type[M]], type[M]]:
    """Declare the decorated class as a message.

    ``tagged`` is False for a host's message that never needs a tag, because it only stops the
    robot, or neither moves the robot nor changes a setting. ``can_parts`` names the CAN frames of a
    stream that needs several frames.
    """

    def register(cls: type[M]) -> type[M]:
        hints = get_type_hints(cls, include_extras=True)
        names = list(hints)
        defaults = [vars(cls)[name] for name in names if name in vars(cls)]
        values = namedtuple(cls.__name__, names, defaults=defaults)  # type: ignore[misc]  # noqa: PYI024  # fields are known at run time only
        body = {k: v for k, v in vars(cls).items() if k not in {*names, "__dict__", "__weakref__"}}
        made = type(cls.__name__, (Message, values), {**body, "__slots__": ()})
        _DECLARATIONS[made] = _Declaration(
            type_id,
            direction,
            rate,
            default_hz,
            bootstrap,
            to_all,
            minimal or bootstrap,
            tagged and direction is Direction.HOST,
            can_parts or (CanPart(type_id),),
            full_stamp,
            tuple(_declared_fields(cls, hints)),
        )
        return cast("type[M]", made)

    return register


def declared_in(module: ModuleType) -> tuple[type[Message], ...]:
    """Return the messages that a module declares, in the order of their declaration."""
    return tuple(v for v in vars(module).values() if isinstance(v, type) and v in _DECLARATIONS)


def specify(cls: type[Message]) -> MessageSpec:
    """Read a declared message's annotations into its specification.

    Raises:
        TypeError: the class was not declared with :func:`message`, a field lacks its declaration, a
            text is not the last field, or a CAN part is not declared.

    """
    declaration = _DECLARATIONS.get(cls)
    if declaration is None:
        raise TypeError(f"{cls.__name__} is not declared as a message")
    fields = declaration.fields
    for field in fields[:-1]:
        if field.wire.is_text:
            raise TypeError(f"{cls.__name__}.{field.name}: only the last field may be text")
    for field in fields:
        if field.can_part >= len(declaration.can_parts):
            raise TypeError(f"{cls.__name__}.{field.name}: CAN part {field.can_part} has no type")
    for attribute in vars(cls).values():
        if isinstance(attribute, SiValue | SiValueOrNone):
            attribute.bind(fields)
    return MessageSpec(
        declaration.type_id,
        _ANY_CASE.sub("_", cls.__name__).lower(),
        cls,
        declaration.direction,
        declaration.rate,
        declaration.default_hz,
        declaration.bootstrap,
        declaration.to_all,
        declaration.minimal,
        declaration.needs_tag,
        declaration.can_parts,
        declaration.full_stamp,
        inspect.cleandoc(cls.__doc__ or ""),
        fields,
        struct.Struct("<" + "".join(f.wire.code for f in fields)),
        fields[-1] if fields and fields[-1].wire.is_text else None,
        all(f.wire.is_integer for f in fields),
    )


def _declared_fields(cls: type[Message], hints: dict[str, Any]) -> Iterator[Field]:
    for name, hint in hints.items():
        declared = [a for a in _annotations(hint) if isinstance(a, Field)]
        if len(declared) != 1:
            raise TypeError(f"{cls.__name__}.{name}: needs exactly one field declaration")
        yield declared[0].named(name)


def _annotations(hint: Any) -> Iterable[Any]:  # noqa: ANN401 - a type form
    if get_origin(hint) is Annotated:
        return get_args(hint)[1:]
    return [a for part in get_args(hint) for a in _annotations(part)]
