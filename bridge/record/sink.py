"""Where records go: the file itself, the thread in front of it, or nowhere."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Record


class Sink(Protocol):
    """Takes what a run tells, in the order it happens."""

    def write(self, record: Record) -> None:
        """Record one thing."""

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """End the recording, with the run's summary where it came to one."""


class LogWriter(Sink, Protocol):
    """A log's file, or several: not for more than one thread at once."""

    def flush(self) -> None:
        """Hand everything so far to the operating system."""


class NullSink:
    """Records nothing, for runs that need no log."""

    def write(self, record: Record) -> None:
        """Forget the record."""

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Forget the summary."""
