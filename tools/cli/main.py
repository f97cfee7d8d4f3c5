"""The ``sweepctl`` command: parse, call, print."""

from __future__ import annotations

import contextlib
import errno
import gc
import importlib
import io
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from tools.cli.console import complain, flush, inform, write_json
from tools.cli.interrupt import interrupted, is_done, set_done
from tools.cli.output_queue import QueuedOutput
from tools.cli.visible_text import shortened
from tools.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

_SECTIONS = {
    "Run a robot": {
        "connect": "Open a robot's port, show it and record it; moves nothing unless asked.",
        "drive": "Drive by keyboard or gamepad with a dead-man switch: the robot moves.",
        "stop": "Stop a robot from any shell, whichever process has its port.",
        "ports": "List the ports on which a robot may be.",
        "monitor": "Show the traffic on a port, decoded; sends nothing.",
    },
    "Set up a robot": {
        "bringup": "Check a robot's wiring step by step, wheels off the floor.",
        "calibrate": "Calibrate gyro, odometry and range sensors.",
        "param": "Read and change a device's parameters.",
        "key": "Set or remove the key that authenticates motion commands.",
        "reboot": "Reboot a device and wait until it is back.",
    },
    "Logs": {
        "info": "Show what a log contains.",
        "view": "Open a log in Rerun.",
        "report": "Explain a run on one page.",
        "diff": "Compare two runs.",
        "doctor": "Diagnose a port or a log, and say what to do.",
        "export": "Write a log's topics as Parquet or CSV tables.",
        "recover": "Save the intact parts of a damaged log.",
        "replay": "Play a log in the viewer, or as a robot on a port.",
    },
    "Simulate": {
        "simulate": "Run a planner against the virtual sweeper in virtual time.",
        "emulate": "Run a virtual sweeper on a port in real time.",
        "fault": "Switch faults of a running emulator on and off.",
        "experiment": "Reproduce the paper, or compare planners over rooms and seeds.",
    },
    "Firmware and shell": {
        "generate": "Generate C, DBC, Wireshark, protobuf or Markdown from the protocol.",
        "completion": "Print the completion script of a shell.",
    },
}
_COMMANDS = {name: text for section in _SECTIONS.values() for name, text in section.items()}


class LazyGroup(click.Group):
    """Imports a command's module only when it runs, so that help is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's interface
        """Names in the order of use."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of this name, imported now."""
        if cmd_name not in _COMMANDS:
            return None
        command = importlib.import_module(f"tools.commands.{cmd_name}").command
        assert isinstance(command, click.Command)  # noqa: S101 - every module has one
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing them."""
        width = max(map(len, _COMMANDS))
        for title, commands in _SECTIONS.items():
            with formatter.section(title):
                rows = [(name.ljust(width), text) for name, text in commands.items()]
                formatter.write_dl(rows)


@click.command(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example:  sweepctl simulate case-1 --planner paper",
)
@click.version_option(VERSION, prog_name="sweepctl")
def cli() -> None:
    """Drive, record and simulate a small sweeping robot."""


_LIVE = {
    *("connect", "drive", "monitor", "bringup", "calibrate", "param", "key", "stop", "doctor"),
    *("emulate", "replay", "simulate"),
}
"""Commands with a loop, a port or a log to close: they never wait for who reads their output."""


_STOP = "stop"
"""Command that is not done before the device has confirmed it, Ctrl-C or not."""
_UNTIL_ENDED = frozenset(
    {"connect", "drive", "monitor", "emulate", "simulate", "replay", "view"},
)
"""Commands that run until somebody ends them: there Ctrl-C leaves nothing undone."""
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


def run(arguments: list[str] | None = None) -> int:
    """Run the command line; its exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    if _command_of(given) not in _LIVE:
        return _run(given)
    with QueuedOutput() as output, _unchanged_signals(is_process=arguments is None):
        status = _run(given)
    return status if output.error is None else _unwritten(output.error)


