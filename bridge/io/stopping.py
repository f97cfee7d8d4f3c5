"""Stopping a robot on a port that nobody owns: no session, only the stop itself.

A device obeys a stop from anyone at any time, so nothing is asked first: the stop goes out as
soon as the port is open, again and again until the device has said yes.
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
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort

__all__ = ["CONFIRM_S", "REPEAT_NS", "send_until_confirmed", "stop_device"]

CONFIRM_S = 3.0


def stop_device(port: str, opened: Callable[[], BytePort], node: int | None = None) -> int:
    """Latch a stop, cause ``operator``; gives the node that confirmed it.

    ``node`` stops one device; without it every device on the port is told.

    Raises:
        PortError: the port cannot be opened, or vanished.
        NoDeviceError: nobody has confirmed it within 3 s; it was sent 20 times a second.

    """
    stop = StopRequest(link_of(port), StopCause.OPERATOR, new_command_id(), node)
    handle = opened()
    try:
        send_until_confirmed(handle, stop, HostNs(clock.now() + round(CONFIRM_S * 1e9)))
    finally:
        handle.close()
    if stop.confirmed_by is None:
        raise NoDeviceError(
            f"{port}: nobody confirmed the stop within {CONFIRM_S:g} s; stop the robot by hand"
        )
    return stop.confirmed_by


def send_until_confirmed(
    port: BytePort,
    stop: StopRequest,
    end_ns: HostNs,
    sent: Callable[[bytes, HostNs], None] = lambda _data, _now_ns: None,
) -> None:
    """Repeat a stop on an open port until it is confirmed, or until this time.

    ``sent`` gets what was written, and when.

    Raises:
        PortError: the port has vanished.

    """
    serve(port, stop, end_ns, lambda: stop.confirmed_by is not None, sent)
