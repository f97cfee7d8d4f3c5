"""Link statistics: rate, loss, order and age of each message, and the round-trip time.

Received events are queued and counted once per second, so that counting does not delay control.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from bridge.session.states import Data
from protocol.clock import elapsed_us
from protocol.schema.message import RateClass

if TYPE_CHECKING:
    from bridge.session.states import SessionEvent
    from bridge.session.timesync import Fit, TimeSync
    from protocol.link import LinkStatistics
    from protocol.schema.message import MessageSpec

_ALIKE = 0.1
"""Maximum relative difference of two gaps that count as the same period."""
_QUICKER = 2
"""Number of consecutive equal gaps that set a shorter period."""
_SLOWER = 5
"""Number of consecutive equal gaps that set a longer period. It is larger, because two losses may
have equal length."""
_BREAK_US = 10_000_000
"""Longest gap that counts as loss, µs. A longer gap is a break in the session."""
_STEPS = 8
"""Number of histogram bins per factor of two. A percentile is accurate to 9 %."""
_BINS = 30 * _STEPS
"""Number of histogram bins. They cover 1 µs to 15 min."""


class Spread:
    """Histogram of a duration, ns, in constant memory."""

    def __init__(self) -> None:
        self.count = 0
        self.min_ns = 0
        self.max_ns = 0
        self._bins = [0] * _BINS

    def add(self, value_ns: float) -> None:
        """Add one duration, ns."""
        if not self.count or value_ns < self.min_ns:
            self.min_ns = round(value_ns)
        self.max_ns = max(self.max_ns, round(value_ns))
        self.count += 1
        place = int(_STEPS * math.log2(value_ns / 1000.0)) + 1 if value_ns > 1000.0 else 0  # noqa: PLR2004 - 1 µs
        self._bins[min(place, _BINS - 1)] += 1

    def percentile_ns(self, percent: float) -> int:
        """Return a percentile, ns."""
        wanted, seen = math.ceil(self.count * percent / 100.0), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= wanted:
                edge_ns = math.ceil(1000.0 * 2 ** (place / _STEPS))
                return max(self.min_ns, min(self.max_ns, edge_ns))
        return self.max_ns

    def to_dict(self) -> dict[str, float | int | None]:
        """Return the quantiles in milliseconds; None if nothing was counted."""
        known = self.count > 0
        return {
            "count": self.count,
            "min": _ms(self.min_ns) if known else None,
            "p50": _ms(self.percentile_ns(50.0)) if known else None,
            "p99": _ms(self.percentile_ns(99.0)) if known else None,
            "max": _ms(self.max_ns) if known else None,
        }


def _ms(value_ns: float) -> float:
    return round(value_ns / 1e6, 3)


class MessageStatistics:
    """Statistics of one message type, from the device's stamps."""

    __slots__ = (
        "_age_count", "_age_most_ns", "_age_sum_ns", "_alike", "_candidate_us",
        "_last_us", "_period_us", "_spent_us", "_stream", "count", "lost", "name", "reordered",
    )  # fmt: skip

    def __init__(self, spec: MessageSpec) -> None:
        self.name = spec.name
        self.count = self.lost = self.reordered = 0
        self._stream = spec.rate is RateClass.STREAM
        self._last_us = 0
        self._spent_us = 0
        """Total time over which messages were received, without breaks, µs."""
        self._period_us = self._candidate_us = 0.0
        self._alike = 0
        self._age_count = 0
        self._age_sum_ns = self._age_most_ns = 0.0

    def take(self, t_us: int, arrived_ns: int, fit: Fit | None) -> None:
        """Add one message with its 32-bit stamp."""
        if self.count:
            gap_us = elapsed_us(self._last_us, t_us)
            if gap_us < 0:
                self.reordered += 1
                self.count += 1
                return
            if gap_us < _BREAK_US:
                self._spent_us += gap_us
                if self._stream:
                    self._gap(gap_us)
        self.count += 1
        self._last_us = t_us
        if fit is not None:
            since_us = elapsed_us(fit.device_us, t_us)
            age_ns = arrived_ns - fit.host_ns - since_us * 1000.0 * (1.0 + fit.drift)
            self._age_count += 1
            self._age_sum_ns += age_ns
            self._age_most_ns = max(self._age_most_ns, age_ns)

    def _gap(self, gap_us: int) -> None:
        """Classify the time since the last message: same period, new period or loss."""
        period_us = self._period_us
        if abs(gap_us - period_us) <= _ALIKE * period_us:
            self._alike = 0
            return
        alike = abs(gap_us - self._candidate_us) <= _ALIKE * gap_us
        self._alike = self._alike + 1 if alike else 1
        missing = max(0, round(gap_us / period_us) - 1) if period_us else 0
        self.lost += missing
        self._candidate_us = float(gap_us)
        if self._alike >= (_SLOWER if missing else _QUICKER) and gap_us > 0:
            # So many equal gaps are not chance: the rate has changed, or the first period was
            # wrong.
            self.lost -= missing * self._alike
            self._period_us, self._alike = float(gap_us), 0

    def to_dict(self) -> dict[str, Any]:
        """Return the entry for the summary; ages in ms, None without a clock mapping."""
        spent_s, counted = self._spent_us / 1e6, self._age_count
        return {
            "count": self.count,
            "rate_hz": round((self.count - 1) / spent_s, 2) if spent_s and self._stream else None,
            "lost": self.lost if self._stream else None,
            "reordered": self.reordered,
            "age_ms": {
                "mean": _ms(self._age_sum_ns / counted) if counted else None,
                "max": _ms(self._age_most_ns) if counted else None,
            },
        }


class WireStatistics:
    """Statistics of a host's link: every message type and the round-trip time."""

    def __init__(self) -> None:
        self.round_trip = Spread()
        self._aside: list[tuple[list[SessionEvent], int]] = []
        self._kinds: dict[int, MessageStatistics] = {}
        self.queue = self._aside.append
        """Queue received events with their arrival time: ``queue((events, now_ns))``."""

    def count(self, sync: TimeSync) -> None:
        """Count the queued events."""
        fit, kinds = sync.fit, self._kinds
        for events, now_ns in self._aside:
            for event in events:
                if event.__class__ is Data:
                    _, frame, spec = event[0]
                    kind = kinds.get(frame[2])
                    if kind is None:
                        kind = kinds[frame[2]] = MessageStatistics(spec)
                    kind.take(frame[4], now_ns, fit)
        self._aside.clear()

    def to_dict(self) -> dict[str, Any]:
        """Return the round-trip time (ms) and the messages by name."""
        return {
            "round_trip_ms": self.round_trip.to_dict(),
            "messages": {kind.name: kind.to_dict() for kind in self._kinds.values()},
        }


def wire_summary(statistics: LinkStatistics) -> dict[str, Any]:
    """Return the host's counts of frames and bytes per direction, losses and CRC errors."""
    return {
        "frames": {"rx": statistics.frames_in, "tx": statistics.frames_out},
        "lost": statistics.lost,
        "crc_errors": statistics.damaged,
        "bytes": {"rx": statistics.bytes_in, "tx": statistics.bytes_out},
        "reordered": statistics.reordered,
        "rejected": statistics.rejected,
        "superseded": statistics.superseded,
    }
