"""Check of the round-trip time before motion is allowed.

Sans-I/O. On a slow link the robot may reach an obstacle before the host receives its range. Samples
still arrive at their normal rate, so only the round-trip time shows a constant delay.
"""

from __future__ import annotations

from typing import NamedTuple

LIMIT_NS = 100_000_000
"""Maximum round-trip time for motion, ns. In this time the robot drives 20 mm at 0.2 m/s. A USB
adapter with a latency timer of 16 ms and a CAN adapter with slcan are well below this limit."""
PINGS = 4
"""Number of pings per decision. Their minimum counts, because a busy host or device delays some
pings."""
TURNAROUND_NS = 40_000_000
"""Maximum turnaround time of the device that is subtracted from a round trip, ns. Firmware that
waits for an ultrasonic echo in its main loop replies after up to 38 ms (HC-SR04 without an object).
The device reports its turnaround time itself. The limit prevents wrong stamps from hiding a delay
of the link."""
SPAN_NS = 600_000_000
"""Minimum time above the limit before the link counts as slow, ns. It is the time from the first to
the last of four pings at 5 Hz. Without it, the first pings at 10 Hz would detect shorter delays
than later pings."""
UNANSWERED_NS = 1_200_000_000
"""Maximum time without a round trip within the limit, ns. It is six pings at 5 Hz and not four,
because frames may be lost. A run must stop within 1.5 s, so 0.3 s remain."""
_REMEDY = (
    "use a cable instead of a network, a higher baud rate, or an adapter with a latency timer of "
    "1 ms"
)


class LinkTrouble(NamedTuple):
    """Reason why the link does not allow motion."""

    text: str
    """Measured value, limit and remedy, for people."""
    known: bool
    """True if the link is measured and too slow. False if not enough pings are answered yet."""


class RoundTrip:
    """Round-trip times of a session's pings, minus the device's turnaround time."""

    def __init__(self) -> None:
        """Create an empty record; :meth:`begin` starts it."""
        self._last_ns: tuple[int, ...] = ()
        self._proved = False
        """True after a round trip within the limit."""
        self._quick_ns = 0
        """Transmission time of the newest ping whose round trip was within the limit; initially the
        start of the session."""

    def begin(self, now_ns: int) -> None:
        """Restart the measurement for a session that became ready."""
        self._last_ns = ()
        self._proved = False
        self._quick_ns = now_ns

    def answered(self, sent_ns: int, arrived_ns: int, turnaround_us: int) -> None:
        """Add an answered ping. ``turnaround_us`` is from the device's stamps."""
        elapsed_ns = arrived_ns - sent_ns
        turnaround_ns = turnaround_us * 1000
        if not 0 <= turnaround_ns <= elapsed_ns:  # impossible: the device's clock has jumped
            turnaround_ns = 0
        round_trip_ns = elapsed_ns - min(turnaround_ns, TURNAROUND_NS)
        self._last_ns = (*self._last_ns[-(PINGS - 1) :], round_trip_ns)
        if round_trip_ns <= LIMIT_NS:
            self._proved = True
            self._quick_ns = max(self._quick_ns, sent_ns)

    @property
    def min_ns(self) -> int | None:
        """Minimum round-trip time of the last four pings, ns; None before four are answered."""
        last_ns = self._last_ns
        return min(last_ns) if len(last_ns) == PINGS else None

    def trouble(self, now_ns: int) -> LinkTrouble | None:
        """Return the reason against motion; None if the link is fast enough."""
        last_ns, since_ns = self._last_ns, now_ns - self._quick_ns
        if len(last_ns) == PINGS and min(last_ns) <= LIMIT_NS and since_ns <= UNANSWERED_NS:
            return None  # the usual case
        slow = len(last_ns) == PINGS and not (self._proved and since_ns <= SPAN_NS)
        if slow or since_ns > UNANSWERED_NS:
            return LinkTrouble(self._exceeded(), known=True)
        if len(last_ns) == PINGS:
            return None
        text = (
            f"the round-trip time of the link is unknown: {len(last_ns)} of {PINGS} pings are "
            "answered; check the cable and the baud rate"
        )
        return LinkTrouble(text, known=False)

    def _exceeded(self) -> str:
        limit = f"limit {LIMIT_NS / 1e6:.0f} ms"
        slow_ns = [last_ns for last_ns in self._last_ns if last_ns > LIMIT_NS]
        if slow_ns:
            measured = f"the round-trip time is {min(slow_ns) / 1e6:.0f} ms ({limit})"
        else:
            measured = f"no ping was answered for {UNANSWERED_NS / 1e9:g} s ({limit})"
        return f"the link is too slow for motion: {measured}; {_REMEDY}"
