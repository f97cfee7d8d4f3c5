"""Stopping a robot on a port that nobody owns: no session, only the stop itself.

A device obeys a stop from anyone at any time, so nothing is asked first: the stop goes out as
soon as the port is open, again and again until the device has said yes.
"""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING

from bridge.errors import NoDeviceError
from bridge.io import clock
from bridge.io.ports import link_of
from protocol.catalogue import CATALOGUE
from protocol.link import NODE_ALL, Received
from protocol.message import Direction
from protocol.messages import Ack, Stop
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort

REPEAT_NS = 50_000_000
"""Above an FTDI adapter's 16 ms: an answer is heard before it is asked for again."""
CONFIRM_S = 3.0
_STOP = CATALOGUE.by_class[Stop].type_id


def stop_device(port: str, opened: Callable[[], BytePort], node: int | None = None) -> int:
    """Latch a stop, cause ``operator``; gives the node that confirmed it.

    ``node`` stops one device; without it every device on the port is told.

    Raises:
        PortError: the port cannot be opened, or vanished.
        NoDeviceError: nobody has confirmed it within 3 s; it was sent 20 times a second.

    """
    link = link_of(port)(Direction.HOST)
    stop = Stop(secrets.randbelow(0x1_0000), StopCause.OPERATOR)
    handle = opened()
    try:
        end_ns = clock.now() + round(CONFIRM_S * 1e9)
        due_ns, rest = 0, b""
        while (now_ns := clock.now()) < end_ns:
            if now_ns >= due_ns:
                due_ns = now_ns + REPEAT_NS
                link.send(stop, now_ns // 1000, node=NODE_ALL if node is None else node)
                rest = link.data_to_send()
            rest = rest[handle.write(rest) :]
            data = handle.wait((due_ns - now_ns) / 1e9)
            for event in link.receive(data, clock.now() // 1000) if data else ():
                if isinstance(event, Received) and _confirms(event, stop, node):
                    return event.frame.node
    finally:
        handle.close()
    raise NoDeviceError(
        f"{port}: nobody confirmed the stop within {CONFIRM_S:g} s; stop the robot by hand"
    )


def _confirms(event: Received, stop: Stop, node: int | None) -> bool:
    message = event.message
    if not isinstance(message, Ack) or message.command_type != _STOP:
        return False
    return message.command_id == stop.command_id and node in {None, event.frame.node}
