"""A CAN bus over UDP multicast, which any process on this machine can join."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from protocol.can.frames import RECORD
from sim_device.line.line import FIFO_BYTES
from sim_device.ports.base import DevicePort, PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

MULTICAST_GROUP = "239.74.163.2"
"""IPv4 group that python-can uses by default."""
_ECHOES = 512


class MulticastPort(DevicePort):
    """The device's node on the bus."""

    def __init__(self, join: Callable[[str], can.BusABC], group: str = MULTICAST_GROUP) -> None:
        """Join the group; the function ``join`` returns the bus object of a group.

        Raises:
            PortUnavailableError: this system does not support multicast.

        """
        self.path = f"can:udp_multicast:{group}"
        self._group, self._join = group, join
        self._echoes: deque[bytes] = deque(maxlen=_ECHOES)
        self._bus: can.BusABC | None = None
        self.plug()

    def plug(self) -> None:
        """Join the group."""
        import can  # noqa: PLC0415 - slow to import, and for one kind of link only

        if self._bus is not None:
            return
        try:
            self._bus = self._join(self._group)
        except (can.CanError, OSError) as error:
            cause = error.__cause__ or error
            raise PortUnavailableError(
                f"cannot join the multicast group {self._group}: {cause}; "
                "it needs a route (ip route add 224.0.0.0/4 dev lo)"
            ) from None
        self._error = can.CanError
        self._echoes.clear()

    def unplug(self) -> None:
        """Leave the group."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def close(self) -> None:
        """Leave the group."""
        self.unplug()

    def filenos(self) -> list[int]:
        """File descriptor of the socket."""
        return [] if self._bus is None else [self._bus.fileno()]

    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Return frames of the other nodes, without our own frames (the socket returns both)."""
        found: list[bytes] = []
        for _ in range(max(1, limit // RECORD.size)):
            if self._bus is None:
                break
            try:
                message = self._bus.recv(0.0)
            except (self._error, ValueError):  # invalid datagram; any process may send to the group
                continue
            if message is None:
                break
            if message.is_fd or message.is_extended_id:
                continue
            if message.is_remote_frame or message.is_error_frame:
                continue
            record = _record(message)
            if record in self._echoes:
                self._echoes.remove(record)
            else:
                found.append(record)
        return b"".join(found)

    def write(self, data: bytes) -> int:
        """Send as many frames as the system accepts; drop frames while unplugged."""
        import can  # noqa: PLC0415 - loaded already

        if self._bus is None:
            return len(data)
        written = 0
        for can_id, length, content in RECORD.iter_unpack(data):
            message = can.Message(
                arbitration_id=can_id, data=content[:length], is_extended_id=False
            )
            self._echoes.append(_record(message))
            try:
                self._bus.send(message)
            except (self._error, OSError):
                self._echoes.pop()
                break
            written += RECORD.size
        return written


def _record(message: can.Message) -> bytes:
    return RECORD.pack(message.arbitration_id, min(message.dlc, 8), bytes(message.data)[:8])
