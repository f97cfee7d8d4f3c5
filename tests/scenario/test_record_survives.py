"""The content of a log after its writer was killed, or after the disk was full."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from bridge.record.chunk import CHUNK_NS
from bridge.record.reader import LogReader
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


_RECORD = """
import resource, signal, sys, time
from pathlib import Path
sys.path[:0] = [{root!r}, {tests!r}]
from bridge.record.recorder import ThreadedRecorder
from bridge.record.log_writer import RunWriter
from bridge.session.records import LogRecord, RawBytes, Severity
from support.synthetic_run import run_info
"""

_KILLED = (
    _RECORD
    + """
from support.hold_up import waited_ns
recorder = ThreadedRecorder(RunWriter(Path(sys.argv[1]), run_info()))
i = 0
while True:
    now = time.time_ns()
    recorder.write(LogRecord(now, Severity.INFO, "test", str(i)))
    print(i, now, waited_ns(), flush=True)
    i += 1
    time.sleep(0.001)
"""
)

_FULL = (
    _RECORD
    + """
import random
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
writer = RunWriter(Path(sys.argv[1]), run_info())
noise = random.Random(1)
try:
    for i in range(5000):
        now = 1_700_000_000_000_000_000 + i * 1_000_000
        writer.write(RawBytes(now, False, noise.randbytes(200)))
except Exception as error:
    print(type(error).__name__, i, error)
writer.close({{"outcome": "fault"}})
"""
)


def script(text: str) -> str:
    return text.format(root=str(ROOT), tests=str(ROOT / "tests"))


def test_a_kill_loses_half_a_second_at_most(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", script(_KILLED), str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        printed: list[list[int]] = []
        for shown in process.stdout:
            printed.append([int(part) for part in shown.split()])
            if printed[-1][1] - printed[0][1] > 1_600_000_000:
                process.kill()
                break
        written, killed_ns, held_ns = printed[-1]
    reader = LogReader(path)
    lines = list(reader.messages(["/log"]))
    assert reader.truncated
    assert reader.problems == []
    assert [m.decoded.message for m in lines] == [str(i) for i in range(len(lines))]
    assert len(lines) <= written + 1 + 1000
    held_ns -= printed[len(lines) - 1][2]
    assert killed_ns - lines[-1].log_ns <= 2 * CHUNK_NS + held_ns, f"held up for {held_ns} ns"
    assert "robot.toml" in reader.attachments
    assert reader.run["port"] == "memory"


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are a Unix thing")
def test_a_full_disk_keeps_the_recorded_part(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    done = subprocess.run(
        [sys.executable, "-c", script(_FULL), str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    kind, reached, reported = done.stdout.split(" ", 2)
    assert kind == "LogWriteError"
    assert str(path) in reported
    assert len(reported.splitlines()) == 1
    reader = LogReader(path)
    kept = sum(1 for _ in reader.messages(["/raw/uart/rx"]))
    assert reader.problems == []
    assert not reader.truncated, "the summary must fit where the cut chunk was"
    assert int(reached) - kept <= 251, "one chunk of 0.25 s at most"
