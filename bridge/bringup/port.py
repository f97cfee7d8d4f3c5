"""Port of a bring-up session, and the error for a procedure that a person has ended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bridge.errors import StoppedForSafetyError

if TYPE_CHECKING:
    from protocol.clock import HostNs
    from protocol.link import LinkBase


class BringupPort(Protocol):
    """A port with a clock. It is a real port, or the virtual device in virtual time."""

    @property
    def link(self) -> type[LinkBase]:
        """Type of the link over this port."""

    def now(self) -> HostNs:
        """Return the monotonic time."""

    def turn(self, data: bytes, until_ns: HostNs) -> bytes:
        """Send ``data`` and return the first bytes that arrive, or no bytes at ``until_ns``."""

    def close(self) -> None:
        """Close the port."""


class InterruptedByPersonError(StoppedForSafetyError):
    """A person ended the procedure early; the robot was stopped."""

    exit_status = 1
