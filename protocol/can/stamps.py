"""Short stamps made whole, or refused.

A short stamp repeats every 1.05 s. What it means is known from the whole stamps of the same
sender that came before it on the wire; whether that can be true, from our own clock.
"""

from __future__ import annotations

from protocol.can.frames import STAMP_SHIFT
from protocol.clock import elapsed_us

OLDEST_US = 500_000
"""Of a short stamp: a little less than half of what it counts to."""
LEAD_US = 50_000
"""How far a stamp may lie ahead of the quickest frame before it: that one was late itself."""
STEP_US = 2_000_000
"""A whole stamp further off is of another clock: the sender has booted, or is another."""
DRIFT_PPM = 500
"""More than two crystals differ: by so much the quickest frame loses its weight."""
_SPAN16, _HALF16 = 1 << 16, 1 << 15


class StampExtender:
    """The stamps of one sender."""

    def __init__(self) -> None:
        self._wire_us: int | None = None
        """Newest stamp seen, in the order of the wire, wraps undone."""
        self._ahead_us = 0
        """Sender's clock less ours, by the frame that took the shortest way."""
        self._at_us = 0
        """When that was judged."""
        self.newest: tuple[int, int] | None = None
        """The last whole stamp as it came, and when."""

    def restart(self) -> None:
        """Begin anew with the newest whole stamp: the sender is another than before it."""
        if self.newest is not None:
            self._begin(*self.newest)

    def whole(self, t_us: int, now_us: int) -> int:
        """Take a 32-bit stamp; give it with wraps undone."""
        before = self._wire_us
        self.newest = t_us, now_us
        if before is None:
            self._begin(t_us, now_us)
            return t_us
        stamp = before + elapsed_us(before, t_us)
        offset = stamp - now_us
        aged = self._ahead_us - (now_us - self._at_us) * DRIFT_PPM // 1_000_000
        if abs(offset - self._ahead_us) > STEP_US:
            self._begin(t_us, now_us)
            return t_us
        self._wire_us = stamp
        self._ahead_us, self._at_us = max(offset, aged), now_us
        return stamp

    def _begin(self, t_us: int, now_us: int) -> None:
        self._wire_us, self._ahead_us, self._at_us = t_us, t_us - now_us, now_us

    def short(self, t16: int, now_us: int) -> int | None:
        """Take a 16-bit stamp; None where it is too old, or nothing tells what it means."""
        before = self._wire_us
        if before is None:
            return None
        steps = (t16 - (before >> STAMP_SHIFT) + _HALF16) % _SPAN16 - _HALF16
        stamp = (before >> STAMP_SHIFT) + steps << STAMP_SHIFT
        age_us = now_us + self._ahead_us - stamp
        if not -LEAD_US <= age_us <= OLDEST_US:
            return None
        self._wire_us = max(before, stamp)
        return stamp

    def sender_us(self, now_us: int) -> int:
        """What the sender's clock shows about now; ours, as long as it has not told."""
        return now_us + self._ahead_us
