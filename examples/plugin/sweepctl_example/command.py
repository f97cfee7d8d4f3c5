"""A command: print the counts of a log's dust sensor."""

from __future__ import annotations

from pathlib import Path

import click

from bridge.library.library import resolve
from bridge.record.reader import LogReader


@click.command("dust", epilog="Example:  sweepctl dust clean.mcap")
@click.argument("file", type=click.Path(path_type=Path))
def command(*, file: Path) -> int:
    """Print how many particles the dust sensor of the run in FILE counted."""
    log = resolve(file)  # `latest` is the newest run
    counts = [m.decoded.particles for m in LogReader(log).messages({"/device/dust"})]
    if not counts:
        click.echo("no dust message", err=True)
        return 1
    click.echo(f"{max(counts) - min(counts)} particles in {len(counts)} messages")
    return 0
