"""What a listener on a CAN bus keeps of each sender there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.can.stamps import StampExtender

if TYPE_CHECKING:
    from protocol.can.frames import CanFrame


@dataclass(slots=True)
class Pending:
    """A message of which a part is still to come."""

    stamp_us: int
    frames: dict[int, CanFrame]
    """By the number of the part."""


class Sender:
    """What is known of one sender on the bus."""

    def __init__(self) -> None:
        self.stamps = StampExtender()
        self.pending: dict[tuple[int, int], Pending] = {}
        """By node and message type: a host's messages name the device that they are for."""
        self.slow: dict[tuple[int, int], bytes] = {}
        self.messages = 0
        """Given out: numbered so, for want of a sequence number on the wire."""
        self.frames = 0
        """Since its last Sync."""
        self.count: int | None = None
        """What that said."""
