"""Whether a link is quick enough to drive over, by the round trips of a session's pings.

Sans-I/O. A robot that is driven over a slow link meets the wall before its host has seen it. Only
the round trip shows a constant delay: every sample still comes at its rate, one by one.
"""

from __future__ import annotations

from typing import NamedTuple

LIMIT_NS = 100_000_000
"""Longest round trip that allows motion, ns: 20 mm at 0.2 m/s. An adapter with a latency timer of
16 ms, and slcan, stay well below it."""
PINGS = 4
"""Pings that one judgement takes: the shortest of them counts, for one is late where a host or a
device is held up."""
TURNAROUND_NS = 40_000_000
"""Longest turnaround that is taken off, ns: firmware that waits for an ultrasonic echo in its main
loop answers after up to 38 ms (HC-SR04 without an object). The device itself claims it: without a
limit, wrong stamps would hide any delay of the link."""
SPAN_NS = 600_000_000
"""Time over which no round trip may be within the limit before it counts as exceeded, ns: from the
first to the last of four pings at 5 Hz. Pings at 10 Hz must not make a short delay count more."""
UNANSWERED_NS = 1_200_000_000
"""Time without a quick answer that counts as exceeded although fewer than four pings are answered,
ns: six pings at 5 Hz. It is longer than four pings, for single frames may be lost, and leaves 0.3 s
of the 1.5 s in which a run must stop."""
_REMEDY = (
    "use a quicker one: a cable instead of a network, a higher baud rate, an adapter whose latency "
    "timer is at 1 ms"
)


class LinkTrouble(NamedTuple):
    """Why nothing may move over a link now."""

    text: str
    """For people: what was measured, the limit, and what to do."""
    known: bool
    """The link was measured and is too slow; False: too few pings are answered so far."""


class RoundTrip:
    """Round trips of one session's pings, the device's turnaround taken off within limits."""

    def __init__(self) -> None:
        """Nothing is measured before :meth:`begin`."""
        self._last_ns: tuple[int, ...] = ()
        self._proved = False
        """A round trip was within the limit."""
        self._quick_ns = 0
        """When the newest ping was sent whose round trip was within the limit; before there is
        one, when the session began."""

    def begin(self, now_ns: int) -> None:
        """Measure anew: a session is ready."""
        self._last_ns = ()
        self._proved = False
        self._quick_ns = now_ns

    def answered(self, sent_ns: int, arrived_ns: int, turnaround_us: int) -> None:
        """Take an answered ping; ``turnaround_us`` is by the device's stamps of both frames."""
        elapsed_ns = arrived_ns - sent_ns
        turnaround_ns = turnaround_us * 1000
        if turnaround_ns > elapsed_ns:  # it cannot have taken so long: its clock has jumped
            turnaround_ns = 0
        round_trip_ns = elapsed_ns - min(turnaround_ns, TURNAROUND_NS)
        self._last_ns = (*self._last_ns[-(PINGS - 1) :], round_trip_ns)
        if round_trip_ns <= LIMIT_NS:
            self._proved = True
            self._quick_ns = max(self._quick_ns, sent_ns)

    @property
    def min_ns(self) -> int | None:
        """Shortest round trip of the last four pings; None while fewer are answered."""
        last_ns = self._last_ns
        return min(last_ns) if len(last_ns) == PINGS else None

    def trouble(self, now_ns: int) -> LinkTrouble | None:
        """Why nothing may move now; None where the link is quick enough."""
        last_ns, since_ns = self._last_ns, now_ns - self._quick_ns
        if len(last_ns) == PINGS and min(last_ns) <= LIMIT_NS and since_ns <= UNANSWERED_NS:
            return None  # nearly always
        slow = len(last_ns) == PINGS and not (self._proved and since_ns <= SPAN_NS)
        if slow or since_ns > UNANSWERED_NS:
            return LinkTrouble(self._exceeded(), known=True)
        if len(last_ns) == PINGS:
            return None
        text = (
            f"the round trip of the link is not known: {len(last_ns)} of {PINGS} pings are "
            "answered; check the cable and the baud rate"
        )
        return LinkTrouble(text, known=False)

    def _exceeded(self) -> str:
        limit = f"limit {LIMIT_NS / 1e6:.0f} ms"
        slow_ns = [last_ns for last_ns in self._last_ns if last_ns > LIMIT_NS]
        if slow_ns:
            measured = f"its round trip is {min(slow_ns) / 1e6:.0f} ms ({limit})"
        else:
            measured = f"no ping was answered for {UNANSWERED_NS / 1e9:g} s ({limit})"
        return f"the link is too slow to drive over: {measured}; {_REMEDY}"
