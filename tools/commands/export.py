"""``sweepctl export``: a log's topics as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, print_error, write_json, write_line
from tools.cli.log_file import LogPath
from tools.cli.parallel_options import in_order, parallel_options, pool_of
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tools.cli.exporting import ExportJob


@click.command(
    "export", epilog="Example:  sweepctl export clean.mcap --out clean/ --topic '/device/*'"
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=LogPath())
@click.option(
    "--out",
    required=True,
    type=PathName(file_okay=False),
    help="Folder for the tables, one for each topic: /device/imu becomes device.imu.parquet. Of "
    "several logs each has a folder in it.",
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
@parallel_options
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    files: tuple[Path, ...],
    out: Path,
    file_format: str,
    topics: tuple[str, ...],
    force: bool,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> int:
    """Write each topic of FILE as a Parquet or CSV table.

    FILE is an MCAP file of any program, a `candump -l` log, or the raw bytes of a serial line;
    captures are decoded first. Times are UTC with nanoseconds. Columns have the names of the
    fields, with dots for nested messages. Several files are exported in parallel.
    """
    from bridge.convert.export import as_json as exported_json
    from tools.cli.exporting import export_file, export_jobs

    made = export_jobs(files, out, file_format, topics, force=force)
    try:
        if len(made) > 1:
            return _several(made, out, jobs, scheduler, as_json=as_json)
        if jobs is not None or scheduler is not None:
            raise click.UsageError("--jobs and --scheduler need several files")
        result = export_file(made[0])
    except KeyboardInterrupt:
        print_error(f"interrupted: the tables in {out} are incomplete; repeat with --force")
        return 1
    for problem in result.problems:
        inform(problem)
    if as_json:
        write_line(exported_json(result))
    else:
        inform(f"wrote {result.messages} messages of {len(result.files)} topics to {out}")
    return 0


def _several(
    made: Sequence[ExportJob], out: Path, jobs: int | None, scheduler: str | None, *, as_json: bool
) -> int:
    """Export several logs in parallel; a failure is reported, and the other exports continue."""
    from tools.cli.exporting import export_or_error

    total: dict[str, Any] = {"messages": 0, "files": {}, "problems": [], "failed": []}
    status = 0
    with pool_of(len(made), jobs, scheduler) as pool:
        for job, result in in_order(pool, export_or_error, made):
            if isinstance(result, tuple):
                line, failed_status = result
                status = max(status, failed_status)
                total["failed"].append(str(job.path))
                print_error(line)
                continue
            for problem in result.problems:
                inform(f"{job.path}: {problem}")
            total["messages"] += result.messages
            total["problems"] += [f"{job.path}: {problem}" for problem in result.problems]
            for topic, file in result.files.items():
                rows = result.rows.get(topic, 0)
                total["files"][f"{job.out.name}{topic}"] = {"file": str(file), "rows": rows}
    if as_json:
        write_json(total)
    else:
        done = len(made) - len(total["failed"])
        inform(f"wrote {total['messages']} messages of {done} logs to {out}")
    return status
