"""Stop of every robot on a port, without an owner and without a session.

A device obeys a stop from any sender at any time. The stop is sent as soon as the port is open and
repeated until the device confirms it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import NoDeviceError
from bridge.io import clock
from bridge.io.port_loop import serve
from bridge.io.ports import link_of
from bridge.session.stop_request import REPEAT_NS, StopEverything, StopRequest
from protocol.clock import HostNs

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort

__all__ = ["CONFIRM_S", "REPEAT_NS", "send_until_confirmed", "stop_device"]

CONFIRM_S = 3.0
"""Maximum wait for the confirmation, s."""


def stop_device(port: str, opened: Callable[[], BytePort], node: int | None = None) -> list[int]:
    """Latch a stop with cause ``operator`` on every device; return the nodes that confirmed it.

    Args:
        port: Name of the port.
        opened: Opens the port.
        node: Device whose confirmation is required; None: any device.

    Raises:
        PortError: the port cannot be opened, or is gone.
        NoDeviceError: a device on the port, or ``node``, has not confirmed the stop within
            :data:`CONFIRM_S`.

    """
    stop = StopEverything(link_of(port), node)
    handle = opened()
    try:
        send_until_confirmed(handle, stop, HostNs(clock.now() + round(CONFIRM_S * 1e9)))
    finally:
        handle.close()
    if stop.confirmed_by is None:
        others = f" (confirmed by node {_listed(stop.confirmed)})" if stop.confirmed else ""
        whose = f" from node {_listed(stop.missing)}" if stop.missing else ""
        raise NoDeviceError(
            f"{port}: no confirmation of the stop{whose} within {CONFIRM_S:g} s{others}; "
            "switch the robot off"
        )
    return stop.confirmed


def _listed(nodes: list[int]) -> str:
    return ", ".join(map(str, nodes))


def send_until_confirmed(
    port: BytePort,
    stop: StopRequest,
    end_ns: HostNs,
    sent: Callable[[bytes, HostNs], None] = lambda _data, _now_ns: None,
) -> None:
    """Repeat a stop on an open port until it is confirmed, or until ``end_ns``.

    ``sent`` is called with the written bytes and the time.

    Raises:
        PortError: the port is gone.

    """
    serve(port, stop, end_ns, lambda: stop.confirmed_by is not None, sent)
