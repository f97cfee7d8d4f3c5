"""``sweepctl stop``: stop a robot from any shell."""

from __future__ import annotations

import contextlib

import click

from tools.cli import options
from tools.cli.console import complain, inform, write_json
from tools.cli.port_options import port_argument


@click.command("stop", epilog="Example:  sweepctl stop /dev/ttyUSB0")
@port_argument
@options.port_options
@options.json_option
def command(*, port: str, as_json: bool, node: int | None, **how: object) -> int:
    """Stop the robot on PORT at once, and latch the stop.

    If another sweepctl owns the port, it stops the robot and ends its run. Otherwise the command
    opens the port and sends the stop until the device confirms it. Without --node it stops every
    robot on a bus. The exit status is 3 if the stop is not confirmed, after Ctrl-C too. The robot
    moves again only with --clear-stop; check the robot first.
    """
    from bridge.errors import BridgeError, NoOwnerError, PortError
    from bridge.io.owner_client import ask
    from bridge.io.reopening import Opener, PortOptions
    from bridge.io.stopping import stop_device

    def by_wire() -> dict[str, object]:
        opened = Opener(port, PortOptions(**how))  # type: ignore[arg-type]  # as declared there
        return {"by": "wire", "confirmed": True, "node": stop_device(port, opened, node)}

    found: dict[str, object]
    try:
        found = {"by": "owner", **ask(port, {"do": "stop"})}
        del found["ok"]
    except NoOwnerError:
        found = by_wire()
    except BridgeError as rejection:  # its run may be over by now, and the port free
        try:
            found = by_wire()
        except PortError as error:
            raise PortError(f"{port}: its owner did not stop it ({rejection}); {error}") from None
    else:
        if not found["confirmed"]:
            with contextlib.suppress(PortError):  # what the owner told is told below
                found = by_wire()
    found = {"port": port, **found}
    if as_json:
        write_json(found)
    if not found["confirmed"]:
        complain(f"{port}: {found['ending']}")
        return 3
    inform(f"{port}: stopped; the device has confirmed it")
    return 0
