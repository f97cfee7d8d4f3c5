"""The viewer of a live run, in a separate process."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bridge.io import clock
from bridge.view.errors import NoDisplayError, ViewerFailedError, ViewerMissingError
from bridge.view.rerun.launch import has_display, viewer_program

_START_S = 20.0
_POLL_S = 0.05


class LiveViewer:
    """Shows a log in Rerun during its recording. The viewer cannot affect the run.

    The run's process starts the viewer's process, closes a pipe at the end and never waits for it.
    """

    def __init__(self, log: Path, *, serve: bool = False, headless: bool = False) -> None:
        """Start the process; :meth:`wait_started` waits for the viewer's address.

        Raises:
            ViewerMissingError: Rerun is not installed.
            NoDisplayError: a window was requested and there is no display.

        """
        check(serve=serve or headless)
        self._folder = tempfile.TemporaryDirectory(prefix="sweepctl-live-")
        self._address_file = Path(self._folder.name) / "address"
        command = [sys.executable, "-m", "bridge.view.rerun.feeder", str(log)]
        command += ["--serve"] if serve else []
        command += ["--headless"] if headless else []
        command += ["--address-file", str(self._address_file)]
        root = str(Path(__file__).parents[3])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            command,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "CI": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.address = ""
        """Address at which Rerun receives data."""
        self.page = ""
        """Address for a browser; empty unless the viewer is served."""
        self.pid = 0
        """Process id of the viewer."""

    def wait_started(self) -> None:
        """Wait until the viewer has started.

        Raises:
            ViewerFailedError: the viewer did not start.

        """
        for _ in range(round(_START_S / _POLL_S)):
            with contextlib.suppress(FileNotFoundError):
                text = self._address_file.read_text(encoding="ascii")
                self.address, self.page, pid = text.split("\n")[:3]
                self.pid = int(pid)
                return
            if self._process.poll() is not None:
                raise ViewerFailedError(self._process.returncode, "it could not be started")
            clock.pause(_POLL_S)
        raise ViewerFailedError(1, "it did not start")

    def close(self) -> None:
        """Notify the process that the run has ended. A window stays open, but a server ends."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._folder.cleanup()

    def kill(self) -> None:
        """Kill the feeding process at once, for tests."""
        self._process.kill()
        self._process.wait()


def check(*, serve: bool) -> None:
    """Check that a viewer can be started.

    Raises:
        ViewerMissingError: Rerun is not installed.
        NoDisplayError: a window was requested and there is no display.

    """
    if importlib.util.find_spec("rerun") is None:
        raise ViewerMissingError
    viewer_program()
    if not serve and not has_display():
        raise NoDisplayError
