"""Reaction of a run to a failed log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import ExitStatus
from bridge.run.ending import Ending
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.record.recorder import ThreadedRecorder


class LogFailureRule:
    """Ends the run or reports an event when the log fails."""

    def __init__(
        self,
        recorder: ThreadedRecorder,
        report: Callable[[Severity, str, EventKind, str], None],
        *,
        stop_on_error: bool,
    ) -> None:
        """``report`` receives an event: severity, source, kind and text."""
        self._recorder, self._report = recorder, report
        self._stop = stop_on_error
        self._is_reported = False

    def __call__(self) -> Ending | None:
        """Return the end of the run, or None. Called in every pass of the loop."""
        error = self._recorder.error
        if error is None or (self._is_reported and not self._stop):
            return None
        if self._stop:
            return Ending(
                "fault", f"the log failed: {error}", ExitStatus.FAILURE, StopCause.SUPERVISE
            )
        self._is_reported = True
        text = f"the log failed: {error}; the run continues without a log, as requested"
        self._report(Severity.ERROR, "recorder", EventKind.FAILED, text)
        return None