@contextlib.contextmanager
def _unchanged_signals(*, is_process: bool) -> Iterator[None]:
    """Undo what a command did to signals, but where it is the whole of a process.

    A run leaves them ignored as it ends, so that nothing cuts off its summary.
    """
    handlers = {} if is_process else {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            with contextlib.suppress(ValueError, TypeError):  # of another thread, or not Python's
                signal.signal(number, handler)


def _run(arguments: list[str]) -> int:
    set_done(done=False)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warned
            return _invoke(arguments)
    except (click.Abort, KeyboardInterrupt) as error:
        command = _command_of(arguments)
        if command in _UNTIL_ENDED or command is None or is_done():
            complain("interrupted")
            return 0
        if command == _STOP:  # where a script asks for one, 0 means that it stands
            text = "interrupted: no stop is confirmed; see that the robot stands"
            return _failed(arguments, text, 3)
        # click puts an exception of its own in the place of the signal's.
        notes = getattr(error.__cause__ or error, "__notes__", ["it was not done yet"])
        return _failed(arguments, f"interrupted: {'; '.join(notes)}", 1)


def _command_of(arguments: list[str]) -> str | None:
    return next((word for word in arguments if not word.startswith("-")), None)


def _warned(  # noqa: PLR0913, PLR0917 - the library's interface
    message: Warning | str,
    category: type[Warning],  # noqa: ARG001 - as above
    filename: str,  # noqa: ARG001 - as above
    lineno: int,  # noqa: ARG001 - as above
    file: TextIO | None = None,  # noqa: ARG001 - as above
    line: str | None = None,  # noqa: ARG001 - as above
) -> None:
    """Print a library's warning as our own: it may quote a text from outside."""
    inform(f"warning: {message}")


def _invoke(arguments: list[str]) -> int:
    from bridge.errors import BridgeError
    from bridge.floor_plan.floor_plan import FloorPlanError
    from tools.cli.remedies import error_line

    try:
        result: Any = cli.main(args=arguments, prog_name="sweepctl", standalone_mode=False)
        flush()  # what cannot be written is reported now, not as the interpreter ends
    except click.ClickException as error:
        text = _usage_text(error)
        if text is None:
            error.show()
            return error.exit_code
        return _failed(arguments, text, error.exit_code)
    except (FloorPlanError, BridgeError) as error:
        status = error.exit_status if isinstance(error, BridgeError) else 2
        return _failed(arguments, error_line(error), status)
    except OSError as error:
        if error.filename is None and error.errno in _UNWRITTEN:
            return _unwritten(error)
        text = _unusable(error)
        if text is None:
            raise
        return _failed(arguments, text, 2 if error.errno == errno.ENAMETOOLONG else 1)
    return result if isinstance(result, int) else 0


_UNWRITTEN = {errno.EPIPE, errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""Errors of a write to stdout."""


def _unwritten(error: OSError) -> int:
    """Say why stdout could not be written; nothing is tried again as the interpreter ends."""
    if error.errno not in {errno.EPIPE, errno.EIO}:  # else its reader left: nobody is there to ask
        complain(f"cannot write the output: {error.strerror}")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


def _usage_text(error: click.ClickException) -> str | None:
    """What is wrong with the command line and where to read on; None: there is no command."""
    text = error.format_message()
    if isinstance(error, click.exceptions.NoArgsIsHelpError):  # the text is the whole help
        return None
    context = error.ctx if isinstance(error, click.UsageError) else None
    return f"{text} (see {context.command_path} --help)" if context else text


def _unusable(error: OSError) -> str | None:
    """Say which path cannot be used, or that there is no working directory; None: it is neither."""
    if isinstance(error.filename, str | bytes):
        return f"cannot use {os.fsdecode(error.filename)}: {error.strerror}"
    try:
        Path.cwd()
    except OSError as gone:
        return f"the working directory cannot be used: {gone.strerror}"
    return None


def _failed(arguments: list[str], text: str, status: int) -> int:
    """Say why a command did not do its work, with --json as its one object too."""
    complain(text)
    if "--json" in arguments:
        write_json({"outcome": "fault", "reason": shortened(text), "exit_status": status})
    return status


def _nowhere() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def main() -> None:
    """Entry point."""
    # Imports make tens of thousands of objects that stay: looking at them all again and again
    # is a tenth of a short command's time.
    gc.set_threshold(50_000, 20, 20)
    # Where whoever started us closed them, their numbers must not become a log's.
    sys.stdout = sys.stdout or _nowhere()
    sys.stderr = sys.stderr or _nowhere()
    for stream in (sys.stdout, sys.stderr):
        # A terminal, or a file's name, that knows no "m²": a mark in its place, no traceback.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        status = run()
    except KeyboardInterrupt:  # a second one, as the first was answered
        status = 0 if is_done() or _command_of(sys.argv[1:]) in _UNTIL_ENDED else 1
    if signal.getsignal(signal.SIGINT) in {signal.default_int_handler, interrupted}:
        # From here on Ctrl-C finds nothing that it could break off in order.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.freeze()  # the same when the interpreter ends: a tenth of a second of looking
    sys.exit(status)
