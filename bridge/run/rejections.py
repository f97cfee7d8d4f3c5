"""Rejected commands: reasons as text, checks and errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import (
    CommandRejectedError,
    DeviceLostError,
    NoAnswerError,
    ParameterError,
    Remedy,
    shown,
)
from protocol.messages.values import NackReason, label
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from protocol.link import LinkBase
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message


def rejection_text(reason: int) -> str:
    """Return the reason's name, with an explanation if the name alone is not enough."""
    name = label(NackReason, reason)
    if reason == NackReason.NOT_AUTHENTICATED:
        return f"{name}; the robot requires a key"
    return name


def rejection_remedy(reason: int | None) -> Remedy | None:
    """Return the remedy for a rejection, or None."""
    return Remedy.KEY if reason == NackReason.NOT_AUTHENTICATED else None


def check_known(what: str, kind: type[Message], link: LinkBase) -> None:
    """Check that the device's firmware has a command.

    Raises:
        CommandRejectedError: the firmware lacks the command ``what``.

    """
    if link.codec.catalogue.by_class[kind].type_id in link.disabled:
        raise CommandRejectedError(what, "the device's firmware lacks this command; update it")


def check_fields(what: str, kind: type[Message], fields: Sequence[object]) -> None:
    """Check that the values of a command fit its message.

    Raises:
        ParameterError: a value does not fit; the text names ``what``, field, value and limits.

    """
    spec = CATALOGUE.by_class[kind]
    for field, value in zip(spec.fields[1:], fields, strict=True):
        low, high = field.wire.low, field.wire.high
        if not isinstance(value, int) or not low <= value <= high:
            raise ParameterError(f"{what}: {field.name} {shown(value)} is not in {low} to {high}")


def check_outcome(what: str, outcome: Outcome | None, signs: Callable[[], bool]) -> None:
    """Check that a command was executed; None: no device was connected.

    ``signs`` returns whether commands are signed with a key. The key may differ from the device's.

    Raises:
        CommandRejectedError: the device rejected the command.
        DeviceLostError: no device was connected.
        NoAnswerError: the device did not answer.

    """
    if outcome is None:
        raise DeviceLostError(f"no answer to {what}: the device is lost or not connected")
    if outcome.accepted:
        return
    if outcome.reason is None:
        raise NoAnswerError(what, signed=signs())
    text = rejection_text(outcome.reason)
    if outcome.reason == NackReason.OTHER_MODE:
        text += "; the device does not do this in its present mode: run sweepctl stop first"
    error = CommandRejectedError(what, text)
    error.remedy = rejection_remedy(outcome.reason)
    raise error
