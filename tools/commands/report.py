"""``sweepctl report``: explain a run on one page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.log_file import LogPath
from tools.cli.paths import PathName, is_there

if TYPE_CHECKING:
    from pathlib import Path


@click.command(
    "report", epilog="Example:  sweepctl report clean.mcap --out clean.html --png clean.png"
)
@click.argument("file", type=LogPath())
@click.option(
    "--out",
    type=PathName(dir_okay=False),
    help="Page to write.  [default: FILE with the suffix .html; not replaced if only --png is "
    "given]",
)
@click.option("--png", type=PathName(dir_okay=False), help="Also write a picture (.png).")
@click.option("--force", is_flag=True, help="Replace existing files.")
@options.json_option
def command(*, file: Path, out: Path | None, png: Path | None, force: bool, as_json: bool) -> int:
    """Explain the run in FILE on one self-contained HTML page.

    The page shows the setup, the room with the path, coverage over time, holes, energy, the link,
    the clock, faults and events. It compares the run with the paper and with the lower bound of the
    time.
    """
    from bridge.convert.sources import readable
    from bridge.view.report.report import default_path, write_report
    from tools.cli.outputs import PAGE, PNG, check_format, check_outputs

    if not file.name:
        raise click.UsageError("FILE is empty")
    default = default_path(file)
    # The page is not written if only the picture was requested and the page exists already.
    keeps = out is None and png is not None and is_there(default) and not force
    page = None if keeps else out or default
    check_outputs((page, png), [file], force=force)
    check_format("--out", out, *PAGE)
    check_format("--png", png, *PNG)
    with readable(file) as log:
        data = write_report(log, page, png=png, force=force)
    if as_json:
        result: dict[str, object] = {
            "report": None if page is None else str(page),
            "png": str(png) if png else None,
            "whole": data.whole,
        }
        result |= {"problems": data.problems, "events": len(data.happenings), "lost": data.lost}
        write_json(result)
    else:
        inform("wrote " + " and ".join(str(path) for path in (page, png) if path is not None))
        if keeps:
            inform(f"{default} exists and is unchanged; --force replaces it")
    return 0
