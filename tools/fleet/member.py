"""One robot of a fleet: its process, its state and its stop."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from bridge.errors import BridgeError
from bridge.io import clock
from bridge.io.owner_client import watch
from tools.cli.stopping import stop_port

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

WATCH_HZ = 4.0
"""Rate at which the state of a robot is read, Hz."""
_RETRY_S = 0.2
"""Interval at which the socket of a starting process is searched, s."""
_END_S = 5.0
"""Maximum time for a process to end after a signal, s. After that it is killed, and the fleet stops
the robot through the port."""
_ERROR = "sweepctl: "
"""Beginning of each error that a process prints."""
_ROOT = Path(__file__).resolve().parents[2]
LOST_STATUS = 3
"""Exit status for a robot that did not confirm its stop."""


@dataclass(frozen=True, slots=True)
class Target:
    """A robot that the command line names."""

    label: str
    """Name of the robot, or the port; unique in the fleet."""
    given: str
    """The argument as the user gave it: a port or the name of a robot."""
    port: str
    node: int | None
    how: Mapping[str, Any]
    """Options with which the port is opened."""
    log: Path
    own: tuple[str, ...] = ()
    """Options of ``connect`` for this robot only."""


@dataclass(frozen=True, slots=True)
class Stopped:
    """Result of a stop."""

    confirmed: bool
    text: str
    """Process or device that confirmed the stop, or the reason for a missing confirmation."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How the process of a robot ended."""

    exit_status: int
    reason: str
    summary: dict[str, Any] | None
    """Summary of the run; None: no summary."""

    @property
    def outcome(self) -> str:
        """Outcome of the run; ``fault`` without a summary."""
        return "fault" if self.summary is None else str(self.summary["outcome"])


class OnLine(Protocol):
    """Receiver of lines, called from another thread."""

    def __call__(self, label: str, line: str, *, is_error: bool) -> None:
        """Receive a line of the robot with this label, and whether it is an error."""


def drop_line(label: str, line: str, *, is_error: bool) -> None:
    """Drop a line."""
    del label, line, is_error


class Member:
    """A running ``sweepctl connect``. Its failure does not affect other members."""

    def __init__(
        self, target: Target, arguments: Sequence[str], on_line: OnLine = drop_line
    ) -> None:
        """Start the process.

        Args:
            target: the robot.
            arguments: options of ``connect`` that every robot gets.
            on_line: receives each line that the process prints.

        """
        self.target = target
        self.status: dict[str, Any] | None = None
        """Newest state of the robot, as the owner's socket reports it; None: not known yet."""
        self.ended: Ended | None = None
        """How the process ended; None: it runs."""
        self.stopped: Stopped | None = None
        """Result of the newest stop; None: none was requested."""
        self._on_line = on_line
        self._lock = threading.Lock()
        paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        words = ["connect", target.given, "--json", "--quiet", "--out", str(target.log)]
        # -P, so that Python does not import a folder `tools` in the user's working directory.
        self._process = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-P", "-m", "tools.sweepctl", *words, *target.own, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # so that only the fleet gets Ctrl-C
        )
        self._over = threading.Event()
        self.last_error = ""
        """Newest error that the process printed; empty: none."""
        self._lines = threading.Thread(target=self._read_lines, daemon=True)
        self._lines.start()
        for work in (self._watch, self._wait):
            threading.Thread(target=work, daemon=True).start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def join(self, timeout_s: float) -> bool:
        """Wait for the end of the process; return whether it has ended."""
        return self._over.wait(timeout_s)

    def end(self) -> None:
        """Request a clean end of the process: the robot stops, then the log is closed."""
        if not self._over.is_set():
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGINT)

    def stop(self) -> Stopped:
        """Stop the robot and latch the stop; wait for its confirmation."""
        try:
            found = stop_port(self.target.port, self.target.node, self.target.how)
        except BridgeError as error:
            found = self._stop_again(error)
        confirmed = bool(found["confirmed"])
        text = "confirmed by the device" if confirmed else str(found["ending"])
        self.stopped = Stopped(confirmed, text)
        return self.stopped

    def _stop_again(self, error: BridgeError) -> dict[str, Any]:
        """End the process and stop the robot again.

        The process may have opened the port, but not yet its socket.
        """
        if self._over.is_set():
            return {"confirmed": False, "ending": str(error)}
        self.end()
        if not self.join(_END_S):
            self._process.kill()
            self.join(_END_S)
        try:
            return stop_port(self.target.port, self.target.node, self.target.how)
        except BridgeError as again:
            return {"confirmed": False, "ending": str(again)}

    # ---- threads

    def _read_lines(self) -> None:
        assert self._process.stderr is not None  # noqa: S101 - Popen was given PIPE
        with self._process.stderr as lines:
            for line in lines:
                text = line.rstrip()
                if not text:
                    continue
                is_error = text.startswith(_ERROR)
                text = text.removeprefix(_ERROR)
                if is_error:
                    self.last_error = text
                self._on_line(self.target.label, text, is_error=is_error)

    def _watch(self) -> None:
        while not self._over.is_set():
            with contextlib.suppress(BridgeError):  # not started yet, or ended
                for status in watch(self.target.port, hz=WATCH_HZ):
                    self.status = status
                    if self._over.is_set():
                        return
            clock.pause(_RETRY_S)

    def _wait(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - Popen was given PIPE
        with self._process.stdout as output:
            printed = output.read()
        code = self._process.wait()
        self._over.set()
        self._lines.join(_END_S)  # the last error may be the reason
        summary = None
        with contextlib.suppress(ValueError):
            summary = json.loads(printed)
        if not isinstance(summary, dict) or "outcome" not in summary:
            summary = None
        if code >= 0:
            reason = self.last_error if summary is None else str(summary.get("reason"))
            self.ended = Ended(code, reason, summary if "path_m" in (summary or {}) else None)
            return
        # The process was killed. The device stops by itself when its host is silent, but do not
        # rely on this.
        reason = f"its process was killed by signal {-code}"
        self._on_line(self.target.label, f"{reason}; stopping the robot", is_error=True)
        if self.stop().confirmed:
            self.ended = Ended(1, f"{reason}; the robot has confirmed a stop", None)
        else:
            self.ended = Ended(LOST_STATUS, f"{reason}; the robot did not confirm a stop", None)
