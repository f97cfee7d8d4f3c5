"""Error counters of the device's CAN controller: fault confinement (ISO 11898-1, 12.1.4).

The model is simplified: an error counts either for the sender (+8) or for the receiver (+1). A
missing acknowledgement is no error, so a missing host does not silence the device.
"""

from __future__ import annotations

SEND_ERROR, RECEIVE_ERROR = 8, 1
"""Increase of the send or the receive error counter after an error; a good frame decreases it by
1."""
RECEIVE_MAX = 127
"""Maximum of the receive error counter; more errors have no effect on the bus."""
OFF_AT = 256
"""Value of the send error counter at which the controller leaves the bus."""
SHOWN_MAX = 255
RECOVERY_BITS = 128 * 11
"""Number of recessive bits after which a bus-off controller returns by itself (bxCAN: ABOM)."""


class CanController:
    """Counts errors and leaves the bus after too many."""

    def __init__(self) -> None:
        self._send = self._receive = 0
        self.offs = 0
        """Number of times that the controller has left the bus."""
        self.is_off = False

    @property
    def send_errors(self) -> int:
        """Send error counter (TEC), as its register shows it."""
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
        """Count a frame of another node."""
        if not self.is_off:
            change = -1 if good else RECEIVE_ERROR
            self._receive = min(RECEIVE_MAX, max(0, self._receive + change))

    def leave(self) -> None:
        """Leave the bus."""
        if not self.is_off:
            self.is_off = True
            self.offs += 1

    def rejoin(self) -> None:
        """Return to the bus, or start again after a reset of the chip."""
        self.is_off = False
        self._send = self._receive = 0
