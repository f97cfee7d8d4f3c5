"""The window that `view` opens, drawn by the viewer without a screen."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Self

import numpy as np
import pytest
from matplotlib.image import imread

from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.record.log_writer import RunWriter
from bridge.session.records import PoseRecord
from bridge.view.rerun.screenshot import save_screenshot
from support.synthetic_run import EPOCH_NS, run_info, write_synthetic_log
from support.viewer_colours import swept, walls

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


class Proxy:
    """A proxy that forwards nothing, and records the requests."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)  # noqa: FBT003 - positional in C
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def asked(self) -> list[bytes]:
        """Return the first line of each request."""
        found = []
        with suppress(BlockingIOError):
            while True:
                client, _ = self._listener.accept()
                with client:
                    client.settimeout(5.0)
                    found.append(client.recv(200))
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_args: object) -> None:
        self._listener.close()


@pytest.mark.needs("vulkan")
def test_the_window_shows_room_and_swept_floor_without_network_requests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, png = tmp_path / "run.mcap", tmp_path / "view.png"
    write_synthetic_log(log)
    with Proxy() as proxy:
        # The environment names a user's proxy for every request to another machine.
        for scheme in ("http", "https", "all"):
            monkeypatch.setenv(f"{scheme}_proxy", proxy.url)
            monkeypatch.setenv(f"{scheme}_proxy".upper(), proxy.url)
        for name in ("no_proxy", "NO_PROXY"):
            monkeypatch.setenv(name, "127.0.0.1,localhost")
        save_screenshot(log, png)
        assert proxy.asked() == [], "the viewer asks beyond this machine"
    picture = imread(png)[..., :3]
    assert picture.shape == (1080, 1920, 3)
    room = picture[60:620, :950]
    assert np.count_nonzero(swept(room)) > 2_000, "no swept floor to be seen"
    assert np.count_nonzero(walls(room)) > 1_000, "no walls to be seen"


def _long_run(log: Path) -> None:
    """Write a run of three minutes: one minute along each of y = 0.5, 1.5 and 2.5 m."""
    plan = parse_floorplan(
        """{"walls": [[0,0],[4,0],[4,3],[0,3]], "start": [0.4,0.5,0],
        "carpets": [{"polygon": [[0.8,0.8],[1.4,0.8],[1.4,1.2],[0.8,1.2]]}],
        "thresholds": [{"line": [[2.5,1.7],[2.5,2.3]], "height_m": 0.004}]}"""
    )
    writer = RunWriter(log, run_info(plan=plan))
    for step in range(900):
        minute, part = divmod(step, 300)
        pose = Pose2(0.4 + 3.2 * part / 300, 0.5 + minute, 0.0)
        log_ns = EPOCH_NS + step * 200_000_000
        writer.write(PoseRecord(log_ns, pose, 0.2, 0.0, (0.0,) * 9, 0.0, 1.0))
    writer.close()


@pytest.mark.needs("vulkan")
def test_the_newest_minute_of_a_long_path_stands_out_and_the_floor_is_marked(
    tmp_path: Path,
) -> None:
    log, png = tmp_path / "long.mcap", tmp_path / "long.png"
    _long_run(log)
    save_screenshot(log, png)
    room = imread(png)[60:580, :950, :3]
    red, green, blue = room[..., 0], room[..., 1], room[..., 2]
    rows = np.flatnonzero(walls(room).sum(axis=1) > 300)
    top, bottom = rows.min(), rows.max()  # the walls at y = 3 m and at y = 0 m
    bright = (blue > 0.9) & (red < 0.5) & (green > 0.4)

    def seen(y_m: float) -> int:
        at = round(bottom - (bottom - top) * y_m / 3.0)
        return int(np.count_nonzero(bright[at - 5 : at + 6]))

    assert seen(2.5) > 300, "the last minute is bright"
    assert seen(0.5) == 0, "what was before is not"
    assert seen(1.5) < 100, "but for the stroke that leads across to the last lane"
    faint = (blue > 0.3) & (blue < 0.7) & (green > 0.25) & (red < 0.35) & (blue > red + 0.1)
    at = round(bottom - (bottom - top) * 0.5 / 3.0)
    assert np.count_nonzero(faint[at - 5 : at + 6]) > 100, "but it is there"
    magenta = (red > 0.6) & (green < 0.6) & (blue > 0.6)
    yellow = (red > 0.7) & (green > 0.6) & (blue < 0.4)
    assert np.count_nonzero(magenta) > 100, "the carpet"
    assert np.count_nonzero(yellow) > 50, "the threshold"
