"""Stop of a robot on a port without an owner and without a session.

A device obeys a stop from any sender at any time. The stop is sent as soon as the port is open and
repeated until the device confirms it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.errors import NoDeviceError
from bridge.io import clock
from bridge.io.identifiers import new_command_id
from bridge.io.port_loop import serve
from bridge.io.ports import link_of
from bridge.session.stop_request import REPEAT_NS, StopRequest
from protocol.clock import HostNs
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort

__all__ = ["CONFIRM_S", "REPEAT_NS", "send_until_confirmed", "stop_device"]

CONFIRM_S = 3.0
"""Maximum wait for the confirmation, s."""


def stop_device(port: str, opened: Callable[[], BytePort], node: int | None = None) -> int:
    """Latch a stop with cause ``operator``; return the node that confirmed it.

    Args:
        port: Name of the port.
        opened: Opens the port.
        node: Device to stop; None: every device on the port.

    Raises:
        PortError: the port cannot be opened, or is gone.
        NoDeviceError: no confirmation within :data:`CONFIRM_S`.

    """
    stop = StopRequest(link_of(port), StopCause.OPERATOR, new_command_id(), node)
    handle = opened()
    try:
        send_until_confirmed(handle, stop, HostNs(clock.now() + round(CONFIRM_S * 1e9)))
    finally:
        handle.close()
    if stop.confirmed_by is None:
        raise NoDeviceError(
            f"{port}: no confirmation of the stop within {CONFIRM_S:g} s; switch the robot off"
        )
    return stop.confirmed_by


def send_until_confirmed(
    port: BytePort,
    stop: StopRequest,
    end_ns: HostNs,
    sent: Callable[[bytes, HostNs], None] = lambda _data, _now_ns: None,
) -> None:
    """Repeat a stop on an open port until it is confirmed, or until ``end_ns``.

    ``sent`` gets the bytes written and the time.

    Raises:
        PortError: the port is gone.

    """
    serve(port, stop, end_ns, lambda: stop.confirmed_by is not None, sent)
