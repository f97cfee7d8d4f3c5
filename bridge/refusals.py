"""A device's refusals in words."""

from __future__ import annotations

from protocol.values import NackReason, label


def refusal(reason: int) -> str:
    """The reason by its name, and what to do where a user can do something."""
    name = label(NackReason, reason)
    if reason == NackReason.NOT_AUTHENTICATED:
        return f"{name}; the robot has a key: give it with --key-file"
    return name
