"""CAN messages that wait for their tag."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from protocol.uart.framing import FLAG_AUTHENTICATED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from protocol.authentication import Authenticator
    from protocol.can.stamps import StampExtender
    from protocol.link import Received

TOGETHER_US = 10_000
"""Maximum time between a message and its tag, µs. Without a tag in this time, the message counts as
untagged."""


class Held(NamedTuple):
    """A held message, the frames that its tag covers, and the stamp state after a valid tag."""

    came_us: int
    covered: Sequence[tuple[int, bytes]]
    event: Received
    stamps: StampExtender


class HeldMessages:
    """Held messages, at most one per node."""

    def __init__(self) -> None:
        self._held: dict[int, Held] = {}

    def hold(
        self,
        event: Received,
        covered: Sequence[tuple[int, bytes]],
        stamps: StampExtender,
        now_us: int,
    ) -> Received | None:
        """Store a message until its tag arrives; return the node's earlier untagged message."""
        node = event.frame.node
        before = self._held.get(node)
        self._held[node] = Held(now_us, covered, event, stamps)
        return None if before is None else before.event

    def tagged(self, node: int, data: bytes, key: Authenticator, now_us: int) -> Held | None:
        """Check a tag; return its message, marked as authentic, or None if the tag is invalid."""
        held = self._held.pop(node, None)
        if held is None or now_us - held.came_us > TOGETHER_US:
            return None
        if not key.check_can(held.covered, data):
            return None
        frame = held.event.frame
        flags = frame.version_flags | FLAG_AUTHENTICATED
        event = held.event._replace(frame=frame._replace(version_flags=flags))
        return held._replace(event=event)

    def late(self, now_us: int) -> list[Received]:
        """Return the messages whose tag did not arrive in time; they count as untagged."""
        if not self._held:
            return []
        late = [n for n, held in self._held.items() if now_us - held.came_us > TOGETHER_US]
        return [self._held.pop(node).event for node in late]
