"""What every kind of port is to the loop that serves it."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from sim_device.line.line import FIFO_BYTES

if TYPE_CHECKING:
    from types import TracebackType


class PortUnavailableError(OSError):
    """The port cannot be made; one line for people."""


class DevicePort(ABC):
    """The device's end of a link."""

    path: str
    """What a host opens."""

    @abstractmethod
    def filenos(self) -> list[int]:
        """Become readable when :meth:`read` has something to do; none while unplugged."""

    @abstractmethod
    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """What has come, at most so many bytes; empty when nothing has."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write what fits; how many bytes that was. What nobody wants counts as written."""

    def tend(self) -> None:  # noqa: B027 - most ports have nothing to do
        """Do what the passing of time asks for; called at every turn of the loop."""

    @abstractmethod
    def unplug(self) -> None:
        """Disappear, as if the plug were pulled."""

    @abstractmethod
    def plug(self) -> None:
        """Come back under the same name, where it has one of its own.

        Raises:
            PortUnavailableError: something else has the name by now.

        """

    @abstractmethod
    def close(self) -> None:
        """Go, and leave nothing behind."""

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
        """Becomes readable when the loop should end."""
        return self._read.fileno()

    def close(self) -> None:
        """Give its sockets back; it can no longer wake anybody."""
        self._read.close()
        self._write.close()

    def __del__(self) -> None:
        self.close()
