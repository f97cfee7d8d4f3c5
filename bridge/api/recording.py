"""Log of a robot that a program drives; see :meth:`bridge.api.robot.Robot.record`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from bridge.session.records import RoomRecord

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import TracebackType

    from bridge.api.robot_parts import EventTap
    from bridge.record.recorder import DirectRecorder, ThreadedRecorder
    from bridge.session.records import Record, RunInfo


class Recording:
    """A log that is being written. Its ``with`` block or the robot closes it."""

    def __init__(
        self,
        path: Path,
        info: RunInfo,
        recorder: ThreadedRecorder | DirectRecorder,
        tap: EventTap,
        summarise: Callable[[str | None, str], dict[str, Any]],
    ) -> None:
        """Record from now on.

        Args:
            path: The log.
            info: Header data of the log.
            recorder: Writes the log.
            tap: Passes on the records of the session.
            summarise: Returns the summary for the name of the room and of the log.

        """
        self.path = path
        """Path of the log file."""
        self._plan = info.plan
        self._summarise = summarise
        self._tap = tap
        self._recorder = recorder
        self.closed = False
        """True if the log is closed."""
        if info.plan is not None:
            self._recorder.write(RoomRecord(info.opened_unix_ns, info.plan))
        identity = tap.newest_identity
        if identity is not None:  # the session started before the log
            self._recorder.write(identity._replace(log_ns=info.opened_unix_ns))
        tap.attach(self._recorder)

    def __repr__(self) -> str:
        """Return the path and whether it is open."""
        state = "closed" if self.closed else "open"
        return f"<Recording {self.path}: {state}, {self.dropped} records dropped>"

    @property
    def dropped(self) -> int:
        """Number of records that were not written to the file."""
        return self._recorder.dropped

    @property
    def error(self) -> Exception | None:
        """Error of the file; None if it is writable. The robot continues after an error."""
        return self._recorder.error

    def write(self, record: Record) -> None:
        """Write one more record, for example the true pose of a virtual robot."""
        if not self.closed:
            self._recorder.write(record)

    def close(self) -> None:
        """Write the queued records and the summary, and close the file. It may be called again.

        Raises:
            LogError: the log could not be completed; :attr:`dropped` counts the missing records.

        """
        if not self.closed:
            self.closed = True
            self._tap.detach(self._recorder)
            room = None if self._plan is None else self._plan.name
            self._recorder.close(self._summarise(room, str(self.path)))
            if self._recorder.error is not None:
                raise self._recorder.error

    def __enter__(self) -> Self:
        """Return the recording, which has already started."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the log. An exception of the block has priority over an exception of the log."""
        try:
            self.close()
        except Exception:
            if kind is None:
                raise
