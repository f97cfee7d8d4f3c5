"""What round trips tell: of the clock, of the line, and of a delay that was declared."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from bridge.session.timesync import STAMP_NS

if TYPE_CHECKING:
    from bridge.session.ingest import Ingest
    from bridge.session.link_stats import WireStatistics
    from bridge.session.states import Ping
    from protocol.clock import HostNs


class EventLogger(Protocol):
    """Puts an event on record."""

    def __call__(
        self, now_ns: HostNs, severity: Severity, source: str, kind: EventKind, text: str, /
    ) -> None:
        """When, how grave, of what, and in words."""


class Pings:
    """Takes each answered time request."""

    def __init__(self, wire: WireStatistics, declared_ns: int, log_event: EventLogger) -> None:
        """``declared_ns``: least delay of both ways together, as a person has told it."""
        self._wire, self._log_event = wire, log_event
        self._declared_ns = declared_ns
        """0 once it was found not to be true."""

    def take(self, ping: Ping, ingest: Ingest, now_ns: HostNs) -> None:
        """Fit the clock, count the round trip, and hold the declaration against it."""
        if not ingest.exchange(ping):
            self._log_event(
                now_ns, Severity.WARNING, "clock", EventKind.STEP, "the device's clock has jumped"
            )
        round_trip_ns = ingest.sync.round_trip_ns
        self._wire.round_trip.add(round_trip_ns)
        if round_trip_ns + 2 * STAMP_NS < self._declared_ns:
            text = (
                f"a round trip took {round_trip_ns / 1e6:.3f} ms, and the delays that "
                f"were declared come to {self._declared_ns / 1e6:.3f} ms: the bounds on time "
                "stamps are not true; declare less (--adapter-delay)"
            )
            self._log_event(now_ns, Severity.WARNING, "clock", EventKind.DECLARED, text)
            self._declared_ns = 0
