"""What a listener on a CAN bus keeps of each sender there."""

from __future__ import annotations

from dataclasses import dataclass

from protocol.can.stamps import StampExtender


@dataclass(slots=True)
class Pending:
    """A message of which a part is still to come."""

    stamp_us: int
    parts: dict[int, bytes]


class Sender:
    """What is known of one sender on the bus."""

    def __init__(self) -> None:
        self.stamps = StampExtender()
        self.pending: dict[int, Pending] = {}
        self.slow: dict[tuple[int, int], bytes] = {}
        self.messages = 0
        """Given out: numbered so, for want of a sequence number on the wire."""
        self.frames = 0
        """Since its last Sync."""
        self.count: int | None = None
        """What that said."""
