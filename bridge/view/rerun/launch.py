"""Starting Rerun on a recorded run, in a process of its own."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.files import check_target
from bridge.record.errors import LogWriteError
from bridge.record.names import is_utf8, readable_name
from bridge.view.errors import NoDisplayError, ViewerFailedError, ViewerMissingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.record.reader import LogReader

APPLICATION = "sweepctl"
_LOOPBACK = "127.0.0.1"
_INSTEAD = ", --save FILE.rrd writes a Rerun file, --png or --screenshot FILE.png a picture"
_NO_PROXY_THERE = "http://127.0.0.1:9"
"""Nothing answers on the discard service's port of this machine."""
_DIRECT = "127.0.0.1,localhost,::1"
"""What is reached without a proxy: the data that the viewer is sent."""
_INTERRUPTED = {-2, 130}
"""Ended by Ctrl-C, which is how a person ends a viewer that holds the terminal."""


def open_viewer(path: Path, *, save: Path | None = None, serve_web: bool = False) -> LogReader:
    """Show a run, or save what would be shown; gives the reader, which knows of damage.

    The viewer reads a Rerun file made beforehand, so that nothing it does can reach back.
    This returns when its window is closed, or on Ctrl-C.

    Args:
        path: the run's MCAP file.
        save: write a Rerun file (``.rrd``) here, blueprint included, and open nothing.
        serve_web: serve the viewer to a browser on this machine instead of opening a window.

    Raises:
        ViewerMissingError: Rerun is not installed.
        LogReadError: the log cannot be read.
        LogWriteError: ``save`` cannot be written.
        NoDisplayError: a window is wanted and there is no display.
        ViewerFailedError: the viewer did not start.

    """
    if importlib.util.find_spec("rerun") is None:
        raise ViewerMissingError
    if save is not None:
        return write_rerun_file(path, save)
    if not serve_web and not has_display():
        raise NoDisplayError(_INSTEAD)
    with tempfile.TemporaryDirectory(prefix="sweepctl-view-") as folder:
        file = Path(folder) / f"{readable_name(path.stem)}.rrd"
        reader = write_rerun_file(path, file)
        _run_viewer(viewer_command(file, serve_web=serve_web))
    return reader


def write_rerun_file(path: Path, file: Path) -> LogReader:
    """Write a run with its blueprint as a Rerun file.

    Raises:
        LogReadError: the log cannot be read.
        LogWriteError: the file cannot be written.

    """
    import rerun as rr  # noqa: PLC0415 - optional, and slow to load

    from bridge.view.rerun.blueprint import blueprint  # noqa: PLC0415 - loads rerun
    from bridge.view.rerun.convert import to_rerun  # noqa: PLC0415 - loads rerun

    if not is_utf8(file):
        raise LogWriteError(file, "Rerun needs a name in UTF-8")
    stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
    try:
        # Rerun only warns where it cannot write.
        check_target(file)
        file.open("wb").close()
    except OSError as error:
        raise LogWriteError.of(file, error) from None
    try:
        stream.save(file)
        try:
            run = to_rerun(path, stream)
            stream.send_blueprint(blueprint(run.plan, run.duration_s))
        finally:
            stream.flush()
            stream.disconnect()
    except RuntimeError as error:  # of Rerun's writing thread, on a full disk for one
        raise LogWriteError(file, str(error)) from None
    return run.reader


def viewer_command(file: Path, *, serve_web: bool) -> list[str]:
    """The command line of a viewer that listens on this machine only.

    Raises:
        ViewerMissingError: Rerun is not installed, or without its viewer.

    """
    command = [str(viewer_program()), str(file), "--bind", _LOOPBACK, "--new"]
    return [*command, "--serve-web"] if serve_web else [*command, "--hide-welcome-screen"]


def viewer_program() -> Path:
    """The program itself: started through Python its exit status is lost."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        folder = Path(spec.origin).parent
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
            if (folder / name).is_file():
                return folder / name
    raise ViewerMissingError


def viewer_environment(log_level: str) -> dict[str, str]:
    """What a viewer is started with: plain notices, and no request beyond this machine.

    Rerun reports its use unless the user's own settings forbid it, and those are not ours to
    change; on a machine that runs tests it does not report, so ``CI`` is set. Its window also asks
    for Rerun's newest release, which no setting turns off; a proxy that does not exist does.
    """
    environment = {"RUST_LOG": log_level, **os.environ}
    environment |= {"RERUN_APP_ONLY": "true", "NO_COLOR": "1", "CI": "1"}
    environment.pop("FORCE_RERUN_ANALYTICS", None)
    for name, value in (
        *((f"{scheme}_proxy", _NO_PROXY_THERE) for scheme in ("http", "https", "all")),
        ("no_proxy", _DIRECT),
    ):
        environment[name] = environment[name.upper()] = value
    return environment


def has_display() -> bool:
    """Whether a window can be opened. Only Linux can tell beforehand."""
    return sys.platform != "linux" or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    )


def _run_viewer(command: Sequence[str]) -> None:
    # Of its notices only the last lines matter, and only where it fails.
    environment = viewer_environment("warn")
    with subprocess.Popen(  # noqa: S603 - the installed viewer, and a file of ours
        command, env=environment, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as viewer:
        error = ""
        try:
            for line in viewer.stderr or ():
                if line.strip() and not error.startswith("Error: "):
                    error = line.strip()
            status = viewer.wait()
        except KeyboardInterrupt:
            viewer.terminate()
            return
    if status not in {0, *_INTERRUPTED}:
        raise ViewerFailedError(status, error or "it gave no reason")
