"""Extension of 16-bit time stamps to 32 bits.

A 16-bit stamp repeats every 1.05 s. It is extended with the high bits of an earlier full stamp of
the same sender. The result is rejected if it is not plausible by our own clock.
"""

from __future__ import annotations

from protocol.can.frames import STAMP_SHIFT
from protocol.clock import elapsed_us

OLDEST_US = 500_000
"""Maximum age of a short (16-bit) stamp, µs: a little less than half of its range of 1.05 s."""
LEAD_US = 50_000
"""Maximum lead of a stamp over the fastest earlier frame, µs. A lead is possible because that frame
also had a delay."""
STEP_US = 2_000_000
"""Maximum jump of a full stamp, µs. A larger jump means that the clock has changed: the sender has
booted, or another sender has replaced it."""
DRIFT_PPM = 500
"""Maximum drift between the two clocks, ppm; two crystals drift less. The estimate from the fastest
frame is relaxed at this rate."""
_SPAN16, _HALF16 = 1 << 16, 1 << 15


class StampExtender:
    """The stamps of one sender."""

    def __init__(self) -> None:
        self._wire_us: int | None = None
        """Reference for the next stamp: the newest stamp received, with wraps undone, µs."""
        self._ahead_us = 0
        """Sender's clock minus ours, µs, estimated from the frame with the least delay."""
        self._at_us = 0
        """Time of the estimate ``_ahead_us``, µs."""
        self.newest: tuple[int, int] | None = None
        """Last full stamp as received, and its arrival time."""

    def restart(self) -> None:
        """Start again from the newest full stamp, because the sender has changed."""
        if self.newest is not None:
            self._begin(*self.newest)

    def whole(self, t_us: int, now_us: int) -> int:
        """Process a 32-bit stamp; return it with wraps undone."""
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
        """Extend a 16-bit stamp; return None if it is too old or no full stamp came before it."""
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
        """Return the sender's present time, or our own time if no stamp has arrived yet."""
        return now_us + self._ahead_us
