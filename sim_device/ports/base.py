"""Interface between a port and the serving loop."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from sim_device.line.line import FIFO_BYTES

if TYPE_CHECKING:
    from types import TracebackType


class PortUnavailableError(OSError):
    """The port cannot be created; the message is one line for the user."""


class DevicePort(ABC):
    """The device's end of a link."""

    path: str
    """Name that a host opens."""

    @abstractmethod
    def filenos(self) -> list[int]:
        """File descriptors that become readable when there is data; empty while unplugged."""

    @abstractmethod
    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Return the received bytes, at most ``limit``; empty if there are none."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write the bytes that fit; return their number.

        Without a connected host, all bytes count as written.
        """

    def tend(self) -> None:  # noqa: B027 - most ports have nothing to do
        """Do the port's timed work; the serving loop calls this in each iteration."""

    @abstractmethod
    def unplug(self) -> None:
        """Remove the port, as if the cable were unplugged."""

    @abstractmethod
    def plug(self) -> None:
        """Create the port again after :meth:`unplug`, with the same name if it has a stable name.

        Raises:
            PortUnavailableError: another process uses the name now.

        """

    @abstractmethod
    def close(self) -> None:
        """Close the port and remove its files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Stopper:
    """Ends a serving loop from a signal handler or another thread."""

    def __init__(self) -> None:
        self.stopped = False
        self._read, self._write = socket.socketpair()  # Windows cannot wait on a pipe
        self._write.setblocking(False)  # noqa: FBT003 - positional in C

    def stop(self) -> None:
        """End the loop now."""
        self.stopped = True
        with suppress(OSError):
            self._write.send(b"!")

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when the loop should end."""
        return self._read.fileno()

    def close(self) -> None:
        """Close the sockets; :meth:`stop` has no effect afterwards."""
        self._read.close()
        self._write.close()

    def __del__(self) -> None:
        with suppress(AttributeError):  # a Ctrl-C has ended the constructor
            self.close()
