"""``sweepctl stop``: stop a robot from any shell."""

from __future__ import annotations

import contextlib
from typing import cast

import click

from tools.cli import options
from tools.cli.console import complain, inform, write_json
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
    from bridge.errors import BridgeError, NoOwnerError, PortError
    from bridge.io.owner_client import ask
    from bridge.io.reopening import Opener, PortOptions
    from bridge.io.stopping import stop_device

    def by_wire() -> dict[str, object]:
        opened = Opener(port, PortOptions(**how))  # type: ignore[arg-type]  # as declared there
        nodes = stop_device(port, opened, node)
        first = node if node is not None else nodes[0]
        return {"by": "wire", "confirmed": True, "node": first, "nodes": nodes}

    found: dict[str, object]
    try:
        found = {"by": "owner", **ask(port, {"do": "stop"})}
        del found["ok"]
    except NoOwnerError:
        found = by_wire()
    except BridgeError as rejection:  # the owner's run may have ended, so the port may be free
        try:
            found = by_wire()
        except PortError as error:
            text = f"{port}: the process that owns it did not stop the robot ({rejection}); {error}"
            raise PortError(text) from None
    else:
        if not found["confirmed"]:
            with contextlib.suppress(PortError):  # the owner's answer is printed below
                found = by_wire()
    found = {"port": port, **found}
    if as_json:
        write_json(found)
    if not found["confirmed"]:
        complain(f"{port}: {found['ending']}")
        return 3
    nodes = cast("list[int]", found.get("nodes", []))
    several = f"nodes {', '.join(map(str, nodes))}" if len(nodes) > 1 else "the device"
    inform(f"{port}: stopped, confirmed by {several}")
    return 0
