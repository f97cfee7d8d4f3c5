"""The page of `view FILE --serve`, drawn by a browser without a window."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread

from support.browser import Browser
from support.root import ROOT
from support.synthetic_run import EPOCH_NS, synthetic_run, write_synthetic_log
from support.viewer_colours import swept

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.realtime, pytest.mark.nightly, pytest.mark.needs("chromium")]

SIZE = (1000, 640)
RECORDED_S = 20.0
PATIENCE_S = 100.0


def swept_pixels(png: Path) -> int:
    """Return the number of green pixels in the upper left, where the layout shows the room."""
    picture = imread(png)[..., :3]
    room = picture[: SIZE[1] * 6 // 10, : SIZE[0] // 2]
    return int(np.count_nonzero(swept(room)))


def test_a_browser_shows_room_and_swept_floor(tmp_path: Path) -> None:
    log, png = tmp_path / "run.mcap", tmp_path / "web.png"
    end_ns = EPOCH_NS + RECORDED_S * 1e9
    write_synthetic_log(log, (record for record in synthetic_run() if record.log_ns < end_ns))
    served = subprocess.Popen(
        [sys.executable, "-m", "tools.sweepctl", "view", str(log), "--serve"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert served.stderr is not None
        word, page = served.stderr.readline().split()
        assert word == "open"
        until = time.monotonic() + PATIENCE_S
        with Browser(tmp_path / "profile", page, SIZE) as browser:
            found = 0
            while found < 400 and time.monotonic() < until:
                time.sleep(1.0)
                browser.screenshot(png)
                found = swept_pixels(png)
        assert found >= 400, "no swept floor to be seen"
        colours = np.unique((imread(png)[..., :3] * 255).astype(np.uint8).reshape(-1, 3), axis=0)
        assert len(colours) > 100, "the plots beside it are blank"
    finally:
        served.send_signal(signal.SIGINT)
        _, printed = served.communicate(timeout=20)
    assert served.returncode == 0, printed
