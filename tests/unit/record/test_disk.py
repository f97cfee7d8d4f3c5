"""Logs on a full disk, logs after a loss of power, and logs in several files."""

from __future__ import annotations

import errno
import io
import itertools
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

from bridge.convert.export import export
from bridge.errors import OutputExistsError
from bridge.record.chunk import CHUNK_NS
from bridge.record.errors import LogGoneError, LogWriteError
from bridge.record.log_writer import RunWriter
from bridge.record.policy import RecordOptions, open_log
from bridge.record.reader import LogReader
from bridge.record.recorder import ThreadedRecorder
from bridge.record.rotation import RotatingWriter
from bridge.record.storage import RESERVE_BYTES, LogFile, hold_room, open_log_file
from bridge.run.log_failure import LogFailureRule
from bridge.session.records import IdentityRecord, LogRecord, Severity
from bridge.view.following import Follower
from support.synthetic_run import EPOCH_NS, first_records, run_info, summary, synthetic_run

if TYPE_CHECKING:
    from collections.abc import Iterable

    from _typeshed import ReadableBuffer

    from bridge.session.records import Record

IDENTITY = IdentityRecord(EPOCH_NS, 1, b"\1" * 12, 7, 8, "power", "test 1.0", 9)


class Disk:
    """A disk of limited size for a log and its reserve file."""

    def __init__(self, size: int) -> None:
        self.size, self.used = size, 0

    def take(self, count: int) -> None:
        if self.used + count > self.size:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.used += count

    def ballast(self, _folder: Path) -> io.BytesIO:
        return Held(self)

    def open(self, path: Path, *, force: bool) -> LogFile:
        return OnDisk(self, path, "wb" if force else "xb")


class Held(io.BytesIO):
    def __init__(self, disk: Disk) -> None:
        super().__init__()
        self.disk = disk

    def write(self, data: ReadableBuffer, /) -> int:
        self.disk.take(len(bytes(data)))
        return super().write(data)

    def close(self) -> None:
        if not self.closed:
            self.disk.used -= len(self.getvalue())
        super().close()


class OnDisk(LogFile):
    def __init__(self, disk: Disk, path: Path, mode: str) -> None:
        self.disk = disk
        super().__init__(path, mode, sync=self.account, ballast=disk.ballast)
        self.counted = 0

    def account(self, _number: int) -> None:
        """Check after every write that the file's growth fits."""
        size = Path(str(self.name)).stat().st_size
        self.disk.take(size - self.counted)
        self.counted = size

    def truncate(self, size: int | None = None, /) -> int:
        made = super().truncate(size)
        self.disk.used += made - self.counted
        self.counted = made
        return made


@pytest.mark.parametrize("size", [300_000, 420_000, 555_555])
def test_a_full_disk_is_reported_and_the_log_is_closed_whole(tmp_path: Path, size: int) -> None:
    path, disk = tmp_path / "run.mcap", Disk(size)
    writer = RunWriter(path, run_info(), opener=disk.open)
    written, failed = 0, None
    for record in synthetic_run():
        try:
            writer.write(record)
        except LogWriteError as error:
            failed = str(error)
            break
        written += 1
    assert failed == f"cannot write {path}: No space left on device"
    writer.close(summary())
    assert disk.used <= size, "the end of the log used the reserve"
    reader = LogReader(path)
    messages = list(reader.messages())
    assert (reader.truncated, reader.problems) == (False, [])
    with path.open("rb") as file:
        whole = make_reader(file, validate_crcs=True)
        assert len(list(whole.iter_messages())) == len(messages)
    last_ns = max(message.log_ns for message in messages)
    assert last_ns > EPOCH_NS
    at = next(r for i, r in enumerate(synthetic_run()) if i == written)
    assert at.log_ns - last_ns <= 2 * CHUNK_NS, "at most one chunk is lost"


