"""What a device's answers come to: its refusals in words, and the errors that carry them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import (
    CommandRejectedError,
    DeviceLostError,
    ParameterError,
    Remedy,
    shown,
)
from protocol.schema.catalogue import CATALOGUE
from protocol.values import NackReason, label

if TYPE_CHECKING:
    from collections.abc import Sequence

    from protocol.commands import Outcome
    from protocol.link import LinkBase
    from protocol.schema.message import Message


def refusal(reason: int) -> str:
    """The reason by its name, with its cause where the name alone does not give it."""
    name = label(NackReason, reason)
    if reason == NackReason.NOT_AUTHENTICATED:
        return f"{name}; the robot has a key"
    return name


def refusal_remedy(reason: int | None) -> Remedy | None:
    """What a caller can do about a refusal."""
    return Remedy.KEY if reason == NackReason.NOT_AUTHENTICATED else None


def check_known(what: str, kind: type[Message], link: LinkBase) -> None:
    """See that the device's firmware has a command.

    Raises:
        CommandRejectedError: it does not; ``what`` names it.

    """
    if link.codec.catalogue.by_class[kind].type_id in link.disabled:
        raise CommandRejectedError(what, "its firmware does not have this command")


def check_fields(what: str, kind: type[Message], fields: Sequence[object]) -> None:
    """See that the values of a command fit its message.

    Raises:
        ParameterError: one does not; names ``what``, the field, its value and its limits.

    """
    spec = CATALOGUE.by_class[kind]
    for field, value in zip(spec.fields[1:], fields, strict=True):
        low, high = field.wire.low, field.wire.high
        if not isinstance(value, int) or not low <= value <= high:
            raise ParameterError(f"{what}: {field.name} {shown(value)} is not in {low} to {high}")


def check_outcome(what: str, outcome: Outcome | None) -> None:
    """See that a command was carried out; None: there was nobody to ask.

    Raises:
        CommandRejectedError: the device refused it.
        DeviceLostError: it did not answer.

    """
    if outcome is None:
        raise DeviceLostError(f"no answer to {what}: the device is not there")
    if outcome.accepted:
        return
    if outcome.reason is None:
        raise DeviceLostError(f"the device did not answer {what}")
    error = CommandRejectedError(what, refusal(outcome.reason))
    error.remedy = refusal_remedy(outcome.reason)
    raise error
