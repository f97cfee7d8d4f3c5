"""``--on EVENT COMMAND``: commands that a run starts at its events."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from typing import TYPE_CHECKING, Any, BinaryIO, Self

import click

from bridge.io import clock
from tools.cli.visible_text import shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import TracebackType

    from bridge.run.notices import Notice

EVENTS = ("finished", "stopped-for-safety", "battery-low", "device-lost")
"""Values of :class:`bridge.run.notices.NoticeKind`, which is imported only by a run."""
MAX_WAITING = 16
"""Maximum number of commands that wait; further commands are dropped."""
MAX_RUN_S = 10.0
"""Maximum time of one command, s. After this time the command is killed."""
MAX_END_S = 20.0
"""Maximum time for all remaining commands at the end of a run, s."""
_POLL_S = 0.2
"""Interval at which the end of the run is checked while a command runs, s."""
_KEPT_BYTES = 1000
"""Number of bytes at the end of a command's output that are searched for its last line."""

Commands = tuple[tuple[str, str], ...]
"""Pairs of an event and a command line."""


def on_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--on``, which may be repeated."""
    return click.option(
        "--on",
        "on_events",
        type=(click.Choice(EVENTS), str),
        multiple=True,
        metavar="EVENT COMMAND",
        shell_complete=_complete_event,
        help="Run a shell command at each EVENT (finished, stopped-for-safety, battery-low, "
        "device-lost), with the event as JSON on its standard input; may be repeated.",
    )(f)


def _complete_event(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    return [name for name in EVENTS if name.startswith(incomplete)]


class EventCommands:
    """Runs the commands of ``--on`` one after the other in a separate thread.

    A context manager: its end waits for the commands, for at most :data:`MAX_END_S`.
    """

    def __init__(
        self,
        commands: Commands,
        facts: dict[str, Any],
        report: Callable[[str], None],
        *,
        max_run_s: float = MAX_RUN_S,
        max_end_s: float = MAX_END_S,
    ) -> None:
        """Prepare; the thread starts with the first event.

        Args:
            commands: event and command line of each.
            facts: keys of the run for every event: port and log.
            report: called in any thread with a line about a command that failed.
            max_run_s: maximum time of one command, s.
            max_end_s: maximum time for all remaining commands at the end, s.

        """
        self._commands = commands
        self._facts = facts
        self._report = report
        self._max_run_s, self._max_end_s = max_run_s, max_end_s
        self._waiting: queue.Queue[tuple[str, Notice] | None] = queue.Queue(MAX_WAITING)
        self._dropped = 0
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait for the commands; kill and report the commands that have not ended in time."""
        thread = self._thread
        if thread is None:
            return
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=self._max_end_s)
        thread.join(self._max_end_s)
        self._ended.set()
        thread.join(1.0)
        left = [each for each in self._take_all() if each is not None]
        self._dropped += len(left)
        if self._dropped:
            self._report(f"--on: {self._dropped} commands were dropped: too many at a time")

    def notify(self, notice: Notice) -> None:
        """Start the commands of an event; never waits."""
        for event, command in self._commands:
            if event != notice.kind:
                continue
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="on", daemon=True)
                self._thread.start()
            try:
                self._waiting.put_nowait((command, notice))
            except queue.Full:
                self._dropped += 1

    def _take_all(self) -> Iterable[tuple[str, Notice] | None]:
        with contextlib.suppress(queue.Empty):
            while True:
                yield self._waiting.get_nowait()

    def _work(self) -> None:
        while not self._ended.is_set():
            item = self._waiting.get()
            if item is None:
                return
            command, notice = item
            wrong = self._run(command, notice)
            if wrong is not None:
                self._report(f"--on {notice.kind}: {shortened(command)}: {wrong}")

    def _run(self, command: str, notice: Notice) -> str | None:
        """Run one command; return an error text, or None."""
        event = json.dumps({**self._facts, **notice.to_dict()}, default=str) + "\n"
        # Files instead of pipes, so that a command that does not read its input blocks nothing.
        with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as printed:
            given.write(event.encode())
            given.seek(0)
            try:
                process = subprocess.Popen(  # noqa: S602 - the user's own command line
                    command,
                    shell=True,
                    stdin=given,
                    stdout=subprocess.DEVNULL,
                    stderr=printed,
                    env={
                        **os.environ,
                        "SWEEPCTL_EVENT": notice.kind.value,
                        "SWEEPCTL_TEXT": notice.text,
                    },
                    start_new_session=True,  # Ctrl-C ends the run, not its commands
                )
            except (OSError, ValueError) as error:
                return str(error)
            status = self._wait(process)
            if status == 0:
                return None
            how = f"no end after {self._max_run_s:g} s; killed"
            if status is not None:
                how = f"exit status {status}" if status > 0 else f"ended by signal {-status}"
            last = _last_line(printed)
            return f"{how}: {last}" if last else how

    def _wait(self, process: subprocess.Popen[bytes]) -> int | None:
        """Wait for a command; kill it and return None if it takes too long."""
        end_ns = clock.now() + round(self._max_run_s * 1e9)
        while (left_s := (end_ns - clock.now()) / 1e9) > 0.0 and not self._ended.is_set():
            with contextlib.suppress(subprocess.TimeoutExpired):
                return process.wait(min(_POLL_S, left_s))
        _kill(process)
        process.wait()
        return None


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a command and the programs that it started."""
    if sys.platform == "win32":
        process.kill()
        return
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _last_line(printed: BinaryIO) -> str:
    printed.seek(0, os.SEEK_END)
    printed.seek(max(0, printed.tell() - _KEPT_BYTES))
    lines = printed.read().decode("utf-8", "replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
