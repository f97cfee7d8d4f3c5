"""The stop of a robot on a port, through the port's owner or directly."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def stop_port(port: str, node: int | None, how: Mapping[str, Any]) -> dict[str, Any]:
    """Stop every robot on a port; return the confirmation as in ``stop --json``.

    If another process has the port open, that process stops the robot and ends its run. Otherwise
    this function opens the port and sends the stop.

    Args:
        port: name of the port.
        node: device that must confirm the stop; None: every detected device.
        how: options with which the port is opened.

    Raises:
        PortError: the port cannot be opened.
        NoDeviceError: a device has not confirmed the stop.

    """
    from bridge.errors import BridgeError, NoDeviceError, NoOwnerError, PortError
    from bridge.io.owner_client import ask
    from bridge.io.reopening import Opener, PortOptions
    from bridge.io.stopping import stop_device

    def by_wire() -> dict[str, Any]:
        nodes = stop_device(port, Opener(port, PortOptions(**how)), node)
        first = node if node is not None else nodes[0]
        return {"by": "wire", "confirmed": True, "node": first, "nodes": nodes}

    found: dict[str, Any]
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
        is_another = node not in {None, found.get("node")}
        if is_another or not found["confirmed"]:
            with contextlib.suppress(PortError):  # the owner's answer is returned
                return {"port": port, **by_wire()}
        if is_another:
            owner = f"; its owner has stopped node {found['node']}" if found["confirmed"] else ""
            raise NoDeviceError(f"{port}: node {node} has not confirmed the stop{owner}")
    return {"port": port, **found}
