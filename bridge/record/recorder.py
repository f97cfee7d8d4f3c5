"""Recording in a separate thread, so that a slow disk does not delay the robot."""

from __future__ import annotations

import queue
import threading
from typing import TYPE_CHECKING, Any

from bridge.record.errors import LogWriteError
from bridge.session.event_kinds import EventKind
from bridge.session.records import EventRecord, Severity

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.record.sink import LogWriter
    from bridge.session.records import Record

QUEUE_LIMIT = 50_000
"""Maximum number of queued records: 5 s of a full 3 Mbaud link, about 20 MB."""

_PERIOD_S = 0.02
"""Interval of the thread's wake-ups, s. A wake-up for each record would delay the control loop."""
_BATCH = 32
"""Number of records that are written before a pause."""
_PAUSE_S = 0.0001
"""Pause between batches, s. It releases the interpreter lock. The control loop then waits at most
0.3 ms for the lock; without pauses it may wait for the interpreter's 5 ms."""
_IDLE_S = 0.2
"""Time without records after which an open chunk is written, s."""
_CATCH_UP = QUEUE_LIMIT // 4
"""Queue length above which there are no pauses."""


class ThreadedRecorder:
    """A bounded queue before a writer. :meth:`write` never blocks and never fails.

    If the queue is full, new records are discarded and counted in ``dropped``. When the queue has
    space again, an event reports the loss. The first error of the file is stored in ``error``. All
    records after the error are counted in ``dropped`` too.
    """

    def __init__(self, writer: LogWriter, *, limit: int = QUEUE_LIMIT) -> None:
        self._writer = writer
        self._limit = limit
        self._queue: queue.SimpleQueue[Record] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._drop_lock = threading.Lock()
        self._dropped = 0
        self._reported = 0
        self._error: Exception | None = None
        self._last_ns = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Number of records that were not written to the file."""
        return self._dropped

    @property
    def error(self) -> Exception | None:
        """Error of the file; None: no error."""
        return self._error

    def write(self, record: Record) -> None:
        """Add one record to the queue. This method may be called from any thread."""
        if self._error is not None or self._closing.is_set() or self._queue.qsize() >= self._limit:
            with self._drop_lock:
                self._dropped += 1
            return
        self._queue.put(record)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Write the queued records and close the file. It may be called again.

        An error is stored in ``error``, not raised.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join()
        for finish in (self._report_dropped, lambda: self._writer.close(summary)):
            try:
                finish()
            except Exception as error:  # noqa: BLE001 - stored in `error`, as for the thread
                self._fail(error)

    def _run(self) -> None:
        idle_s = 0.0
        try:
            while not self._closing.wait(_PERIOD_S):
                if self._drain():
                    idle_s = 0.0
                    continue
                idle_s += _PERIOD_S
                if idle_s >= _IDLE_S:
                    self._writer.flush()
                    idle_s = 0.0
            self._drain()
        except Exception as error:  # noqa: BLE001 - a thread cannot raise to a caller: stored in `error`
            self._fail(error)

    def _drain(self) -> bool:
        """Write all queued records in batches; return True if there were any."""
        wrote = False
        while True:
            for _ in range(_BATCH):
                try:
                    record = self._queue.get_nowait()
                except queue.Empty:
                    if wrote:
                        self._report_dropped()
                    return wrote
                wrote = True
                self._last_ns = record.log_ns
                self._write_one(record)
            self._report_dropped()
            if self._queue.qsize() < _CATCH_UP:
                self._closing.wait(_PAUSE_S)

    def _write_one(self, record: Record) -> None:
        try:
            self._writer.write(record)
        except LogWriteError:
            with self._drop_lock:
                self._dropped += 1
            raise

    def _report_dropped(self) -> None:
        dropped = self._dropped
        if dropped == self._reported or self._error is not None:
            return
        lost, self._reported = dropped - self._reported, dropped
        text = f"{lost} records were not written, because the recorder's queue was full"
        data = {"dropped": lost, "dropped_total": dropped}
        self._writer.write(
            EventRecord(self._last_ns, Severity.WARNING, "recorder", EventKind.OVERFLOW, text, data)
        )

    def _fail(self, error: Exception) -> None:
        if self._error is None:
            self._error = error
        with self._drop_lock:
            while True:
                try:
                    self._queue.get_nowait()
                except queue.Empty:
                    return
                self._dropped += 1


class DirectRecorder:
    """Writes a run's records immediately, in the caller's thread.

    It is used in virtual time, where records arrive faster than a thread can write them.
    """

    def __init__(self, writer: LogWriter) -> None:
        self._writer = writer
        self.dropped = 0
        """Number of records that were not written to the file."""
        self.error: Exception | None = None
        """Error of the file; None: no error."""

    def write(self, record: Record) -> None:
        """Write one record. An error is stored in ``error``, not raised."""
        try:
            self._writer.write(record)
        except LogWriteError as error:  # the writer raises it again for each record
            self.error = self.error or error
            self.dropped += 1

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Close the file. An error is stored in ``error``, not raised."""
        try:
            self._writer.close(summary)
        except LogWriteError as error:
            self.error = self.error or error
