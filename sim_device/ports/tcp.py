"""The device's serial port on a TCP socket, for one host at a time."""

from __future__ import annotations

import ipaddress
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from sim_device.line import FIFO_BYTES
from sim_device.ports.base import DevicePort, PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable

LOOPBACK = "127.0.0.1"
QUIET_S = 10.0
"""Between two lines about clients that were refused."""


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class TcpPort(DevicePort):
    """A listening socket; a second client is told who has the device, and closed.

    While nobody is there, what the device says goes nowhere, as on a serial line.
    """

    def __init__(
        self, host: str = LOOPBACK, port: int = 0, tell: Callable[[str], None] = lambda _: None
    ) -> None:
        """Listen; ``tell`` gets a line for people when a client comes, goes or is refused.

        Raises:
            PortUnavailableError: the address is not ours, or taken.

        """
        self._host, self._port, self._tell = host, port, tell
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._who = ""
        self._refused = 0
        """Since it was last told of."""
        self._refusal_s = -QUIET_S
        self.path = ""
        self.plug()

    def plug(self) -> None:
        """Listen, on the same port as before."""
        if self._listener is not None:
            return
        family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((self._host, self._port))
            listener.listen(4)
        except (OSError, OverflowError) as error:
            listener.close()
            reason = getattr(error, "strerror", None) or error
            raise PortUnavailableError(
                f"cannot listen on {self._host}:{self._port}: {reason}"
            ) from None
        listener.setblocking(False)  # noqa: FBT003 - positional in C
        self._listener = listener
        self._port = listener.getsockname()[1]
        wild = self._host in {"", "0.0.0.0", "::"}  # noqa: S104 - asked for by the user
        host = LOOPBACK if wild else self._host
        self.path = f"socket://{f'[{host}]' if ':' in host else host}:{self._port}"

    def unplug(self) -> None:
        """Stop listening and hang up."""
        for end in (self._client, self._listener):
            if end is not None:
                end.close()
        self._client = self._listener = None

    def close(self) -> None:
        """Stop listening and hang up."""
        self.unplug()

    def filenos(self) -> list[int]:
        """Those on which somebody may knock or talk."""
        return [end.fileno() for end in (self._listener, self._client) if end is not None]

    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Open the door, and take what the client has written."""
        self._answer_the_door()
        if self._client is None:
            return b""
        try:
            data = self._client.recv(min(limit, FIFO_BYTES))
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def write(self, data: bytes) -> int:
        """Send what the client's socket takes."""
        if self._client is None:
            return len(data)
        try:
            written = self._client.send(data)
        except (BlockingIOError, InterruptedError):
            written = 0
        except OSError:
            self._hang_up()
            return len(data)
        return written

    def _answer_the_door(self) -> None:
        if self._listener is None:
            return
        try:
            client, address = self._listener.accept()
        except OSError:  # nobody, or gone again
            return
        who = f"{address[0]}:{address[1]}"
        client.setblocking(False)  # noqa: FBT003 - positional in C
        if self._client is not None and not self._has_left():
            self._tell_of_refusal(who)
            reason = f"refused: this sweeper has a host already, {self._who}; end it first\r\n"
            with suppress(OSError):
                client.send(reason.encode())
                client.shutdown(socket.SHUT_WR)
            client.close()
            return
        with suppress(OSError):
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._who = client, who
        self._tell(f"{who} is connected")

    def _tell_of_refusal(self, who: str) -> None:
        """Say it, but not each time: whoever is refused may knock again four times a second."""
        now_s = time.monotonic()
        self._refused += 1
        if now_s - self._refusal_s < QUIET_S:
            return
        more = f" ({self._refused} times)" if self._refused > 1 else ""
        self._tell(f"{who} was refused{more}: {self._who} is connected, and a sweeper has one host")
        self._refused, self._refusal_s = 0, now_s

    def _has_left(self) -> bool:
        """Whether the client hung up while its successor knocked: both come in one turn."""
        if self._client is None:
            return True
        try:
            gone = self._client.recv(1, socket.MSG_PEEK) == b""
        except (BlockingIOError, InterruptedError):
            gone = False
        except OSError:
            gone = True
        if gone:
            self._hang_up()
        return gone

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
            self._tell(f"{self._who} has left")
