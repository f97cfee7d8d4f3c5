"""``sweepctl generate``: the wire's declaration in other languages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from protocol.generate import GENERATORS, PER_NODE
from tools.cli.console import complain, write_line
from tools.cli.outputs import check_outputs


@click.command("generate", epilog="Example:  sweepctl generate c --out firmware/wire")
@click.argument("what", type=click.Choice(list(GENERATORS)))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write to; created if missing.",
)
@click.option(
    "--node",
    type=click.IntRange(1, 15),
    help="With dbc: node id of the device.  [default: 1]",
)
@click.option("--force", is_flag=True, help="Replace files that exist.")
def command(*, what: str, out: Path, node: int | None, force: bool) -> int:
    """Write the protocol's messages for another language, a tool, or people.

    \b
    c      header and source in C99, for firmware
    dbc    CAN database, for cantools, SavvyCAN and others
    lua    Wireshark dissector
    proto  protobuf declarations of what a log holds
    md     description for people: bytes, states, timing
    """  # noqa: D301 - click's mark of a block that is kept as it is
    from protocol.generate import render

    if node is not None and what not in PER_NODE:
        raise click.UsageError("--node goes with dbc: only there does the text name a device")
    options: dict[str, Any] = {}
    if what == "md":
        from tools.dev.behaviour import wire_behaviour

        options["behaviour"] = wire_behaviour()
    files = render(what, node=node or 1, **options)
    check_outputs([out / name for name in files], (), force=force)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            path = out / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
            write_line(str(path))
    except OSError as error:
        complain(f"cannot write {error.filename or out}: {error.strerror}")
        return 1
    return 0
