"""Start of Rerun for a recorded run, in a separate process."""

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
"""Proxy address that never answers. It is the port of the discard service on this machine."""
_DIRECT = "127.0.0.1,localhost,::1"
"""Hosts that need no proxy, because the viewer receives its data from them."""
_INTERRUPTED = {-2, 130}
"""Exit statuses after Ctrl-C, which is the usual end of a viewer in the foreground."""


def open_viewer(path: Path, *, save: Path | None = None) -> LogReader:
    """Show a run, or save it as a Rerun file. Return the log's reader, which reports damage.

    The run is first converted to a Rerun file. The viewer reads this file, so it cannot change the
    log. The function returns when the window is closed, or on Ctrl-C.

    Args:
        path: the run's MCAP file.
        save: write a Rerun file (``.rrd``) with the blueprint to this path, and open nothing.

    Raises:
        ViewerMissingError: Rerun is not installed.
        LogReadError: the log cannot be read.
        LogWriteError: ``save`` cannot be written.
        NoDisplayError: a window was requested and there is no display.
        ViewerFailedError: the viewer did not start.

    """
    if importlib.util.find_spec("rerun") is None:
        raise ViewerMissingError
    if save is not None:
        return write_rerun_file(path, save)
    if not has_display():
        raise NoDisplayError(_INSTEAD)
    with tempfile.TemporaryDirectory(prefix="sweepctl-view-") as folder:
        file = Path(folder) / f"{readable_name(path.stem)}.rrd"
        reader = write_rerun_file(path, file)
        _run_viewer(viewer_command(file))
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
        # Rerun only warns if it cannot write.
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
    except RuntimeError as error:  # raised by Rerun's writing thread, for example on a full disk
        raise LogWriteError(file, str(error)) from None
    return run.reader


def viewer_command(file: Path) -> list[str]:
    """Return the command line of a viewer that listens on the loopback interface only.

    Raises:
        ViewerMissingError: Rerun is not installed, or without its viewer.

    """
    viewer = str(viewer_program())
    return [viewer, str(file), "--bind", _LOOPBACK, "--new", "--hide-welcome-screen"]


def viewer_program() -> Path:
    """Return the path of the viewer's program. The Python wrapper would hide its exit status."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        folder = Path(spec.origin).parent
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
            if (folder / name).is_file():
                return folder / name
    raise ViewerMissingError


def viewer_environment(log_level: str) -> dict[str, str]:
    """Return the viewer's environment: plain log lines, and no request to other machines.

    Rerun sends usage reports unless the user's settings or the variable ``CI`` disable them. This
    function sets ``CI`` and does not change the settings. The window also requests the number of
    Rerun's newest release from a server. No setting disables this request, so the environment has a
    proxy that never answers.
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
    """Return True if a window can be opened. Only Linux can check this in advance."""
    return sys.platform != "linux" or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    )


def _run_viewer(command: Sequence[str]) -> None:
    # Only the last lines of the viewer's output matter, and only if it fails.
    environment = viewer_environment("warn")
    with subprocess.Popen(  # noqa: S603 - the installed viewer, and our own file
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
