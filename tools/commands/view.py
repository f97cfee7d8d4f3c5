"""``sweepctl view``: a log in Rerun."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("view", epilog="Example:  sweepctl view runs/demo-simulated.mcap")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--save",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a Rerun recording (.rrd) instead of opening a window.",
)
@click.option(
    "--png",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw room, path and swept floor into a picture instead.",
)
@click.option(
    "--screenshot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Save what the window would show as a PNG; needs no display.",
)
def command(*, file: Path, save: Path | None, png: Path | None, screenshot: Path | None) -> int:
    """Open FILE in Rerun: the room with path and swept map, sensors, planner and link."""
    from bridge.record.reader import LogReader
    from tools.console import say

    LogReader(file)  # a file that is no log is told before a display that is missing

    if png is not None:
        from bridge.view.picture import draw_run

        say(f"wrote {draw_run(file, png)}")
        return 0
    if screenshot is not None:
        from bridge.view.screenshot import save_screenshot

        save_screenshot(file, screenshot)
        say(f"wrote {screenshot}")
        return 0
    from bridge.view.launch import open_viewer

    open_viewer(file, save=save)
    if save is not None:
        say(f"wrote {save}")
    return 0
