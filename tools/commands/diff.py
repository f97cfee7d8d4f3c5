"""``sweepctl diff``: compare two runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, plain_console, write_json
from tools.cli.log_file import LogPath
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path


class Limit(click.ParamType):  # type: ignore[type-arg]  # generic in the stubs only
    """Parameter type: a metric and a limit of its difference."""

    name = "metric=difference"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[str, float]:
        """Split the text into the metric's name and the number."""
        key, equals, text = str(value).partition("=")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not equals or math.isnan(number):
            self.fail(f"{value!r} is not METRIC=DIFFERENCE, such as path_m=0.5.", param, ctx)
        return key, number


@click.command(
    "diff",
    epilog="Example:  sweepctl diff before.mcap after.mcap --min coverage.mouth_sweepable=-0.01",
)
@click.argument("a", type=LogPath())
@click.argument("b", type=LogPath())
@click.option(
    "--out",
    type=PathName(dir_okay=False),
    help="Write a comparison with overlaid paths and curves: a page (.html) or a picture (.png).",
)
@click.option(
    "--min",
    "minimum",
    type=Limit(),
    multiple=True,
    metavar="METRIC=DIFFERENCE",
    help="End with status 1 if the difference of a metric is below this value. The names of the "
    "metrics are those of --json.",
)
@click.option(
    "--max",
    "maximum",
    type=Limit(),
    multiple=True,
    metavar="METRIC=DIFFERENCE",
    help="End with status 1 if the difference of a metric is above this value.",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.json_option
def command(  # noqa: PLR0913 - one parameter for each option
    *,
    a: Path,
    b: Path,
    out: Path | None,
    minimum: tuple[tuple[str, float], ...],
    maximum: tuple[tuple[str, float], ...],
    force: bool,
    as_json: bool,
) -> int:
    """Compare the figures of two runs, A and B.

    The difference is B minus A. For percentages it is in percentage points; with --json, --min and
    --max it is a fraction, like the values. Without --min and --max the exit status does not depend
    on the figures.
    """
    from bridge.convert.sources import readable
    from bridge.view.report.comparison import compare, rows, violations, write_page
    from bridge.view.report.run_data import load_run
    from tools.cli.outputs import PAGE, PNG, check_format, check_outputs

    check_outputs([out], [a, b], force=force)
    check_format("--out", out, *PAGE, *PNG)
    for option, limits in (("--min", minimum), ("--max", maximum)):
        if len(dict(limits)) < len(limits):
            raise click.UsageError(f"{option} is given twice for one metric: give one limit.")
    with readable(a) as first, readable(b) as second:
        runs = load_run(first), load_run(second)
        result = compare(*runs)
        difference = result["difference"]
        for key, _ in (*minimum, *maximum):
            if key not in difference:
                known = ", ".join(difference)
                raise click.UsageError(f"No metric {key!r}: the metrics are {known}.")
        if out is not None:
            write_page(*runs, out)
    found = violations(difference, dict(minimum), dict(maximum))
    result["a"]["log"], result["b"]["log"] = str(a), str(b)
    if as_json:
        write_json({**result, "out": str(out) if out else None, "violations": found})
    elif out is not None:
        inform(f"wrote {out}")
    else:
        _print_table(a, b, rows(*runs))
    if not as_json:
        for line in found:
            inform(line)
    return 1 if found else 0


def _print_table(a: Path, b: Path, lines: list[tuple[str, ...]]) -> None:
    from rich.table import Table

    table = Table(box=None, header_style="dim")
    table.add_column("")
    for name in (a.name, b.name, "difference"):
        table.add_column(name, justify="right")
    for line in lines:
        table.add_row(*line)
    plain_console().print(table)
