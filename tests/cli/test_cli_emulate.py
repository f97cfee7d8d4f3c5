"""``sweepctl emulate`` in a separate process: first output line, link, ground truth and end."""

from __future__ import annotations

import os
import signal
import time
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bridge.io.owner_client import ask
from bridge.record.reader import LogReader
from support.cli import PATIENCE_S, decoded, end, plain_messages, start, sweepctl
from support.waiting import until

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

pytestmark = pytest.mark.slow


def ready(process: subprocess.Popen[str]) -> str:
    """Return the port in the first line."""
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("ready "), process.communicate(timeout=PATIENCE_S)
    return line.removeprefix("ready ").rstrip("\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_ready_and_ended_by_a_signal(tmp_path: Path, number: signal.Signals) -> None:
    process = start("emulate", cwd=tmp_path)
    port = Path(ready(process))
    assert port.is_char_device()
    done = end(process, number)
    assert (done.status, done.out) == (0, "")
    assert "case-1" in done.line
    assert list(tmp_path.iterdir()) == []


@contextmanager
def nohup() -> Iterator[None]:
    """Start processes inside the context so that they survive the loss of their terminal."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.realtime
def test_under_nohup_a_lost_terminal_ends_neither_the_emulator_nor_a_run(tmp_path: Path) -> None:
    with nohup():
        emulator = start("emulate", "empty", cwd=tmp_path)
    try:
        port = ready(emulator)
        with nohup():
            host = start("connect", port, "--duration", "2", "--json", cwd=tmp_path)
        until(lambda: _is_owned(port), within_s=PATIENCE_S, what="the port has an owner")
        emulator.send_signal(signal.SIGHUP)
        ended = end(host, signal.SIGHUP)
    finally:
        status = end(emulator, signal.SIGTERM).status
    assert (ended.status, ended.json["reason"]) == (0, "the requested duration is over"), ended
    assert status == 0


def _is_owned(port: str) -> bool:
    """Return whether a run is in progress on the port."""
    with suppress(Exception):  # the port has no owner yet
        return bool(ask(port, {"do": "status"})["status"])
    return False


def test_two_at_once_have_ports_of_their_own(tmp_path: Path) -> None:
    both = [start("emulate", "empty", cwd=tmp_path) for _ in range(2)]
    ports = [ready(process) for process in both]
    assert ports[0] != ports[1]
    assert [end(process, signal.SIGTERM).status for process in both] == [0, 0]


@pytest.mark.parametrize("before", ["nothing", "a stale link", "a link to a file"])
def test_the_link_is_made_and_removed(tmp_path: Path, before: str) -> None:
    link, target = tmp_path / "sweeper", tmp_path / "file"
    target.write_text("precious")
    if before == "a stale link":
        link.symlink_to("/dev/pts/none")
    elif before == "a link to a file":
        link.symlink_to(target)
    process = start("emulate", "--pty-link", link, cwd=tmp_path)
    assert ready(process) == str(link)
    assert link.is_symlink()
    assert link.resolve().is_char_device()
    assert end(process, signal.SIGTERM).status == 0
    assert not os.path.lexists(link)
    assert target.read_text() == "precious"


@pytest.mark.parametrize("taken", ["file", "folder that is not there"])
def test_a_link_that_cannot_be_made(tmp_path: Path, taken: str) -> None:
    link = tmp_path / "sweeper"
    if taken == "file":
        link.write_text("precious")
    else:
        link = tmp_path / "none" / "sweeper"
    done = sweepctl("emulate", "--pty-link", link)
    assert done.status == 3
    assert str(link) in done.line
    assert done.out == ""
    if taken == "file":
        assert link.read_text() == "precious"


def test_the_truth(tmp_path: Path) -> None:
    log = tmp_path / "truth.mcap"
    before_ns = time.time_ns()
    process = start("emulate", "case-1", "--truth", log, cwd=tmp_path)
    ready(process)
    while len(list(LogReader(log).messages())) < 30 and process.poll() is None:
        signal.sigtimedwait([], 0.02)
    assert end(process, signal.SIGTERM).status == 0
    after_ns = time.time_ns()
    poses = list(decoded(log, "/truth/pose"))
    assert len(poses) > 20
    times = [plain.log_ns for plain, _ in poses]
    assert before_ns <= times[0]
    assert times[-1] <= after_ns
    gaps = sorted(b - a for a, b in pairwise(times))
    assert gaps[0] > 0
    assert gaps[len(gaps) // 2] <= 50_000_000, "20 Hz at least"
    for plain, value in poses:
        assert value.frame_id == "map"
        assert value.timestamp.ToNanoseconds() == plain.log_ns
        assert value.pose.position.x == pytest.approx(0.2, abs=0.5)
    assert len({plain.data[-20:] for plain, _ in poses}) == 1, "the robot moved"


def test_a_truth_file_is_not_replaced(tmp_path: Path) -> None:
    log = tmp_path / "truth.mcap"
    log.write_text("precious")
    done = sweepctl("emulate", "--truth", log)
    assert (done.status, done.out) == (1, "")
    assert "--force" in done.line
    assert log.read_text() == "precious"
    process = start("emulate", "--truth", log, "--force", cwd=tmp_path)
    ready(process)
    assert end(process, signal.SIGTERM).status == 0
    plain_messages(log)
    done = sweepctl("emulate", "--truth", tmp_path / "none" / "truth.mcap")
    assert (done.status, done.out) == (1, "")
    assert "cannot write" in done.line
