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

import sweepctl_plugins
from tools.cli.console import flush, inform, print_error, write_json
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
        "fleet": "Run several robots at once: one dashboard, one STOP for all.",
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
        "robot": "Make, check and show robot files.",
        "config": "Show defaults and named robots of the configuration files.",
    },
    "Logs": {
        "runs": "List, select, tag and compare recorded runs.",
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
        "room": "Check, show and import rooms.",
    },
    "Firmware and shell": {
        "generate": "Generate C, DBC, Wireshark, protobuf or Markdown from the protocol.",
        "completion": "Print the completion script of a shell.",
    },
}
_COMMANDS = {name: text for section in _SECTIONS.values() for name, text in section.items()}


class LazyGroup(click.Group):
    """Group that imports a command's module only when the command is used.

    So ``sweepctl --help`` imports no command.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's interface
        """Return the names of the commands in the order of the help."""
        return [*_COMMANDS, *_plugged()]

    def get_command(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's interface
        cmd_name: str,
    ) -> click.Command | None:
        """Import and return the command of this name; None if there is none."""
        if cmd_name not in _COMMANDS:
            return _plugged_command(cmd_name)
        command = importlib.import_module(f"tools.commands.{cmd_name}").command
        assert isinstance(command, click.Command)  # noqa: S101 - every module has one
        return command

    def format_commands(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's interface
        formatter: click.HelpFormatter,
    ) -> None:
        """Write the sections of the help without importing a command."""
        width = max(map(len, _COMMANDS))
        for title, commands in _SECTIONS.items():
            with formatter.section(title):
                rows = [(name.ljust(width), text) for name, text in commands.items()]
                formatter.write_dl(rows)
        plugged = _plugged()
        if plugged:
            with formatter.section("Plug-ins"):
                formatter.write_dl(
                    [(name.ljust(width), f"Of package {p.package}.") for name, p in plugged.items()]
                )


def _plugged() -> dict[str, sweepctl_plugins.Plugin]:
    """Return the commands of plug-ins by name, from metadata without an import."""
    found = sweepctl_plugins.found("commands")
    return {name: plugin for name, plugin in found.items() if name not in _COMMANDS}


def _plugged_command(name: str) -> click.Command | None:
    """Import and return a plug-in's command; None if there is none.

    Raises:
        click.ClickException: the plug-in cannot be imported or is no command, or two packages
            use its name.

    """
    clash = sweepctl_plugins.clashes("commands").get(name)
    if clash is not None:
        raise click.ClickException(clash)
    plugin = _plugged().get(name)
    if plugin is None:
        return None
    try:
        command = sweepctl_plugins.load(plugin)
    except sweepctl_plugins.PluginError as error:
        raise click.ClickException(str(error)) from error
    if not isinstance(command, click.Command):
        raise click.ClickException(f"{plugin} is no click.Command")
    return command


@click.command(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example:  sweepctl simulate case-1 --planner paper",
)
@click.version_option(VERSION, prog_name="sweepctl")
def cli() -> None:
    """Drive, record and simulate a small sweeping robot.

    `sweepctl COMMAND --help` explains a command.
    """


_LIVE = {
    *("connect", "drive", "monitor", "bringup", "calibrate", "param", "key", "stop", "doctor"),
    *("emulate", "fleet", "replay", "simulate"),
}
"""Commands with a loop, a port or a log to close. Their output is queued, so that a reader that
does not read never blocks them."""

_STOP = "stop"
"""Command that succeeds only when the device has confirmed the stop, even after Ctrl-C."""
_UNTIL_ENDED = frozenset(
    {"connect", "drive", "fleet", "monitor", "emulate", "simulate", "replay", "view"},
)
"""Commands that run until a person ends them. Ctrl-C is their normal end: exit status 0."""
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals whose handlers a command may replace; Windows has no SIGHUP."""


