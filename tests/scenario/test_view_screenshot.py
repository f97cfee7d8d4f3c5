"""The window that `view` opens, drawn off screen by the viewer itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread

from bridge.record.writer import RunWriter
from bridge.view.screenshot import save_screenshot
from support.synthetic_run import run_info, summary, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.needs("vulkan")
def test_the_window_shows_room_and_swept_floor(tmp_path: Path) -> None:
    log, png = tmp_path / "run.mcap", tmp_path / "view.png"
    writer = RunWriter(log, run_info())
    for record in synthetic_run():
        writer.write(record)
    writer.close(summary())
    save_screenshot(log, png)
    picture = imread(png)[..., :3]
    assert picture.shape == (1080, 1920, 3)
    room = picture[60:620, :950]
    red, green, blue = room[..., 0], room[..., 1], room[..., 2]
    swept = (green > 0.45) & (red < 0.35) & (blue < 0.5)
    walls = (red > 0.9) & (green > 0.9) & (blue > 0.9)
    assert np.count_nonzero(swept) > 2_000, "no swept floor to be seen"
    assert np.count_nonzero(walls) > 1_000, "no walls to be seen"
