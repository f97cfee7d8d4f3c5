"""Messages and catalogues of another version of the project."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from protocol.messages import ALL_MESSAGES
from protocol.schema.catalogue import Catalogue
from protocol.schema.fields import U16, number
from protocol.schema.message import CanPart, Message, message, specify

if TYPE_CHECKING:
    from collections.abc import Iterable

EXTRA = Annotated[int, number(U16, "count", "something new")]
"""A field that another version has appended."""


def hints_of(original: type[Message]) -> dict[str, Any]:
    """Return the fields of a message, to be changed and declared again."""
    return {f.name: Annotated[int, f] for f in specify(original).fields}


def variant(
    original: type[Message],
    hints: dict[str, Any],
    *,
    name: str | None = None,
    can_parts: tuple[CanPart, ...] = (),
) -> type[Message]:
    """Return a message of the same type with other fields, and by default the same name."""
    spec = specify(original)
    cls: type[Message] = type(name or original.__name__, (Message,), {"__annotations__": hints})
    cls.__doc__ = original.__doc__
    declare = message(
        spec.type_id,
        spec.direction,
        spec.rate,
        default_hz=spec.default_hz,
        bootstrap=spec.bootstrap,
        to_all=spec.to_all,
        can_parts=can_parts or spec.can_parts,
    )
    return declare(cls)


def longer(original: type[Message], name: str = "extra") -> type[Message]:
    """Return the message with one more field."""
    return variant(original, {**hints_of(original), name: EXTRA})


def shorter(original: type[Message], fields: int) -> type[Message]:
    """Return the message with its first fields only."""
    return variant(original, dict(list(hints_of(original).items())[:fields]))


def catalogue(
    *, less: Iterable[type[Message]] = (), more: Iterable[type[Message]] = ()
) -> Catalogue:
    """Return the project's catalogue without ``less``; ``more`` replaces messages of equal name."""
    less, more = list(less), list(more)
    replaced = {m.__name__ for m in (*less, *more)}
    return Catalogue([*(m for m in ALL_MESSAGES if m.__name__ not in replaced), *more])
