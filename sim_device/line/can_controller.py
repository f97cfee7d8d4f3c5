"""Error counters of the device's CAN controller: fault confinement (ISO 11898-1, 12.1.4).

Simplified: an error counts for the sender alone (+8) or for the receiver alone (+1). A missing
acknowledgement is no error, so that a missing host does not silence the device.
"""

from __future__ import annotations

SEND_ERROR, RECEIVE_ERROR = 8, 1
"""Added to the send and to the receive error counter by an error; a good frame takes one away."""
RECEIVE_MAX = 127
"""Receive errors beyond this have no effect on the bus."""
OFF_AT = 256
"""Send errors at which the controller leaves the bus."""
SHOWN_MAX = 255
RECOVERY_BITS = 128 * 11
"""Recessive bits after which a controller that is off returns by itself (bxCAN: ABOM)."""


class CanController:
    """Counts errors, and leaves the bus when there are too many."""

    def __init__(self) -> None:
        self._send = self._receive = 0
        self.offs = 0
        """Number of times that it has left the bus."""
        self.is_off = False

    @property
    def send_errors(self) -> int:
        """TEC, as its register shows it."""
        return SHOWN_MAX if self.is_off else min(SHOWN_MAX, self._send)

    @property
    def receive_errors(self) -> int:
        """REC."""
        return self._receive

    def sent(self, *, good: bool) -> None:
        """Count a frame that it has sent, or that was destroyed on its way."""
        if self.is_off:
            return
        self._send = max(0, self._send - 1) if good else self._send + SEND_ERROR
        if self._send >= OFF_AT:
            self.leave()

    def received(self, *, good: bool) -> None:
        """Count a frame of somebody else."""
        if not self.is_off:
            change = -1 if good else RECEIVE_ERROR
            self._receive = min(RECEIVE_MAX, max(0, self._receive + change))

    def leave(self) -> None:
        """Leave the bus."""
        if not self.is_off:
            self.is_off = True
            self.offs += 1

    def come_back(self) -> None:
        """Return to the bus, or begin anew after a reset of the chip."""
        self.is_off = False
        self._send = self._receive = 0
