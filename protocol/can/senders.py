"""State that a listener on a CAN bus keeps of each sender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.can.stamps import StampExtender

if TYPE_CHECKING:
    from protocol.can.frames import CanFrame


@dataclass(slots=True)
class Pending:
    """A message of which some parts are missing."""

    stamp_us: int
    frames: dict[int, CanFrame]
    """Frames by the number of the part."""


class Sender:
    """State of one sender on the bus."""

    def __init__(self) -> None:
        self.stamps = StampExtender()
        self.pending: dict[tuple[int, int], Pending] = {}
        """Incomplete messages by node and message type; a host's messages name the addressed
        device."""
        self.slow: dict[tuple[int, int], bytes] = {}
        self.messages = 0
        """Number of messages delivered; it replaces the sequence number, which CAN lacks."""
        self.frames = 0
        """Number of frames since the last Sync."""
        self.count: int | None = None
        """Count in that Sync."""
