"""Options of recording and live viewing."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.record.policy import RecordOptions

_MB = 1_000_000


def recording_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--fsync``, ``--rotate-mb``, ``--rotate-s`` and ``--on-log-error``."""
    f = click.option(
        "--on-log-error",
        type=click.Choice(["stop", "continue"]),
        default="stop",
        show_default=True,
        help="If the log cannot be written (such as on a full disk), stop the robot or continue.",
    )(f)
    f = click.option(
        "--rotate-s",
        type=options.Number(1.0, 1e6),
        help="Start a new log file after N seconds.",
        metavar="N",
    )(f)
    f = click.option(
        "--rotate-mb",
        type=options.Number(0.1, 1e6),
        help="Start a new log file (NAME-0002.mcap and so on) at N megabytes (10^6 bytes).",
        metavar="N",
    )(f)
    return click.option(
        "--fsync",
        is_flag=True,
        help="Flush the log to the disk as it is written, so that a power failure loses at most "
        "0.5 s.",
    )(f)


def no_record_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--no-record``."""
    text = "Write no log."
    return click.option("--no-record", is_flag=True, help=text)(f)


def check_unrecorded(
    no_record: bool,  # noqa: FBT001 - the name of the option
    out: Path | None,
    recording: RecordOptions,
    *,
    force: bool,
    views: bool,
) -> None:
    """With ``--no-record``, reject the options that need a log.

    Raises:
        click.UsageError: an option that needs a log was given.

    """
    from bridge.record.policy import RecordOptions

    if no_record and (out is not None or force or recording != RecordOptions()):
        raise click.UsageError("--no-record writes no log: omit the options of the log")
    if no_record and views:
        raise click.UsageError(
            "--view, --serve and --foxglove show the log of a run: omit --no-record"
        )


def viewing_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--view`` and ``--serve``."""
    f = click.option(
        "--serve",
        is_flag=True,
        help="Show the run live in a browser on this machine instead of a window.",
    )(f)
    return click.option("--view", is_flag=True, help="Show the run live in Rerun.")(f)


def record_options(
    *, fsync: bool, rotate_mb: float | None, rotate_s: float | None, on_log_error: str
) -> RecordOptions:
    """Return the recording options in the units of the recorder."""
    from bridge.record.policy import RecordOptions

    size = None if rotate_mb is None else round(rotate_mb * _MB)
    return RecordOptions(fsync, size, rotate_s, on_log_error == "stop")


def take_record_options(given: dict[str, Any]) -> RecordOptions:
    """Remove the recording options from a command's options and return them."""
    names = ("fsync", "rotate_mb", "rotate_s", "on_log_error")
    return record_options(**{name: given.pop(name) for name in names})


@contextlib.contextmanager
def live_view(log: Path | None, *, view: bool, serve: bool) -> Iterator[str]:
    """Run Rerun beside a run, with ``view`` or ``serve``; without both do nothing.

    Yields:
        The address of the page to open in a browser; empty without ``serve``.

    Raises:
        ViewerMissingError: Rerun is not installed.
        NoDisplayError: a window was requested and there is no display.
        ViewerFailedError: Rerun did not start.

    """
    if log is None or not (view or serve):
        yield ""
        return
    from bridge.view.rerun.live import LiveViewer

    viewer = LiveViewer(log, serve=serve)
    try:
        viewer.wait_started()
        if viewer.page:
            inform(f"live view: {viewer.page}")
        yield viewer.page
    finally:
        viewer.close()


def check_view(*, view: bool, serve: bool) -> None:
    """Check that the viewer can start, before the port is opened.

    Raises:
        ViewerMissingError: Rerun is not installed.
        NoDisplayError: a window was requested and there is no display.

    """
    if view or serve:
        from bridge.view.rerun.live import check

        check(serve=serve)
