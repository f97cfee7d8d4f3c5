"""Rerun next to a live run: it shows the run, and it cannot delay the run."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.request import urlopen

import numpy as np
import pytest
from matplotlib.image import imread
from rerun.experimental import ViewerClient

from bridge.record.log_writer import RunWriter
from bridge.record.reader import LogReader
from bridge.record.recorder import ThreadedRecorder
from bridge.view.errors import NoDisplayError
from bridge.view.following import Follower, paced
from bridge.view.rerun.launch import viewer_environment
from bridge.view.rerun.live import LiveViewer, check
from support.cli import sweepctl
from support.synthetic_run import EPOCH_NS, run_info, summary, synthetic_run
from support.viewer_colours import swept

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.session.records import Record

pytestmark = pytest.mark.realtime

TRIES = 60


def run(begin_s: float, end_s: float) -> Iterator[Record]:
    for record in synthetic_run():
        if begin_s <= (record.log_ns - EPOCH_NS) / 1e9 < end_s:
            yield record


def swept_pixels(client: ViewerClient, png: Path) -> int:
    """Return the number of green (swept) pixels; 0 before the viewer shows anything."""
    try:
        client.save_screenshot(str(png))
    except (RuntimeError, ValueError):
        return 0
    picture = imread(png)[..., :3]
    room = picture[60 : picture.shape[0] // 2, : picture.shape[1] // 2]
    return int(np.count_nonzero(swept(room)))


def wait_for_more(client: ViewerClient, png: Path, than: int) -> int:
    for _ in range(TRIES):
        found = swept_pixels(client, png)
        if found > than:
            return found
        time.sleep(0.5)
    raise AssertionError(f"the viewer shows no more than {than} pixels of swept floor")


def connect(address: str) -> ViewerClient:
    for _ in range(TRIES):
        with contextlib.suppress(RuntimeError, OSError, ValueError):
            client = ViewerClient.connect(address)
            client.get_state()
            return client
        time.sleep(0.5)
    raise AssertionError("the viewer does not answer")


@pytest.mark.skipif(sys.platform == "win32", reason="signals that freeze are a Unix thing")
@pytest.mark.needs("vulkan")
def test_a_frozen_viewer_holds_up_neither_run_nor_log(tmp_path: Path) -> None:
    log, png = tmp_path / "run.mcap", tmp_path / "live.png"
    recorder = ThreadedRecorder(RunWriter(log, run_info()))
    viewer = LiveViewer(log, headless=True)
    try:
        viewer.wait_started()
        for record in run(0.0, 6.0):
            recorder.write(record)
        client = connect(viewer.address)
        first = wait_for_more(client, png, 1500)
        os.kill(viewer.pid, signal.SIGSTOP)
        for record in run(6.0, 40.0):
            recorder.write(record)
        recorder.close(summary())
        viewer.close()
        stat = Path(f"/proc/{viewer.pid}/stat").read_text(encoding="ascii")
        assert stat.rpartition(")")[2].split()[0] == "T", "frozen all the while"
        assert (recorder.error, recorder.dropped) == (None, 0)
        reader = LogReader(log)
        poses = sum(1 for _ in reader.messages({"/pose"}))
        assert poses == sum(type(r).__name__ == "PoseRecord" for r in run(0.0, 40.0))
        assert not reader.truncated
        os.kill(viewer.pid, signal.SIGCONT)
        wait_for_more(client, png, 2 * first)  # the missed messages are in the file
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(viewer.pid, signal.SIGKILL)
        viewer.kill()


def test_the_web_viewer_is_served_on_this_machine_only(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    writer = RunWriter(log, run_info())
    viewer = LiveViewer(log, serve=True)
    try:
        viewer.wait_started()
        assert viewer.page.startswith("http://127.0.0.1:")
        page = b""
        for _ in range(TRIES):
            with contextlib.suppress(OSError), urlopen(viewer.page, timeout=10) as answer:  # noqa: S310 - the loopback
                page = answer.read()
                break
            time.sleep(0.25)
        assert b"<canvas" in page
        port = int(viewer.page.split(":")[2].split("/")[0])
        listening = [
            line.split()[1]
            for name in ("tcp", "tcp6")
            for line in Path(f"/proc/net/{name}").read_text(encoding="ascii").splitlines()[1:]
            if line.split()[3] == "0A" and line.split()[1].endswith(f":{port:04X}")
        ]
        assert listening == [f"0100007F:{port:04X}"]
    finally:
        writer.close()
        viewer.close()
        for _ in range(TRIES):
            try:
                os.kill(viewer.pid, 0)
            except ProcessLookupError:
                break
            if Path(f"/proc/{viewer.pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                break
            time.sleep(0.25)
        else:
            raise AssertionError("the server outlives its run")
        viewer.kill()


def test_a_missing_display_is_reported_before_the_robot_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("bridge.view.rerun.launch.sys.platform", "linux")
    with pytest.raises(NoDisplayError):
        check(serve=False)
    done = sweepctl("connect", "/dev/none", "--view")
    assert done.status == 1
    assert "no display" in done.line
    assert list(tmp_path.rglob("*.mcap")) == [], "no log was begun"


def test_the_viewer_sends_no_analytics() -> None:
    environment = viewer_environment("error")
    assert environment["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in environment


# ---- following and pacing ------------------------------------------------------------------


def test_a_follower_reads_each_message_once_at_any_time(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    writer = RunWriter(log, run_info())
    follower = Follower(log, {"/pose", "/device/imu"})
    seen = []
    for i, record in enumerate(run(0.0, 5.0)):
        writer.write(record)
        if i % 97 == 0:
            seen += follower.more()
            assert not follower.ended
    writer.close(summary())
    seen += follower.more()
    assert follower.ended
    expected = list(LogReader(log).messages({"/pose", "/device/imu"}))
    assert [tuple(m[1:]) for m in seen] == [tuple(m[1:]) for m in expected]
    assert len(seen) > 400


def test_a_replay_keeps_the_times_of_the_log(tmp_path: Path) -> None:
    """Every message comes with its batch, never before its time."""
    log = tmp_path / "run.mcap"
    writer = RunWriter(log, run_info())
    for record in run(0.0, 5.0):
        writer.write(record)
    writer.close()
    now_ns = 1_000_000_000

    def pause(duration_s: float) -> None:
        nonlocal now_ns
        now_ns += round(duration_s * 1e9)

    messages = LogReader(log).messages({"/pose"})
    reported = []
    for batch in paced(messages, 2.0, start_s=1.0, end_s=4.0, moment=lambda: now_ns, pause=pause):
        reported += [((now_ns - 1_000_000_000) / 1e9, (m.log_ns - EPOCH_NS) / 1e9) for m in batch]
    assert reported[0] == (0.0, 0.0)
    assert reported[-1][1] == pytest.approx(4.0, abs=0.03)
    for at_s, log_s in reported:
        due_s = max(0.0, (log_s - 1.0) / 2.0)
        assert due_s - 0.1 - 1e-6 <= at_s <= due_s + 0.1 + 1e-6
