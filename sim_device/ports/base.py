"""Interface of a port to the loop that serves it."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from sim_device.line.line import FIFO_BYTES

if TYPE_CHECKING:
    from types import TracebackType


class PortUnavailableError(OSError):
    """The port cannot be made; the message is one line for people."""


class DevicePort(ABC):
    """The device's end of a link."""

    path: str
    """Name that a host opens."""

    @abstractmethod
    def filenos(self) -> list[int]:
        """File descriptors that become readable when :meth:`read` has work.

        None while unplugged.
        """

    @abstractmethod
    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Return the received bytes, at most ``limit``; empty if there are none."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write the bytes that fit; return their number.

        Bytes without a listener count as written.
        """

    def tend(self) -> None:  # noqa: B027 - most ports have nothing to do
        """Do the port's timed work; called at every turn of the loop."""

    @abstractmethod
    def unplug(self) -> None:
        """Disappear, as if the cable were pulled."""

    @abstractmethod
    def plug(self) -> None:
        """Come back under the same name, if the port has a name of its own.

        Raises:
            PortUnavailableError: another process has the name by now.

        """

    @abstractmethod
    def close(self) -> None:
        """Close the port and leave nothing behind."""

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
        """Close the sockets; the stopper cannot wake a loop any more."""
        self._read.close()
        self._write.close()

    def __del__(self) -> None:
        self.close()
