"""``sweepctl recover``: save the intact parts of a damaged log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.log_file import LogPath
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path


@click.command("recover", epilog="Example:  sweepctl recover cut.mcap --out whole.mcap")
@click.argument("file", type=LogPath())
@click.option(
    "--out",
    required=True,
    type=PathName(dir_okay=False),
    help="File to write; FILE itself is never changed.",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.json_option
def command(*, file: Path, out: Path, force: bool, as_json: bool) -> int:
    """Copy the intact parts of a damaged FILE to a new file with an index.

    FILE is an MCAP file of any program. Damaged chunks are left out, and what they contained is
    reported.
    """
    from bridge.convert.recover import recover
    from bridge.record.family import parts_of
    from tools.cli.outputs import LOG, check_format

    check_format("--out", out, *LOG)
    result = recover(file, out, force=force)
    others = parts_of(file)[1:]
    if others:
        names = ", ".join(part.name for part in others)
        inform(f"the run continues in {names}: recover each file separately")
    for loss in result.losses:
        inform(f"lost: {loss.text()}")
    if result.files > 1:
        inform(f"{file} consists of {result.files} joined files: {out} contains all of them")
    if result.stub_schemas:
        inform(f"lost schemas: {result.stub_schemas}, replaced by lost_schema_<number>")
    if result.undeclared:
        inform(
            f"messages of channels without a name: {result.undeclared}, in /undeclared/<channel>"
        )
    if result.rescued:
        inform(f"messages recovered from a truncated chunk: {result.rescued}")
    if as_json:
        write_json(result.as_json())
    else:
        end = "" if result.whole else " (the end was missing or damaged)"
        inform(f"wrote {out}: {result.messages} messages in {result.chunks} chunks{end}")
    return 0
