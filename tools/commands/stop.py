"""``sweepctl stop``: stop a robot from any shell."""

from __future__ import annotations

from typing import cast

import click

from tools.cli import options
from tools.cli.console import flush, inform, print_error, write_json
from tools.cli.interrupt import set_done
from tools.cli.port_options import port_argument


@click.command("stop", epilog="Example:  sweepctl stop /dev/ttyUSB0")
@port_argument
@options.port_options
@options.json_option
def command(*, port: str, as_json: bool, node: int | None, **how: object) -> int:
    """Stop the robot on PORT at once and latch the stop.

    If another sweepctl has the port open, it stops the robot and ends its run. Otherwise the port
    is opened and the stop is sent until every device that answers confirms it. On a bus every
    robot is stopped; with --node that robot must confirm it too. The robot moves again only with
    --clear-stop.

    Exit status: 0 the device has confirmed the stop; 3 it has not, even after Ctrl-C.
    """
    from tools.cli.stopping import stop_port

    found = stop_port(port, node, how)
    if as_json:
        write_json(found)
        flush()
    if found["confirmed"]:
        set_done()  # Ctrl-C does not change the result any more
    if not found["confirmed"]:
        print_error(
            f"{port}: the device has not confirmed the stop; switch the robot off (the run of the "
            f"port's owner ended: {found['ending']})"
        )
        return 3
    nodes = cast("list[int]", found.get("nodes", []))
    whose = "the device"
    if len(nodes) > 1 or port.startswith("can:"):
        listed = ", ".join(map(str, nodes or [found["node"]]))
        whose = f"nodes {listed}" if len(nodes) > 1 else f"node {listed}"
    inform(f"{port}: stopped, confirmed by {whose}")
    return 0
