"""``sweepctl recover``: what can be saved of a damaged log."""

from __future__ import annotations

from pathlib import Path

import click

from tools.cli import options
from tools.cli.console import inform, write_json


@click.command("recover", epilog="Example:  sweepctl recover cut.mcap --out whole.mcap")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write; FILE itself is never changed.",
)
@click.option("--force", is_flag=True, help="Replace the output file if it exists.")
@options.json_option
def command(*, file: Path, out: Path, force: bool, as_json: bool) -> int:
    """Copy the intact parts of FILE to a new file with an index. FILE may come from any program.

    Damaged chunks are left out, and the command reports what they contained.
    """
    from bridge.convert.recover import recover
    from bridge.record.family import parts_of
    from tools.cli.outputs import LOG, check_format

    check_format("--out", out, *LOG)
    result = recover(file, out, force=force)
    others = parts_of(file)[1:]
    if others:
        inform(
            f"the run goes on in {', '.join(part.name for part in others)}: recover each by itself"
        )
    for loss in result.losses:
        inform(f"lost: {loss.text()}")
    if result.files > 1:
        inform(f"{file} is {result.files} files joined: all of them are in {out}")
    if result.stub_schemas:
        inform(f"{result.stub_schemas} schemas are lost: lost_schema_<number> stands for each")
    if result.undeclared:
        inform(
            f"{result.undeclared} messages have lost their channel's name: /undeclared/<channel>"
        )
    if result.rescued:
        inform(f"{result.rescued} messages were taken out of a chunk that was cut")
    if as_json:
        write_json(result.as_json())
    else:
        end = "" if result.whole else " (the end was missing or damaged)"
        inform(f"wrote {out}: {result.messages} messages in {result.chunks} chunks{end}")
    return 0
