"""``sweepctl view``: open a log in Rerun."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import click

from tools.cli.console import inform
from tools.cli.log_file import LogPath
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.record.reader import LogReader


@click.command("view", epilog="Example:  sweepctl view runs/demo-simulated.mcap")
@click.argument("file", type=LogPath())
@click.option(
    "--save",
    type=PathName(dir_okay=False),
    help="Write a Rerun recording (.rrd).",
)
@click.option(
    "--png",
    type=PathName(dir_okay=False),
    help="Write a picture of room, path and swept floor (.png).",
)
@click.option(
    "--screenshot",
    type=PathName(dir_okay=False),
    help="Write a picture of the Rerun window (.png); needs no display.",
)
@click.option(
    "--serve", is_flag=True, help="Show the log in a browser on this machine, until Ctrl-C."
)
@click.option("--force", is_flag=True, help="Replace existing files.")
def command(  # noqa: PLR0913 - one parameter per option
    *,
    file: Path,
    save: Path | None,
    png: Path | None,
    screenshot: Path | None,
    serve: bool,
    force: bool,
) -> int:
    """Open FILE in Rerun: room, path, swept floor, sensors, planner and link.

    FILE is a log, a `candump -l` log, or the raw bytes of a serial line. With --save, --png or
    --screenshot the files are written and no window opens.
    """
    from bridge.convert.sources import readable
    from bridge.record.reader import LogReader
    from tools.cli.outputs import PNG, RERUN, check_format, check_outputs

    with readable(file) as log:
        LogReader(log)  # a file that is no log is reported first, then a missing display
        check_outputs((save, png, screenshot), [file], force=force)
        check_format("--save", save, *RERUN)
        check_format("--png", png, *PNG)
        check_format("--screenshot", screenshot, *PNG)
        _write(log, save, png, screenshot)
        if serve:
            _serve(log)
        elif save is None and png is None and screenshot is None:
            from bridge.view.rerun.launch import open_viewer

            _warn(open_viewer(log))
    return 0


def _write(log: Path, save: Path | None, png: Path | None, screenshot: Path | None) -> None:
    if save is not None:
        from bridge.view.rerun.launch import open_viewer

        _warn(open_viewer(log, save=save))
        inform(f"wrote {save}")
    if png is not None:
        from bridge.view.report.picture import draw_run

        inform(f"wrote {draw_run(log, png, warn=inform)}")
    if screenshot is not None:
        from bridge.view.rerun.screenshot import save_screenshot

        _warn(save_screenshot(log, screenshot))
        inform(f"wrote {screenshot}")


def _warn(reader: LogReader) -> None:
    for problem in reader.problems:
        inform(problem)


def _serve(log: Path) -> None:
    """Serve the log to a browser until Ctrl-C."""
    from bridge.view.rerun.feeder import FeedOptions, feed
    from tools.cli.recording import check_view
    from tools.cli.signals import until_signalled

    check_view(view=False, serve=True)
    ended = threading.Event()
    with until_signalled(ended.set):
        feed(FeedOptions(log, serve=True, report=inform), ended.is_set)
