"""Receivers of records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Record


class Sink(Protocol):
    """Receives a run's records in order."""

    def write(self, record: Record) -> None:
        """Handle one record."""

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """End the recording, with the run's summary if there is one."""


class LogWriter(Sink, Protocol):
    """Writer of a log. Not thread-safe."""

    def flush(self) -> None:
        """Write the open chunk."""


class NullSink:
    """Sink that discards all records. It is also the writer of a run without a log."""

    def write(self, record: Record) -> None:
        """Discard the record."""

    def flush(self) -> None:
        """Do nothing."""

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Discard the summary."""
