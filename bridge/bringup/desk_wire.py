"""What a desk talks over, and how a person ends what it does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bridge.errors import StoppedForSafetyError

if TYPE_CHECKING:
    from protocol.clock import HostNs
    from protocol.link import LinkBase


class Wire(Protocol):
    """What carries bytes to the device and back, and knows the time."""

    @property
    def link(self) -> type[LinkBase]:
        """What is spoken over it."""

    def now(self) -> HostNs:
        """Monotonic time."""

    def turn(self, data: bytes, until_ns: HostNs) -> bytes:
        """Send, and give what comes; returns as soon as something has, or at that time."""

    def close(self) -> None:
        """Give it back."""


class InterruptedByPersonError(StoppedForSafetyError):
    """A person ended the procedure before it was done; the robot was stopped."""

    exit_status = 1
