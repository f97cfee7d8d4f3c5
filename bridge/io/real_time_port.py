"""A port for the bring-up procedures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.io.ports import link_of

if TYPE_CHECKING:
    from bridge.io.ports import BytePort
    from protocol.clock import HostNs
    from protocol.link import LinkBase

STUCK_NS = 50_000_000
"""Maximum time to write, ns. After this time unsent bytes are dropped, so that nothing is sent
late. Commands are repeated."""


class RealTimePort:
    """Sends and receives bytes over a port in real time."""

    def __init__(self, port: BytePort) -> None:
        """Use ``port`` and close it at the end."""
        self._port = port
        self._closed = False

    @property
    def link(self) -> type[LinkBase]:
        """Link class for the port: serial or CAN."""
        return link_of(self._port.name)

    def now(self) -> HostNs:
        """Return monotonic time."""
        return clock.now()

    def turn(self, data: bytes, until_ns: HostNs) -> bytes:
        """Send ``data`` and return the first bytes that arrive, or no bytes at ``until_ns``.

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
        """Close the port."""
        if not self._closed:
            self._closed = True
            self._port.close()
