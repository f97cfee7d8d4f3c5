"""``sweepctl emulate`` as a child process, for tests that need a port."""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.virtual.settings import SweeperSettings

_ROOT = Path(__file__).resolve().parents[2]


class EmulatorError(Exception):
    """The emulator did not start; the text is the last line that it printed."""


class EmulatorProcess:
    """A running emulator that has printed ``ready PORT``."""

    def __init__(
        self, settings: SweeperSettings, *, ready_s: float, truth: Path | None = None
    ) -> None:
        """Start the emulator and wait until its port is ready.

        Args:
            settings: properties of the virtual sweeper.
            ready_s: maximum time to wait, s.
            truth: log of true poses and faults to write; None: none.

        Raises:
            EmulatorError: the arguments are invalid, the emulator cannot open its port, or its
                start takes too long.

        """
        arguments = ["emulate", settings.room, "--link", settings.link, "--noise", settings.noise]
        arguments += ["--seed", str(settings.seed), "--node", str(settings.node)]
        arguments += ["--target", settings.target]
        if settings.firmware is not None:
            arguments += ["--firmware", settings.firmware]
        for fault in settings.faults:
            arguments += ["--fault", fault]
        if truth is not None:
            arguments += ["--truth", str(truth.absolute())]
        # -P, so that Python does not import a folder `tools` in the user's working directory.
        self._process = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-P", "-m", "tools.sweepctl", *arguments],
            env={**os.environ, "PYTHONPATH": _python_path()},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self._first_line(ready_s)
        if not line.startswith("ready "):
            self._process.kill()
            _, complaint = self._process.communicate()
            lines = [part for part in complaint.strip().splitlines() if part]
            raise EmulatorError(lines[-1] if lines else f"no port after {ready_s:g} s")
        self.port = line.removeprefix("ready ").rstrip("\n")
        """Name of the port, for ``sweepctl connect`` or :func:`bridge.open`."""

    def _first_line(self, within_s: float) -> str:
        assert self._process.stdout is not None  # noqa: S101 - Popen was given PIPE
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            if not selector.select(within_s):
                return ""
        return self._process.stdout.readline()

    def end(self, within_s: float) -> str | None:
        """Terminate the emulator; return a description of the failure, or None."""
        died = self._process.poll()
        self._process.terminate()
        try:
            _, complaint = self._process.communicate(timeout=within_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            return f"the emulator did not end within {within_s:g} s"
        if died is not None or self._process.returncode != 0:
            status = self._process.returncode
            when = "ended by itself" if died is not None else "ended"
            return f"the emulator {when} with status {status}: {complaint.strip()}"
        return None


def _python_path() -> str:
    """Return the user's PYTHONPATH with our folder in front."""
    before = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), before] if before else [str(_ROOT)])