def run(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit status.

    Args:
        arguments: words after ``sweepctl``; None: the arguments of this process.

    """
    given = sys.argv[1:] if arguments is None else arguments
    if _command_of(given) not in _LIVE:
        return _run(given)
    with QueuedOutput() as output, _unchanged_signals(is_process=arguments is None):
        status = _run(given)
    return status if output.error is None else _unwritten(output.error)


@contextlib.contextmanager
def _unchanged_signals(*, is_process: bool) -> Iterator[None]:
    """Restore the signal handlers afterwards, unless the command is the whole process.

    A run ignores signals while it ends, so that no signal interrupts its summary.
    """
    handlers = {} if is_process else {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            # ValueError: not the main thread. TypeError: the handler was not set by Python.
            with contextlib.suppress(ValueError, TypeError):
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
            print_error("interrupted")
            if not is_done():
                _write_outcome(arguments, "stopped", "interrupted before the run began", 0)
            return 0
        if command == _STOP:  # for a script, status 0 means that the robot has stopped
            text = "interrupted: the stop is not confirmed; check that the robot stands still"
            return _failed(arguments, text, 3)
        # click replaces the KeyboardInterrupt by its own exception.
        notes = getattr(error.__cause__ or error, "__notes__", ["the command was not done"])
        return _failed(arguments, f"interrupted: {'; '.join(notes)}", 1)
    except Exception as error:
        plugin = _plugged().get(_command_of(arguments) or "")
        if plugin is None:
            raise
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        return _failed(arguments, f"{plugin} raised {what}", 1)


def _command_of(arguments: list[str]) -> str | None:
    return next((word for word in arguments if not word.startswith("-")), None)


def _warned(  # noqa: PLR0913, PLR0917 - the library's interface
    message: Warning | str,
    category: type[Warning],  # noqa: ARG001 - the library's interface
    filename: str,  # noqa: ARG001 - the library's interface
    lineno: int,  # noqa: ARG001 - the library's interface
    file: TextIO | None = None,  # noqa: ARG001 - the library's interface
    line: str | None = None,  # noqa: ARG001 - the library's interface
) -> None:
    """Print a library's warning through our console, which escapes control characters."""
    inform(f"warning: {message}")


def _invoke(arguments: list[str]) -> int:
    from bridge.errors import BridgeError
    from tools.cli.remedies import error_line

    try:
        result: Any = cli.main(args=arguments, prog_name="sweepctl", standalone_mode=False)
        flush()  # so that a write error is reported here, not at the exit of the interpreter
    except click.ClickException as error:
        text = _usage_text(error)
        if text is None:
            error.show()
            return error.exit_code
        return _failed(arguments, text, error.exit_code)
    except BridgeError as error:
        return _failed(arguments, error_line(error), error.exit_status)
    except OSError as error:
        if error.filename is None and error.errno in _UNWRITTEN:
            return _unwritten(error)
        text = _unusable(error)
        if text is None:
            raise
        return _failed(arguments, text, 2 if error.errno == errno.ENAMETOOLONG else 1)
    return result if isinstance(result, int) else 0


_UNWRITTEN = {errno.EPIPE, errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""Error numbers by which a write to stdout fails."""


def _unwritten(error: OSError) -> int:
    """Print why stdout could not be written, and redirect stdout to /dev/null.

    Without the redirection the interpreter would try to write the remaining text at its exit.
    """
    if error.errno not in {errno.EPIPE, errno.EIO}:  # these two mean that the reader has left
        print_error(f"cannot write the output: {error.strerror}")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


def _usage_text(error: click.ClickException) -> str | None:
    """Return the error in the command line and the help command; None: no command was given."""
    text = error.format_message()
    if isinstance(error, click.exceptions.NoArgsIsHelpError):  # its text is the whole help
        return None
    context = error.ctx if isinstance(error, click.UsageError) else None
    return f"{text} (see {context.command_path} --help)" if context else text


def _unusable(error: OSError) -> str | None:
    """Return a text about the unusable path or working directory; None: another error."""
    if isinstance(error.filename, str | bytes):
        return f"cannot use {os.fsdecode(error.filename)}: {error.strerror}"
    try:
        Path.cwd()
    except OSError as gone:
        return f"the working directory cannot be used: {gone.strerror}"
    return None


def _failed(arguments: list[str], text: str, status: int) -> int:
    """Print why a command failed, with --json also as a JSON object, and return ``status``."""
    print_error(text)
    _write_outcome(arguments, "fault", shortened(text), status)
    return status


def _write_outcome(arguments: list[str], outcome: str, reason: str, status: int) -> None:
    """With --json, print the outcome of a command that has no other result."""
    if "--json" in arguments:
        write_json({"outcome": outcome, "reason": reason, "exit_status": status})


def _nowhere() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def main() -> None:
    """Entry point."""
    # Imports create tens of thousands of objects that exist until the end. With the default
    # thresholds the garbage collector would scan them many times: a tenth of the time of a short
    # command.
    gc.set_threshold(50_000, 20, 20)
    # If the parent process closed stdout or stderr, a log must not get their descriptor.
    sys.stdout = sys.stdout or _nowhere()
    sys.stderr = sys.stderr or _nowhere()
    for stream in (sys.stdout, sys.stderr):
        # An encoding without "m²" prints a question mark instead of a traceback.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        status = run()
    except KeyboardInterrupt:  # a second Ctrl-C while the first one was handled
        status = 0 if is_done() or _command_of(sys.argv[1:]) in _UNTIL_ENDED else 1
    if signal.getsignal(signal.SIGINT) in {signal.default_int_handler, interrupted}:
        # From here on a Ctrl-C may end the process at once, because the cleanup is done.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.freeze()  # the interpreter then skips its scan at the exit, which takes 0.1 s
    sys.exit(status)
