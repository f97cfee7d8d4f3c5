"""``sweepctl emulate`` as a process of its own, for as long as somebody needs its port."""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.virtual.settings import Settings

_ROOT = Path(__file__).resolve().parents[2]


class EmulatorError(Exception):
    """The emulator did not start; the text is its own last line."""


class EmulatorProcess:
    """A running emulator that has said ``ready``."""

    def __init__(self, settings: Settings, *, ready_s: float) -> None:
        """Start it and wait for its port.

        Raises:
            EmulatorError: it refused its arguments, could not open its port, or said nothing.

        """
        arguments = ["emulate", settings.room, "--link", settings.link, "--noise", settings.noise]
        arguments += ["--seed", str(settings.seed), "--node", str(settings.node)]
        for fault in settings.faults:
            arguments += ["--fault", fault]
        # -P: a folder `tools` of the user's own, where the tests run, must not hide ours.
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
            raise EmulatorError(lines[-1] if lines else f"said nothing for {ready_s:g} s")
        self.port = line.removeprefix("ready ").rstrip("\n")
        """To be given to connect, or to :func:`bridge.open`."""

    def _first_line(self, within_s: float) -> str:
        assert self._process.stdout is not None  # noqa: S101 - a pipe was asked for
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            if not selector.select(within_s):
                return ""
        return self._process.stdout.readline()

    def end(self, within_s: float) -> str | None:
        """End it in order; what was wrong with that, or None."""
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
    """Where this package is, before whatever the user has set."""
    before = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), before] if before else [str(_ROOT)])
