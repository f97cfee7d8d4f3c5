"""``sweepctl generate``: the protocol in other languages."""

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
    help="Output folder; created if it does not exist.",
)
@click.option(
    "--node",
    type=click.IntRange(1, 15),
    help="With dbc: node number of the device.  [default: 1]",
)
@click.option("--force", is_flag=True, help="Replace existing files.")
def command(*, what: str, out: Path, node: int | None, force: bool) -> int:
    """Generate code or documentation from the declaration of the protocol.

    \b
    c      header and source in C99, for firmware
    dbc    CAN database, for cantools, SavvyCAN and others
    lua    Wireshark dissector
    proto  protobuf declarations of the messages in a log
    md     specification: wire format, states, timing
    """  # noqa: D301 - click keeps the lines of a block behind \b
    from protocol.generate import render

    if node is not None and what not in PER_NODE:
        raise click.UsageError("--node needs dbc: the other formats do not depend on the node")
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