@pytest.mark.parametrize("size", [RESERVE_BYTES // 2, RESERVE_BYTES + 500, RESERVE_BYTES + 66_000])
def test_no_room_for_so_much_as_the_end_or_the_head(tmp_path: Path, size: int) -> None:
    disk = Disk(size)
    with pytest.raises((OSError, LogWriteError), match="No space"):
        RunWriter(tmp_path / "run.mcap", run_info(), opener=disk.open)
    assert list(tmp_path.iterdir()) == [], "no empty file is left"


def test_a_disk_that_is_full_in_truth() -> None:
    """/dev/full is a device that is always full."""
    with pytest.raises(LogWriteError, match="cannot write /dev/full: No space left on device"):
        RunWriter(Path("/dev/full"), run_info(), force=True)


def test_the_reserve_file_has_no_name_and_ends_with_the_log(tmp_path: Path) -> None:
    file = open_log_file(tmp_path / "log", force=False)
    assert [p.name for p in tmp_path.iterdir()] == ["log"]
    file.close()
    with pytest.raises(OutputExistsError):
        open_log_file(tmp_path / "log", force=False)
    held = hold_room(tmp_path)
    assert held is not None
    held.close()


def test_stop_or_continue_when_the_log_fails(tmp_path: Path) -> None:
    reported: list[tuple[Severity, str, str, str]] = []
    for stop in (True, False):
        disk = Disk(300_000)
        recorder = ThreadedRecorder(
            RunWriter(tmp_path / f"{stop}.mcap", run_info(), opener=disk.open)
        )
        rule = LogFailureRule(recorder, lambda *words: reported.append(words), stop_on_error=stop)
        assert rule() is None
        for record in synthetic_run():
            recorder.write(record)
        recorder.close(summary())
        assert recorder.error is not None
        assert recorder.dropped > 0
        ending = rule()
        if stop:
            assert ending is not None
            assert (ending.outcome, ending.exit_status) == ("fault", 1)
            assert "No space left" in ending.reason
        else:
            assert ending is None
            assert rule() is None, "the failure is reported once"
        assert LogReader(tmp_path / f"{stop}.mcap").truncated is False
    ((severity, source, kind, text),) = reported
    assert (severity, source, kind) == (Severity.ERROR, "recorder", "failed")
    assert "the run continues without a log" in text


class Volatile:
    """A disk that keeps only the data up to the last sync, as after a loss of power."""

    def __init__(self) -> None:
        self.durable: list[bytes] = []
        self.path: Path | None = None

    def sync(self, _number: int) -> None:
        assert self.path is not None
        self.durable.append(self.path.read_bytes())

    def open(self, path: Path, *, force: bool) -> LogFile:  # noqa: ARG002 - an opener's interface
        self.path = path
        return LogFile(path, "wb", sync=self.sync)


def test_a_loss_of_power_takes_half_a_second_at_most(tmp_path: Path) -> None:
    disk, path = Volatile(), tmp_path / "run.mcap"
    writer = RunWriter(path, run_info(), opener=disk.open)
    checked = 0
    for i, record in enumerate(first_records(4.0)):
        writer.write(record)
        if i % 250 != 249:
            continue
        left = tmp_path / "left.mcap"
        left.write_bytes(disk.durable[-1])
        reader = LogReader(left)
        times = [message.log_ns for message in reader.messages({"/raw/uart/rx"})]
        assert reader.problems == []
        assert "robot.toml" in reader.attachments
        if times:
            assert record.log_ns - times[-1] <= 2 * CHUNK_NS
            checked += 1
    assert checked > 5
    writer.close(summary())
    assert disk.durable[-1] == path.read_bytes()


def test_fsync_reaches_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr("os.fdatasync", synced.append)
    monkeypatch.setattr("os.fsync", synced.append)
    writer = open_log(tmp_path / "run.mcap", run_info(), RecordOptions(fsync=True))
    for record in first_records(1.0):
        writer.write(record)
    writer.close()
    assert len(synced) >= 5
    before = len(synced)
    plain = open_log(tmp_path / "plain.mcap", run_info(), RecordOptions())
    plain.close()
    assert len(synced) == before


# ---- several files --------------------------------------------------------------------


def parts_of(path: Path) -> list[Path]:
    return sorted(path.parent.glob(f"{path.stem}*.mcap"), key=lambda p: (len(p.name), p.name))


@pytest.mark.parametrize(
    "options",
    [RecordOptions(rotate_s=1.5), RecordOptions(rotate_bytes=100_000)],
    ids=["by time", "by size"],
)
def test_a_run_in_several_files(tmp_path: Path, options: RecordOptions) -> None:
    path, single = tmp_path / "run.mcap", tmp_path / "whole" / "one.mcap"
    single.parent.mkdir()
    writers = open_log(path, run_info(), options), open_log(single, run_info(), RecordOptions())
    for writer in writers:
        writer.write(IDENTITY)
        for record in first_records(6.0):
            writer.write(record)
        writer.close(summary())
    parts = parts_of(path)
    assert len(parts) >= 3
    assert [p.name for p in parts[:2]] == ["run.mcap", "run-0002.mcap"]
    topics = {"/device/imu", "/pose", "/raw/uart/rx", "/cmd", "/log"}
    joined = [
        (m.topic, m.log_ns, m.data)
        for p in parts
        for m in LogReader(p, alone=True).messages(topics)
    ]
    whole = [(m.topic, m.log_ns, m.data) for m in LogReader(single).messages(topics)]
    assert sorted(joined) == sorted(whole), "no record is lost or duplicated"
    begun = [min(m.log_ns for m in LogReader(p, alone=True).messages()) for p in parts]
    ended = [max(m.log_ns for m in LogReader(p, alone=True).messages()) for p in parts]
    assert all(after >= before for before, after in pairwise(ended)), (
        "the files end in the order of their numbers"
    )
    assert all(b >= e for e, b in zip(ended, begun[1:], strict=False)), (
        "no file begins before the previous file ends"
    )
    run_of_all = LogReader(path)  # the first file represents all
    assert run_of_all.parts == parts
    again = [(m.topic, m.log_ns, m.data) for m in run_of_all.messages(topics)]
    assert sorted(again) == sorted(whole)
    assert run_of_all.summary == LogReader(single).summary
    exported = export(path, tmp_path / "tables", topics=sorted(topics))
    assert exported.problems == []
    assert exported.rows == Counter(topic for topic, _, _ in whole)
    for number, part in enumerate(parts, 1):
        reader = LogReader(part, alone=True)
        assert not reader.truncated
        assert {"robot.toml", "room.json", "catalogue.json"} <= set(reader.attachments)
        assert reader.run["part"] == str(number)
        assert reader.metadata["device"]["firmware"] == "test 1.0"
        last = number == len(parts)
        assert (reader.summary is not None) == last
        assert sum(1 for _ in reader.messages({"/map/room"})) == 1
        with part.open("rb") as file:
            made = make_reader(file, validate_crcs=True)
            found = made.get_summary()
            assert found is not None
            assert {"foxglove.PoseInFrame", "sweepctl.Imu"} <= {
                s.name for s in found.schemas.values()
            }
        events = [m.decoded.text for m in reader.messages({"/events"})]
        assert any("continues in" in text for text in events) == (not last)
        assert any("continues from" in text for text in events) == (number > 1)
        if options.rotate_bytes and not last:
            assert part.stat().st_size < 1.6 * options.rotate_bytes


def test_a_later_file_that_exists_is_reported_at_once(tmp_path: Path) -> None:
    (tmp_path / "run-0002.mcap").write_bytes(b"mine")
    with pytest.raises(OutputExistsError, match=r"run-0002\.mcap"):
        open_log(tmp_path / "run.mcap", run_info(), RecordOptions(rotate_s=1.0))
    assert not (tmp_path / "run.mcap").exists()
    (tmp_path / "run-0002.mcap").rename(tmp_path / "run-0007.mcap")  # a much higher number
    with pytest.raises(OutputExistsError, match=r"run-0007\.mcap"):
        open_log(tmp_path / "run.mcap", run_info(), RecordOptions(rotate_s=1.0))
    (tmp_path / "run-0007.mcap").rename(tmp_path / "run-7.mcap")  # not a name of a part
    open_log(tmp_path / "run.mcap", run_info(), RecordOptions(rotate_s=1.0)).close()
    writer = open_log(tmp_path / "run.mcap", run_info(), RecordOptions(rotate_s=1.0), force=True)
    assert isinstance(writer, RotatingWriter)
    writer.close()


def test_files_of_other_runs_beside_the_first_file(tmp_path: Path) -> None:
    """Later parts of an earlier, longer run are ignored, and so is an empty part."""
    path = tmp_path / "run.mcap"
    for seconds, opened_ns in ((40, EPOCH_NS), (20, EPOCH_NS + 1)):
        info = replace(run_info(), opened_unix_ns=opened_ns)
        writer = open_log(path, info, RecordOptions(rotate_s=1.0), force=True)
        for i in range(seconds):
            writer.write(
                LogRecord(EPOCH_NS + i * 100_000_000, Severity.INFO, "test", f"{seconds} {i}")
            )
        writer.close(summary())
    assert (tmp_path / "run-0004.mcap").exists()
    reader = LogReader(path)
    assert [part.name for part in reader.parts] == ["run.mcap", "run-0002.mcap"]
    assert [m.decoded.message for m in reader.messages({"/log"})] == [f"20 {i}" for i in range(20)]
    follower = Follower(path, {"/log"})
    followed = [m.decoded.message for m in follower.more()]
    while follower.ended and follower.next_file():
        followed += [m.decoded.message for m in follower.more()]
    assert followed == [f"20 {i}" for i in range(20)]
    (tmp_path / "run-0002.mcap").write_bytes(b"")
    assert LogReader(path).parts == [path]
    path.rename(tmp_path / "other.mcap")
    assert len(LogReader(tmp_path / "other.mcap").parts) == 1


def test_lines_of_text_are_counted_into_their_own_file(tmp_path: Path) -> None:
    writer = open_log(tmp_path / "run.mcap", run_info(), RecordOptions(rotate_s=1.0))
    for i in range(40):
        writer.write(LogRecord(EPOCH_NS + i * 100_000_000, Severity.INFO, "test", str(i)))
    writer.close(summary())
    found = [
        [int(m.decoded.message) for m in LogReader(p, alone=True).messages({"/log"})]
        for p in parts_of(tmp_path / "run.mcap")
    ]
    assert found == [
        list(range(10)),
        list(range(10, 20)),
        list(range(20, 30)),
        list(range(30, 40)),
    ]


def write_all(writer: RunWriter, records: Iterable[Record]) -> None:
    for record in records:
        writer.write(record)


@pytest.mark.parametrize("kind", ["deleted", "renamed", "replaced", "folder"])
def test_a_log_that_lost_its_name_is_reported_at_the_next_chunk(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    path = folder / "run.mcap"
    writer = RunWriter(path, run_info())
    records = synthetic_run()
    for record in itertools.islice(records, 400):
        writer.write(record)
    match kind:
        case "deleted":
            path.unlink()
        case "renamed":
            path.rename(folder / "other.mcap")
        case "replaced":
            (folder / "new").write_text("another's")
            (folder / "new").replace(path)
        case _:
            folder.rename(tmp_path / "moved")
    with pytest.raises(LogGoneError, match="during the recording") as reported:
        write_all(writer, records)
    assert str(reported.value).startswith(f"cannot write {path}: ")
    writer.close(summary())
    if kind == "replaced":
        assert path.read_text() == "another's"
    else:
        assert not path.exists(), "the file is not created again"


def test_a_log_that_lost_its_name_is_reported_when_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, run_info())
    for record in itertools.islice(synthetic_run(), 50):
        writer.write(record)
    path.unlink()
    with pytest.raises(LogGoneError):
        writer.close(summary())


def test_the_recorder_keeps_it_as_its_error(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = ThreadedRecorder(RunWriter(path, run_info()))
    path.unlink()
    for record in itertools.islice(synthetic_run(), 50):
        recorder.write(record)
    recorder.close(summary())
    assert isinstance(recorder.error, LogGoneError)


def test_a_log_reached_by_a_link_or_a_relative_name_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    monkeypatch.chdir(tmp_path)
    writer = RunWriter(Path("link/run.mcap"), run_info())
    monkeypatch.chdir("/")
    for record in itertools.islice(synthetic_run(), 400):
        writer.write(record)
    writer.close(summary())
    assert not LogReader(tmp_path / "real" / "run.mcap").truncated
