"""Use of ping replies: clock synchronisation, round-trip time and check of declared delays."""

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
    """Records an event."""

    def __call__(
        self, now_ns: HostNs, severity: Severity, source: str, kind: EventKind, text: str, /
    ) -> None:
        """Record an event: time, severity, source, kind and text."""


class Pings:
    """Handles each answered time request."""

    def __init__(self, wire: WireStatistics, declared_ns: int, log_event: EventLogger) -> None:
        """``declared_ns`` is the declared minimum delay of both directions together, ns."""
        self._wire, self._log_event = wire, log_event
        self._declared_ns = declared_ns
        """Declared delay in use, ns; 0 after a shorter round trip."""

    def take(self, ping: Ping, ingest: Ingest, now_ns: HostNs) -> None:
        """Update the clock fit, the round-trip statistics and the check of the declared delay."""
        if not ingest.exchange(ping):
            self._log_event(
                now_ns, Severity.WARNING, "clock", EventKind.STEP, "the device's clock jumped"
            )
        round_trip_ns = ingest.sync.round_trip_ns
        self._wire.round_trip.add(round_trip_ns)
        if round_trip_ns + 2 * STAMP_NS < self._declared_ns:
            text = (
                f"a round trip took {round_trip_ns / 1e6:.3f} ms, but the declared delays sum to "
                f"{self._declared_ns / 1e6:.3f} ms, so the error bounds of time stamps are wrong; "
                "reduce --adapter-delay"
            )
            self._log_event(now_ns, Severity.WARNING, "clock", EventKind.DECLARED, text)
            self._declared_ns = 0
