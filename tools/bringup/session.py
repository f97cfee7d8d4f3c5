"""Shared code of bring-up and calibration: the session on a port, and prompts at the terminal."""

from __future__ import annotations

import contextlib
import functools
import math
import sys
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from bridge.errors import (
    CommandRejectedError,
    IncompatibleError,
    PortError,
    StoppedForSafetyError,
)
from bridge.io.identifiers import new_session_id
from tools.cli.cautions import caution_lines
from tools.cli.console import ask, inform
from tools.cli.paths import PathName
from tools.cli.signals import until_signalled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from bridge.bringup.port import BringupPort
    from bridge.bringup.recorded import BringupRecords
    from bridge.bringup.session import BringupSession
    from bridge.bringup.wiring import CheckResult
    from bridge.motion.robot_model import RobotModel
    from tools.cli.port_options import PortAsked

_LONG_S = 1e6
"""Maximum time to wait for an answer, s: practically no limit."""


@contextlib.contextmanager
def bringup_session(
    asked: PortAsked, log: BringupLog | None, model: RobotModel, robot_toml: str
) -> Iterator[BringupSession]:
    """Open a session with the device on a port; the end of the session stops the robot.

    Ctrl-C ends the session. Cautions about the robot are printed first. Errors of the device or its
    link name the port.

    Args:
        asked: port and its options.
        log: file for the bytes of the link and all printed lines; None: no log.
        model: robot model, for the log.
        robot_toml: text of the robot file, for the log.

    Raises:
        PortError: the port cannot be opened, or no device answers.
        IncompatibleError: the device is incompatible.
        OutputExistsError: the log exists, and ``--force`` is not given.
        LogWriteError: the log cannot be written.

    """
    from bridge.bringup.session import BringupSession
    from bridge.io.real_time_port import RealTimePort

    key = asked.key
    for line in caution_lines(model, None):
        inform(line)
    with contextlib.ExitStack() as stack:
        stack.enter_context(_named(asked.name))
        wire = RealTimePort(asked.open())
        stack.callback(wire.close)
        records = None
        if log is not None:
            records = stack.enter_context(_recorded(wire, asked.name, log, model, robot_toml))
        session = BringupSession(
            wire,
            new_session_id,
            node=asked.node,
            key=key,
            records=records,
        )
        with until_signalled(session.interrupt), session:
            yield session


@contextlib.contextmanager
def _named(port: str) -> Iterator[None]:
    """Prefix errors of the device or its link with the port, unless the text names the port."""
    try:
        yield
    except (PortError, IncompatibleError, CommandRejectedError, StoppedForSafetyError) as error:
        if port not in error.bare:
            error.args = (f"{port}: {error.bare}",)
        raise


@dataclass(frozen=True, slots=True)
class BringupLog:
    """Where to record a bring-up or calibration."""

    path: Path
    force: bool
    """Replace an existing file."""
    command: str
    """Name of the command, for the log's metadata."""


@contextlib.contextmanager
def _recorded(
    wire: BringupPort, port: str, log: BringupLog, model: RobotModel, robot_toml: str
) -> Iterator[BringupRecords]:
    """Record the traffic of ``wire`` to a log file."""
    from bridge.bringup.recorded import BringupRecords
    from bridge.io import clock
    from bridge.record.policy import RecordOptions, open_log
    from bridge.record.recorder import ThreadedRecorder
    from bridge.session.records import RunInfo
    from tools.version import VERSION

    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    extra = {"command": log.command}
    info = RunInfo(port, "", None, VERSION, opened_ns, offset_ns, model, robot_toml, None, extra)
    # In its own thread, because a slow disk must not delay the command that stops a wheel.
    recorder = ThreadedRecorder(open_log(log.path, info, RecordOptions(), force=log.force))
    records = BringupRecords(wire, recorder, offset_ns)
    try:
        yield records
    finally:
        records.closed()
        recorder.close(None)
        inform(f"recorded in {log.path}" if recorder.error is None else str(recorder.error))


def log_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--log`` and ``--force``; the command gets one ``log: BringupLog | None``."""

    @functools.wraps(f)
    def gathered(**given: Any) -> object:  # noqa: ANN401 - click's values
        path, force = given.pop("log"), given.pop("force")
        command = click.get_current_context().command_path.partition(" ")[2]
        return f(log=None if path is None else BringupLog(path, force, command), **given)

    made = click.option("--force", is_flag=True, help="Replace output files that exist.")(gathered)
    return click.option(
        "--log",
        type=PathName(dir_okay=False),
        help="Log file (MCAP) for all traffic and findings.",
    )(made)


class Terminal:
    """Prompts at this terminal; the session with the device continues during a prompt."""

    def __init__(self, session: BringupSession, *, yes: bool = False) -> None:
        """Prompt on stderr and read from stdin; ``yes`` confirms every question."""
        self._session, self._yes = session, yes
        self._source = sys.stdin

    def show(self, text: str) -> None:
        """Print a line."""
        self._print(text, None)

    def report(self, finding: CheckResult) -> None:
        """Print a finding: green if correct, red if wrong, yellow if skipped."""
        self._print(finding.line, {True: "green", False: "red", None: "yellow"}[finding.ok])

    def _print(self, text: str, colour: str | None) -> None:
        self._session.record_line(text)
        inform(text, style=colour)

    def confirm(self, text: str) -> bool:
        """Ask a yes-or-no question; the end of the input counts as no."""
        if self._yes:
            self.show(f"{text} yes (--yes)")
            return True
        while True:
            answer = self._line(f"{text} [y/n] ")
            if answer is None or answer.lower() in {"n", "no"}:
                return False
            if answer.lower() in {"y", "yes"}:
                return True

    def choose(self, text: str, answers: Mapping[str, str]) -> str:
        """Ask for one of the keys of ``answers``; the end of the input counts as the last key."""
        self.show(text)
        for key, meaning in answers.items():
            self.show(f"  {key:3} {meaning}")
        while True:
            answer = self._line("> ")
            if answer is None:
                return list(answers)[-1]
            if answer.lower() in answers:
                return answer.lower()

    def number(self, text: str) -> float:
        """Ask for a number.

        Raises:
            click.UsageError: the input ended.

        """
        while True:
            answer = self._line(f"{text}: ")
            if answer is None:
                raise click.UsageError(f"no answer to: {text}")
            with contextlib.suppress(ValueError):
                value = float(answer)
                if math.isfinite(value):
                    return value

    def _line(self, prompt: str) -> str | None:
        """Return a stripped line of input; None at the end of the input.

        The session with the device continues while the user types.
        """
        ask(prompt)
        answers: list[str] = []
        done = threading.Event()

        def read() -> None:
            try:
                answers.append(self._source.readline())
            except (OSError, ValueError):  # the terminal was closed
                answers.append("")
            done.set()

        threading.Thread(target=read, name="answer", daemon=True).start()
        self._session.run(_LONG_S, done.is_set)
        return answers[0].strip() if answers[0] else None


def clear_stop_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--clear-stop``."""
    return click.option(
        "--clear-stop",
        is_flag=True,
        help="Clear a latched safety stop first. Look at the robot before you do.",
    )(f)
