"""A port as the bench's wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.io.ports import link_of

if TYPE_CHECKING:
    from bridge.io.ports import BytePort
    from protocol.clock import HostNs
    from protocol.link import LinkBase

STUCK_NS = 50_000_000
"""What a port did not take by then is dropped: commands are repeated, and nothing old goes out."""


class PortWire:
    """Carries bytes over a port, in real time."""

    def __init__(self, port: BytePort) -> None:
        """The wire owns the port from now on."""
        self._port = port
        self._closed = False

    @property
    def link(self) -> type[LinkBase]:
        """What is spoken over it."""
        return link_of(self._port.name)

    def now(self) -> HostNs:
        """Monotonic time."""
        return clock.now()

    def turn(self, data: bytes, until_ns: HostNs) -> bytes:
        """Send, and give what comes; returns as soon as something has, or at that time.

        Raises:
            PortError: the port is gone.

        """
        give_up_ns = clock.now() + STUCK_NS
        while data and clock.now() < give_up_ns:
            data = data[self._port.write(data) :]
            if data:
                clock.pause(0.001)
        return self._port.wait(max(0.0, (until_ns - clock.now()) / 1e9))

    def close(self) -> None:
        """Give the port back."""
        if not self._closed:
            self._closed = True
            self._port.close()
