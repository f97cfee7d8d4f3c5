"""Picture of the viewer without a display, by off-screen rendering in Rerun."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.io.free_port import free_tcp_port
from bridge.record.names import readable_name
from bridge.view.errors import ViewerFailedError
from bridge.view.output import write
from bridge.view.rerun.launch import viewer_command, viewer_environment, write_rerun_file

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

    from bridge.record.reader import LogReader

DRAWING_S = 1.0
"""Pause between two pictures, s. The viewer draws new data within a second."""
TRIES = 40
"""Maximum number of pictures. Software rendering of a whole run takes several seconds."""


def save_screenshot(path: Path, png: Path) -> LogReader:
    """Save a picture of a log in the viewer. It needs a graphics driver, for example in software.

    Raises:
        ViewerMissingError: Rerun is not installed.
        LogReadError: the log cannot be read.
        LogWriteError: the picture cannot be written.
        ViewerFailedError: the viewer has no graphics driver, or its picture did not become stable.

    """
    with tempfile.TemporaryDirectory(prefix="sweepctl-view-") as folder:
        file = Path(folder) / f"{readable_name(path.stem)}.rrd"
        reader = write_rerun_file(path, file)
        port = free_tcp_port()
        command = [
            *(part for part in viewer_command(file) if part != "--new"),
            *("--headless", "--port", str(port)),
        ]
        with subprocess.Popen(  # noqa: S603 - the installed viewer, and a file of ours
            command,
            env=viewer_environment("error"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        ) as viewer:
            try:
                take_at_rest(_client(viewer, port), Path(folder) / "shot.png", png)
            finally:
                viewer.terminate()
    return reader


def _client(viewer: subprocess.Popen[bytes], port: int) -> ViewerClient:
    """Connect to the viewer as soon as it answers."""
    from rerun.experimental import ViewerClient  # noqa: PLC0415 - optional, and slow to load

    for _ in range(TRIES):
        if viewer.poll() is not None:
            printed = (viewer.stderr.read() if viewer.stderr else b"").decode("utf-8", "replace")
            lines = [line.strip() for line in printed.splitlines() if line.strip()]
            raise ViewerFailedError(viewer.returncode, lines[0] if lines else "no reason given")
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
        except (RuntimeError, OSError, ValueError):
            clock.pause(DRAWING_S)
        else:
            return client
    raise ViewerFailedError(1, "it did not answer")


def take_at_rest(viewer: ViewerClient, shot: Path, png: Path) -> None:
    """Save pictures until two consecutive pictures are equal. Then all data is loaded and drawn."""
    last = b""
    for _ in range(TRIES):
        try:
            viewer.save_screenshot(str(shot))
        except (RuntimeError, ValueError, OSError) as error:  # OSError includes TimeoutError
            lines = str(error).strip().splitlines()
            raise ViewerFailedError(1, lines[0] if lines else "it drew nothing") from None
        image = shot.read_bytes()
        if image == last:
            write(png, image)
            return
        last = image
        clock.pause(DRAWING_S)
    raise ViewerFailedError(1, f"its picture still changed after {TRIES} tries")
