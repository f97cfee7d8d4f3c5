"""Simulates firmware of another version: its message declarations with this program's values.

Messages and fields are matched by name. A field that only the other version declares is zero. A
field or message that the other version does not declare is omitted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import Message, MessageSpec


def as_ours(message: Message, spec: MessageSpec) -> Message:
    """Return a received message in this program's own class; absent fields are zero.

    A message without a class here is returned unchanged.
    """
    own = CATALOGUE.by_name.get(spec.name)
    if own is None or (own.cls is spec.cls and None not in message):
        return message
    return _filled(own, _by_name(spec, message))


def as_declared(message: Message, catalogue: Catalogue) -> Message | None:
    """Return a message in the class that ``catalogue`` declares; None if it declares none."""
    if type(message) in catalogue.by_class:
        return message
    declared = catalogue.by_name.get(CATALOGUE.spec(type(message)).name)
    return None if declared is None else as_spec(message, declared)


def as_spec(message: Message, declared: MessageSpec) -> Message:
    """Return one of our messages in the declaration of another version."""
    if message.__class__ is declared.cls:
        return message
    return _filled(declared, _by_name(CATALOGUE.spec(type(message)), message))


def blank(spec: MessageSpec) -> Message:
    """Return a message with zero in every field."""
    return _filled(spec, {})


def _by_name(spec: MessageSpec, message: Message) -> dict[str, Any]:
    return {f.name: v for f, v in zip(spec.fields, message, strict=True) if v is not None}


def _filled(spec: MessageSpec, values: dict[str, Any]) -> Message:
    nothing = [
        "" if f.wire.is_text else 0 if f.wire.is_integer else bytes(f.wire.size)
        for f in spec.fields
    ]
    return spec.cls(
        *(values.get(f.name, zero) for f, zero in zip(spec.fields, nothing, strict=True))
    )
