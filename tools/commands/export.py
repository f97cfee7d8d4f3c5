"""``sweepctl export``: a log's topics as tables."""

from __future__ import annotations

from pathlib import Path

import click

from tools.cli import options
from tools.cli.console import complain, inform, write_line
from tools.cli.log_file import LogPath


@click.command(
    "export", epilog="Example:  sweepctl export clean.mcap --out clean/ --topic '/device/*'"
)
@click.argument("file", type=LogPath())
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the tables, one for each topic: /device/imu becomes device.imu.parquet.",
)
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="File format of the tables.",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="PATTERN",
    help="Export only topics that match, with * for anything; may be repeated.",
)
@click.option("--force", is_flag=True, help="Replace tables that exist.")
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    file: Path,
    out: Path,
    file_format: str,
    topics: tuple[str, ...],
    force: bool,
    as_json: bool,
) -> int:
    """Write each topic of FILE as a Parquet or CSV table.

    FILE is an MCAP file of any program, a `candump -l` log, or the raw bytes of a serial line;
    captures are decoded first. Times are UTC with nanoseconds. Columns have the names of the
    fields, with dots for nested messages.
    """
    from bridge.convert.export import as_json as exported_json
    from bridge.convert.export import export
    from bridge.convert.sources import readable

    try:
        with readable(file) as log:
            result = export(log, out, file_format=file_format, topics=topics, force=force)
    except KeyboardInterrupt:
        complain(f"interrupted: the tables in {out} are incomplete; repeat with --force")
        return 1
    for problem in result.problems:
        inform(problem)
    if as_json:
        write_line(exported_json(result))
    else:
        inform(f"wrote {result.messages} messages of {len(result.files)} topics to {out}")
    return 0
