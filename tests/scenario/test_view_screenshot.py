"""The window that `view` opens, drawn off screen by the viewer itself."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Self

import numpy as np
import pytest
from matplotlib.image import imread

from bridge.record.writer import RunWriter
from bridge.view.screenshot import save_screenshot
from support.synthetic_run import run_info, summary, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


class Proxy:
    """A proxy that passes nothing on, and keeps who asked for what."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)  # noqa: FBT003 - positional in C
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def asked(self) -> list[bytes]:
        """The beginning of each request that has come."""
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
def test_the_window_shows_room_and_swept_floor_and_asks_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, png = tmp_path / "run.mcap", tmp_path / "view.png"
    writer = RunWriter(log, run_info())
    for record in synthetic_run():
        writer.write(record)
    writer.close(summary())
    with Proxy() as proxy:
        # A user's own proxy, for whatever is asked beyond this machine.
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
    red, green, blue = room[..., 0], room[..., 1], room[..., 2]
    swept = (green > 0.45) & (red < 0.35) & (blue < 0.5)
    walls = (red > 0.9) & (green > 0.9) & (blue > 0.9)
    assert np.count_nonzero(swept) > 2_000, "no swept floor to be seen"
    assert np.count_nonzero(walls) > 1_000, "no walls to be seen"
