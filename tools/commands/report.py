"""``sweepctl report``: one run explained on one page."""

from __future__ import annotations

from pathlib import Path

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.paths import is_there


@click.command(
    "report", epilog="Example:  sweepctl report clean.mcap --out clean.html --png clean.png"
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Page to write.  [default: FILE with the ending .html; not written with --png "
    "alone if it exists]",
)
@click.option(
    "--png",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Also draw the page as one picture.",
)
@click.option("--force", is_flag=True, help="Replace output files that exist.")
@options.json_option
def command(*, file: Path, out: Path | None, png: Path | None, force: bool, as_json: bool) -> int:
    """Explain the run in FILE on one self-contained page.

    The page shows the run's settings, room and path, coverage over time, holes, energy, link and
    clock, faults and events, next to the paper's figures and the lower bound of the duration.
    """
    from bridge.convert.sources import readable
    from bridge.view.report.report import default_path, write_report
    from tools.cli.outputs import PAGE, PNG, check_format, check_outputs

    if not file.name:
        raise click.UsageError("FILE is empty")
    default = default_path(file)
    # Only the picture was asked for by name, and the page is there from before.
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
            inform(f"{default} was there and is left as it is; --force writes it anew")
    return 0
