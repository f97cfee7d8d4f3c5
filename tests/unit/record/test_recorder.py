"""The thread that writes the log: order of records, queue overflow and write errors."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING

import pytest

from bridge.record.errors import LogWriteError
from bridge.record.log_writer import RunWriter
from bridge.record.reader import LogReader
from bridge.record.recorder import ThreadedRecorder
from bridge.record.sink import NullSink
from bridge.session.records import LogRecord, Severity, TruthRecord
from support.synthetic_run import EPOCH_NS, run_info, summary, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.record.sink import Sink
    from bridge.session.records import Record


def line(i: int) -> LogRecord:
    return LogRecord(EPOCH_NS + i, Severity.INFO, "test", str(i))


class HeldWriter(RunWriter):
    """A writer that blocks until ``go`` is set, as on a slow disk."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, run_info())
        self.go = threading.Event()
        self.waiting = threading.Event()

    def write(self, record: Record) -> None:
        self.waiting.set()
        self.go.wait()
        super().write(record)


def test_everything_arrives_in_order(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = ThreadedRecorder(RunWriter(path, run_info()))
    records = list(synthetic_run())
    for record in records:
        recorder.write(record)
    recorder.close(summary())
    assert (recorder.dropped, recorder.error) == (0, None)
    reader = LogReader(path)
    assert reader.summary == summary()
    assert [m.log_ns for m in reader.messages(["/truth/pose"])] == [
        r.log_ns for r in records if isinstance(r, TruthRecord)
    ]


def test_overflow_is_counted_and_reported_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = HeldWriter(path)
    recorder = ThreadedRecorder(writer, limit=10)
    recorder.write(line(0))
    assert writer.waiting.wait(30)  # the first record has left the queue
    for i in range(1, 26):
        recorder.write(line(i))
    assert recorder.dropped == 15
    writer.go.set()
    recorder.close()
    assert recorder.dropped == 15
    reader = LogReader(path)
    assert [m.decoded.message for m in reader.messages(["/log"])] == [str(i) for i in range(11)]
    (event,) = [m.decoded for m in reader.messages(["/events"])]
    assert (event.source, event.kind, event.severity) == ("recorder", "overflow", "warning")
    assert json.loads(event.data_json) == {"dropped": 15, "dropped_total": 15}


def test_a_quiet_line_is_flushed_without_a_next_record(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    flushed = threading.Event()

    class NoticedWriter(RunWriter):
        """A writer that sets an event when a flush has put the record into the file."""

        def flush(self) -> None:
            super().flush()
            if list(LogReader(path).messages(["/log"])):
                flushed.set()

    recorder = ThreadedRecorder(NoticedWriter(path, run_info()))
    recorder.write(line(1))
    assert flushed.wait(30)
    recorder.close()


def test_a_full_disk_is_reported_and_never_raised(tmp_path: Path) -> None:
    path = tmp_path / "full"
    path.symlink_to("/dev/full")
    with pytest.raises(LogWriteError, match="No space left") as caught:
        RunWriter(path, run_info(), force=True)
    assert str(path) in str(caught.value)


class FailingWriter(RunWriter):
    """A writer that fails after five records, as on a full disk."""

    left = 5

    def write(self, record: Record) -> None:
        if self.left == 0:
            raise LogWriteError(self.path, "No space left on device")
        self.left -= 1
        super().write(record)


def test_the_first_failure_stays_and_earlier_records_are_complete(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = ThreadedRecorder(FailingWriter(path, run_info()))
    for i in range(20):
        recorder.write(line(i))
    recorder.close(summary())
    assert isinstance(recorder.error, LogWriteError)
    assert recorder.dropped == 15
    recorder.write(line(21))
    assert recorder.dropped == 16
    recorder.close()
    reader = LogReader(path)
    assert [m.decoded.message for m in reader.messages(["/log"])] == [str(i) for i in range(5)]
    assert not reader.truncated


@pytest.mark.parametrize("kind", ["null", "direct", "threaded"])
def test_all_sinks_look_alike(tmp_path: Path, kind: str) -> None:
    sink: Sink = NullSink()
    if kind != "null":
        sink = RunWriter(tmp_path / "run.mcap", run_info())
    if kind == "threaded":
        assert isinstance(sink, RunWriter)
        sink = ThreadedRecorder(sink)
    sink.write(line(1))
    sink.close(summary())
    sink.close(summary())
