"""A stop that is repeated until a device confirms it; needs no session. Sans-I/O.

A device obeys a stop from any sender at any time. A program without a session, or with a failed
loop, uses this one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.clock import HostNs
from protocol.link import NODE_ALL, LinkBase, Received
from protocol.messages.device import Ack
from protocol.messages.host import Stop
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from protocol.messages.values import StopCause

REPEAT_NS = 50_000_000
"""Interval of the repeated stop, ns: above an FTDI adapter's latency of 16 ms, so that a reply
arrives before the next stop leaves."""
_STOP = CATALOGUE.by_class[Stop].type_id


class StopRequest:
    """Sends a stop until :attr:`confirmed_by` is a node."""

    def __init__(
        self, link: type[LinkBase], cause: StopCause, command_id: int, node: int | None = None
    ) -> None:
        """Stop ``node``; None: every device on the port."""
        self.confirmed_by: int | None = None
        """Node of the device that confirmed the stop; None before that."""
        self._link = link(Direction.HOST)
        self._stop = Stop(command_id & 0xFFFF, cause)
        self._node = node
        self._due_ns = 0

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Return the stop's bytes if it is due, else no bytes."""
        if now_ns < self._due_ns:
            return b""
        self._due_ns = now_ns + REPEAT_NS
        node = NODE_ALL if self._node is None else self._node
        self._link.send(self._stop, now_ns // 1000, node=node)
        return self._link.data_to_send()

    def next_deadline(self) -> HostNs:
        """Return the time of the next repetition, ns."""
        return HostNs(self._due_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes from the port."""
        if not data:
            return
        for event in self._link.receive(data, now_ns // 1000):
            if isinstance(event, Received) and self._confirms(event):
                self.confirmed_by = event.frame.node

    def _confirms(self, event: Received) -> bool:
        message = event.message
        if not isinstance(message, Ack) or message.command_type != _STOP:
            return False
        return message.command_id == self._stop.command_id and (
            self._node in {None, event.frame.node}
        )
