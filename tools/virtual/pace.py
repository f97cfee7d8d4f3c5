"""A run in virtual time at a limited speed, so that people can watch it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.io import clock

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.record.sink import Sink
    from bridge.session.records import Record

_AHEAD_NS = 20_000_000
"""Maximum time by which a record may be early at the requested speed, ns of real time."""


class PacedSink:
    """Sink that waits when the records' log times are ahead of the requested speed."""

    def __init__(
        self,
        sink: Sink,
        speed: float,
        now: Callable[[], int] = clock.now,
        pause: Callable[[float], None] = clock.pause,
    ) -> None:
        """Pass records on at ``speed`` simulated seconds for each second."""
        self._sink = sink
        self._speed = speed
        self._now, self._pause = now, pause
        self._first_ns: int | None = None
        self._begun_ns = 0

    def write(self, record: Record) -> None:
        """Wait if it is too early for the record, then pass the record on."""
        log_ns = record[0]
        if self._first_ns is None:
            self._first_ns, self._begun_ns = log_ns, self._now()
        ahead_ns = (log_ns - self._first_ns) / self._speed - (self._now() - self._begun_ns)
        if ahead_ns > _AHEAD_NS:
            self._pause(ahead_ns / 1e9)
        self._sink.write(record)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Close the sink with the run's summary."""
        self._sink.close(summary)
