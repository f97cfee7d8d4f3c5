"""``sweepctl diff``: compare two runs."""

from __future__ import annotations

from pathlib import Path

import click

from tools.cli import options
from tools.cli.console import inform, plain_console, write_json
from tools.cli.log_file import LogPath


@click.command("diff", epilog="Example:  sweepctl diff before.mcap after.mcap --out both.html")
@click.argument("a", type=LogPath())
@click.argument("b", type=LogPath())
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a comparison with overlaid paths and curves: a page (.html) or a picture (.png).",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.json_option
def command(*, a: Path, b: Path, out: Path | None, force: bool, as_json: bool) -> int:
    """Compare the figures of two runs, A and B.

    The difference is B minus A. For percentages it is in percentage points; with --json it is a
    fraction, like the values.
    """
    from bridge.convert.sources import readable
    from bridge.view.report.comparison import compare, rows, write_page
    from bridge.view.report.run_data import load_run
    from tools.cli.outputs import PAGE, PNG, check_format, check_outputs

    check_outputs([out], [a, b], force=force)
    check_format("--out", out, *PAGE, *PNG)
    with readable(a) as first, readable(b) as second:
        if as_json or out is not None:
            result = (
                write_page(first, second, out, force=force)
                if out is not None
                else compare(load_run(first), load_run(second))
            )
            result["a"]["log"], result["b"]["log"] = str(a), str(b)
            if as_json:
                write_json({**result, "out": str(out) if out else None})
            else:
                inform(f"wrote {out}")
            return 0
        lines = rows(load_run(first), load_run(second))
    from rich.table import Table

    table = Table(box=None, header_style="dim")
    table.add_column("")
    for name in (a.name, b.name, "difference"):
        table.add_column(name, justify="right")
    for line in lines:
        table.add_row(*line)
    plain_console().print(table)
    return 0
