"""Error counters of the device's CAN controller: fault confinement (ISO 11898-1, 12.1.4).

The model is simplified: an error increases either the sender's counter (by 8) or the receiver's
counter (by 1). A missing acknowledgement does not count as an error, so a device without a host
stays on the bus.
"""

from __future__ import annotations

SEND_ERROR, RECEIVE_ERROR = 8, 1
"""Increase of the send error counter and of the receive error counter after an error. A good frame
decreases the counter by 1."""
RECEIVE_MAX = 127
"""Maximum of the receive error counter; further errors have no effect."""
OFF_AT = 256
"""Value of the send error counter at which the controller leaves the bus."""
SHOWN_MAX = 255
RECOVERY_BITS = 128 * 11
"""Number of recessive bits after which a controller ends bus-off by itself (bxCAN setting ABOM)."""


class CanController:
    """Counts errors and leaves the bus after too many."""

    def __init__(self) -> None:
        self._send = self._receive = 0
        self.offs = 0
        """Number of bus-off events."""
        self.is_off = False

    @property
    def send_errors(self) -> int:
        """Send error counter (TEC), as in the controller's register."""
        return SHOWN_MAX if self.is_off else min(SHOWN_MAX, self._send)

    @property
    def receive_errors(self) -> int:
        """Receive error counter (REC)."""
        return self._receive

    def sent(self, *, good: bool) -> None:
        """Count a frame that the device has sent; ``good`` is False if the frame was destroyed."""
        if self.is_off:
            return
        self._send = max(0, self._send - 1) if good else self._send + SEND_ERROR
        if self._send >= OFF_AT:
            self.leave()

    def received(self, *, good: bool) -> None:
        """Count a frame from another node; ``good`` is False if the frame was destroyed."""
        if not self.is_off:
            change = -1 if good else RECEIVE_ERROR
            self._receive = min(RECEIVE_MAX, max(0, self._receive + change))

    def leave(self) -> None:
        """Enter the bus-off state."""
        if not self.is_off:
            self.is_off = True
            self.offs += 1

    def rejoin(self) -> None:
        """Reset the error counters and join the bus, after bus-off or a reset of the chip."""
        self.is_off = False
        self._send = self._receive = 0
