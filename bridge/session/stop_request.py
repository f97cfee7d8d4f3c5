"""Stops that are repeated until confirmed and need no session. Sans-I/O.

A device obeys a stop from any sender at any time. Programs use these classes if they have no
session or if their loop has failed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from protocol.clock import HostNs
from protocol.link import NODE_ALL, LinkBase, Medium, Received
from protocol.messages.device import Ack, Status
from protocol.messages.host import Stop, StopAll
from protocol.messages.values import StopCause
from protocol.retransmission import STOP_REPEAT_US
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from protocol.schema.message import Message

REPEAT_NS = STOP_REPEAT_US * 1000
"""Interval of the repeated stop, ns. It is longer than an FTDI adapter's latency of 16 ms, so that
a reply arrives before the next stop is sent."""
GATHER_NS = 200_000_000
"""Time to detect every device on a bus, ns. It is two periods of the slowest stream that a device
sends in every session. A device without a session stands still, and answers a stop at once."""
_STOP = CATALOGUE.by_class[Stop].type_id
_STATUS = CATALOGUE.by_class[Status].type_id
_LATCH_FIELDS = 2
"""Number of leading status fields that are read. Every later version of the status has these
fields."""


class StopRequest(ABC):
    """Sends a stop until it is confirmed."""

    def __init__(self, link: type[LinkBase], message: Message, node: int) -> None:
        self._link = link(Direction.HOST)
        self._message, self._node = message, node
        self._due_ns = 0

    @property
    @abstractmethod
    def confirmed_by(self) -> int | None:
        """Node of a device that confirmed the stop; None before it is confirmed."""

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Return the stop's bytes if it is due, else no bytes."""
        if now_ns < self._due_ns:
            return b""
        self._due_ns = now_ns + REPEAT_NS
        self._link.send(self._message, now_ns // 1000, node=self._node)
        return self._link.data_to_send()

    def next_deadline(self) -> HostNs:
        """Return the time of the next repetition, ns."""
        return HostNs(self._due_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes from the port; empty bytes mean that time has passed."""
        for event in self._link.receive(data, now_ns // 1000):
            if isinstance(event, Received):
                self._take(event)

    @abstractmethod
    def _take(self, event: Received) -> None:
        """Handle a device's message."""


class AddressedStop(StopRequest):
    """The owner's stop for its own device, with a cause; acknowledged by its id."""

    def __init__(self, link: type[LinkBase], cause: StopCause, command_id: int, node: int) -> None:
        super().__init__(link, Stop(command_id & 0xFFFF, cause), node)
        self._command_id = command_id & 0xFFFF
        self._confirmed_by: int | None = None

    @property
    def confirmed_by(self) -> int | None:
        """Node of the device that confirmed the stop; None before that."""
        return self._confirmed_by

    def _take(self, event: Received) -> None:
        message = event.message
        if (
            isinstance(message, Ack)
            and (message.command_type, message.command_id) == (_STOP, self._command_id)
            and event.frame.node == self._node
        ):
            self._confirmed_by = event.frame.node


class StopEverything(StopRequest):
    """The stop of every device on the port. Every sender sends the same bytes.

    Every detected device must report the latched cause ``operator`` or a higher cause. On a bus,
    all devices are detected if no new device has sent for :data:`GATHER_NS`.
    """

    def __init__(self, link: type[LinkBase], node: int | None = None) -> None:
        """Wait for ``node`` and for every other detected device."""
        super().__init__(link, StopAll(), NODE_ALL)
        self._link.codec.limit(_STATUS, _LATCH_FIELDS)
        self._latched: dict[int, bool] = {} if node is None else {node: False}
        self._gathers = self._link.medium is Medium.CAN
        self._begun_ns: HostNs | None = None
        self._known_ns = self._now_ns = HostNs(0)

    @property
    def confirmed(self) -> list[int]:
        """Nodes of the devices that report the latched stop."""
        return sorted(node for node, latched in self._latched.items() if latched)

    @property
    def missing(self) -> list[int]:
        """Nodes of the known devices that do not report the latched stop."""
        return sorted(node for node, latched in self._latched.items() if not latched)

    @property
    def confirmed_by(self) -> int | None:
        """Lowest node of the known devices if all of them report the latched stop, else None."""
        if not self.confirmed or self.missing or self._begun_ns is None:
            return None
        if self._gathers and self._now_ns - max(self._begun_ns, self._known_ns) < GATHER_NS:
            return None
        return self.confirmed[0]

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Return the stop's bytes if it is due, else no bytes."""
        if self._begun_ns is None:
            self._begun_ns = now_ns
        return super().data_to_send(now_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes from the port; empty bytes mean that time has passed."""
        self._now_ns = now_ns
        super().receive(data, now_ns)

    def _take(self, event: Received) -> None:
        node, message = event.frame.node, event.message
        if node not in self._latched:
            self._known_ns = self._now_ns
        known = self._latched.setdefault(node, False)
        if self._begun_ns is not None and isinstance(message, Status) and not known:
            self._latched[node] = message.stop_cause >= StopCause.OPERATOR


def stop_request(
    link: type[LinkBase], cause: StopCause, command_id: int, node: int | None
) -> StopRequest:
    """Return the stop for the session's device; without a device, the stop for every device."""
    if node is None:
        return StopEverything(link)
    return AddressedStop(link, cause, command_id, node)
