"""``sweepctl info``: show what a log contains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.console import plain_console, summary_table, write_json
from tools.cli.log_file import LogPath
from tools.cli.visible_text import one_line

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.record.info import RunDescription


@click.command("info", epilog="Example:  sweepctl info runs/demo-simulated.mcap")
@click.argument("file", type=LogPath())
@options.json_option
def command(*, file: Path, as_json: bool) -> int:
    """Show what FILE contains: the run, its topics and rates, and whether the file is complete.

    FILE is an MCAP file of any program, a `candump -l` log, or the raw bytes of a serial line. If a
    run was recorded into several files, give the first one.
    """
    from bridge.convert.sources import describe_any

    description = describe_any(file)
    if as_json:
        write_json(description.as_json())
        return 0
    _print(description)
    return 0


def _print(description: RunDescription) -> None:
    from rich.table import Table
    from rich.text import Text

    from bridge.record.summaries import is_run

    console = plain_console()
    console.print(Text(str(description.path), "bold"), end="  ")
    console.print(f"{description.file_bytes / 1e6:.2f} MB", end="  ")
    console.print(f"{description.duration_s:.1f} s, {description.message_count} messages")
    if description.format != "mcap":
        console.print(f"a {description.format} capture; the topics are its decoded messages")
    if not description.whole:
        lost = "incomplete: still being written, or its writer was killed; the intact part was read"
        console.print(lost, style="yellow")
    parts = description.parts
    if parts:
        console.print(f"the run has {len(parts)} files, {parts[0].name} to {parts[-1].name}")
    elif description.metadata.get("previous"):
        part = one_line(description.metadata.get("part", "?"))
        previous = one_line(description.metadata["previous"])
        console.print(f"file {part} of a run; the file before it is {previous}")
    for problem in description.problems:
        console.print(problem, style="yellow")
    for key in ("version", "port", "firmware", "uid", "boot_id", "planner", "seed", "noise"):
        if description.metadata.get(key):
            console.print(f"{key:<9}{one_line(description.metadata[key])}")
    if description.summary is not None and is_run(description.summary):
        console.print(summary_table({**description.summary, "log": None}))
    table = Table(box=None, header_style="dim")
    table.add_column("topic")
    table.add_column("messages", justify="right")
    table.add_column("rate", justify="right")
    table.add_column("bytes", justify="right")
    table.add_column("schema")
    for topic in sorted(description.topics, key=lambda t: t.topic):
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:.1f} Hz"
        table.add_row(topic.topic, str(topic.count), rate, str(topic.bytes), topic.schema)
    console.print(table)
