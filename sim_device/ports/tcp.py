"""The device's serial port on a TCP socket: for one host, and for a stop from any client."""

from __future__ import annotations

import ipaddress
import socket
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from protocol.messages.host import Stop, StopAll
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.uart.framing import Frame, UartParser, encode_frame
from sim_device.line.line import FIFO_BYTES
from sim_device.ports.base import DevicePort, PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable

LOOPBACK = "127.0.0.1"
QUIET_S = 10.0
"""Minimum time between two log lines about rejected clients, s."""
SILENT_S = 3.0
"""Time without an intact frame from the host after which another client may replace it, s: three
times the device's session timeout. A connected host sends at least one time request per second."""
GRACE_S = 1.0
"""Maximum time that a second client has for its first frame (a stop), s."""
STOPPING_S = 5.0
"""Time for which a client receives the device's data after it has sent a stop, s. ``sweepctl stop``
waits for 3 s."""
WAITING_MAX = 4
"""Maximum number of waiting clients. A further client replaces the client that waits longest."""
_STOPS = frozenset(CATALOGUE.by_class[stop].type_id for stop in (StopAll, Stop))
_READ_MAX = 4096
"""Maximum number of bytes to read from a waiting client at once: about 15 frames of maximum
length."""


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached only from this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(eq=False, slots=True)
class _Client:
    """A client's connection and its received data."""

    socket: socket.socket
    who: str
    heard_s: float
    """Time of its last intact frame, s; before the first frame, the time of its connection."""
    parser: UartParser = field(default_factory=UartParser)
    data: bytes = b""
    """Bytes that the client has sent while it waited."""
    stopped_s: float | None = None
    """Time of its last stop while it waited, s."""

    def receive(self, limit: int, now_s: float) -> tuple[bytes, list[Frame]] | None:
        """Return new bytes and the intact frames that they complete; None after disconnection."""
        try:
            data = self.socket.recv(limit)
        except (BlockingIOError, InterruptedError):
            return b"", []
        except OSError:
            return None
        if not data:
            return None
        frames = [f for f in self.parser.feed(data) if isinstance(f, Frame)]
        if frames:
            self.heard_s = now_s
        return data, frames

    def send(self, data: bytes) -> int | None:
        """Send data; return the number of accepted bytes; None after disconnection."""
        try:
            return self.socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError:
            return None

    def dismiss(self, reason: str) -> None:
        """Send a line with the reason, and close the connection."""
        with suppress(OSError):
            self.socket.send(f"{reason}\r\n".encode())
            self.socket.shutdown(socket.SHUT_WR)
        self.socket.close()


def client_url(host: str, port: int) -> str:
    """Return the URL with which a client on this machine opens a socket listening on ``host``."""
    if host in {"", "0.0.0.0", "::"}:  # noqa: S104 - a text; the user chose it
        host = LOOPBACK
    return f"socket://{f'[{host}]' if ':' in host else host}:{port}"


class TcpServerPort(DevicePort):
    """A listening socket. The first client is the host; any other client may only stop the robot.

    A second client must send a frame within :data:`GRACE_S`. If the frame is a stop, it is passed
    to the device, and the client then receives the device's data. Otherwise the client is rejected:
    it receives a line with the host's address, and the connection is closed. If the host has sent
    no intact frame for :data:`SILENT_S`, the new client becomes the host instead. Without a client,
    the device's data is dropped, as on a serial port.
    """

    def __init__(
        self, host: str = LOOPBACK, port: int = 0, notify: Callable[[str], None] = lambda _: None
    ) -> None:
        """Listen; ``notify`` is called with a log line for each client event.

        Raises:
            PortUnavailableError: the address is not an address of this machine, or is in use.

        """
        self._host, self._port, self._notify = host, port, notify
        self._listener: socket.socket | None = None
        self._client: _Client | None = None
        self._waiting: list[_Client] = []
        self._stops = b""
        """Frames of waiting clients that the device has not received yet."""
        self._rejected = 0
        """Number of rejected clients since the last log line about rejections."""
        self._rejection_s = -QUIET_S
        self.path = ""
        self.plug()

    def plug(self) -> None:
        """Listen on the previous port number."""
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
        self.path = client_url(self._host, self._port)

    def unplug(self) -> None:
        """Stop listening and close the connections."""
        for client in (self._client, *self._waiting):
            if client is not None:
                client.socket.close()
        if self._listener is not None:
            self._listener.close()
        self._client = self._listener = None
        self._waiting.clear()
        self._stops = b""

    def close(self) -> None:
        """Stop listening and close the connections."""
        self.unplug()

    def filenos(self) -> list[int]:
        """File descriptors of the listening socket and of the clients."""
        clients = [c.socket for c in (self._client, *self._waiting) if c is not None]
        return [end.fileno() for end in (self._listener, *clients) if end is not None]

    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Accept clients; return the host's bytes and the stops of other clients."""
        self._accept_clients()
        if len(self._stops) < _READ_MAX:
            for waiting in list(self._waiting):
                self._stops += self._hear(waiting)
        stops, self._stops = self._stops[:limit], self._stops[limit:]
        client, room = self._client, min(limit - len(stops), FIFO_BYTES)
        if client is None or not room:
            return stops
        if client.data:  # received before the client became the host
            data, client.data = client.data[:room], client.data[room:]
            return stops + data
        received = client.receive(room, time.monotonic())
        if received is None:
            self._disconnect_host()
            return stops
        # A stop may split a frame of the host, which is then damaged.
        return stops + received[0]

    def write(self, data: bytes) -> int:
        """Send what the host's socket accepts, and all bytes to clients that stop the robot."""
        written = len(data)
        if self._client is not None:
            taken = self._client.send(data)
            if taken is None:
                self._disconnect_host()
            else:
                written = taken
        stopping = [client for client in self._waiting if client.stopped_s is not None]
        for client in stopping:
            if client.send(data) is None:
                self._drop(client)
        # A host that does not read loses data here. Otherwise it would delay the reply to the stop.
        return len(data) if stopping else written

    def tend(self) -> None:
        """End expired waits; if there is no host, a waiting client becomes the host."""
        now_s = time.monotonic()
        for client in list(self._waiting):
            if client.stopped_s is None:
                if now_s - client.heard_s >= GRACE_S:
                    self._decide(client)
            elif now_s - client.stopped_s >= STOPPING_S:
                self._drop(client)
        if self._client is None and self._waiting:
            self._make_host(self._waiting.pop(0))

    # ---- clients --------------------------------------------------------------------------

    def _accept_clients(self) -> None:
        for _ in range(WAITING_MAX):
            if self._listener is None:
                return
            try:
                accepted, address = self._listener.accept()
            except OSError:  # no client, or the client has already disconnected
                return
            accepted.setblocking(False)  # noqa: FBT003 - positional in C
            with suppress(OSError):
                accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                accepted.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            client = _Client(accepted, f"{address[0]}:{address[1]}", time.monotonic())
            if self._client is None or self._has_left():
                self._make_host(client)
                continue
            if len(self._waiting) >= WAITING_MAX:
                self._reject(min(self._waiting, key=lambda c: c.stopped_s or 0.0))
            self._waiting.append(client)

    def _hear(self, client: _Client) -> bytes:
        """Read a waiting client; return its last stop as a frame."""
        now_s = time.monotonic()
        received = client.receive(_READ_MAX, now_s)
        if received is None:
            self._drop(client)
            return b""
        data, frames = received
        client.data = (client.data + data)[:_READ_MAX]
        stops = [f for f in frames if f.type_id in _STOPS and f.version == PROTOCOL_VERSION]
        if stops and client.stopped_s is None:
            self._notify(f"{client.who} stops the robot")
        if stops:
            client.stopped_s, client.data = now_s, b""
        if len(stops) < len(frames) or len(client.data) >= _READ_MAX:
            self._decide(client)
        if not stops:
            return b""
        newest = stops[-1]
        node, seq, t_us, flags = newest.node, newest.seq, newest.t_us, newest.flags
        return b"\0" + encode_frame(node, newest.type_id, seq, t_us, newest.payload, flags)

    def _decide(self, client: _Client) -> None:
        """Make a client the host if the host is silent; else reject the client."""
        host = self._client
        if host is not None:
            if time.monotonic() - host.heard_s < SILENT_S:
                self._reject(client)
                return
            host.dismiss(
                f"ended: this sweeper had no frame from here for {SILENT_S:g} s, "
                f"and {client.who} wants it"
            )
            self._notify(
                f"{host.who} sent no frame for {SILENT_S:g} s: it gives way to {client.who}"
            )
            self._client = None
        self._waiting.remove(client)
        self._make_host(client)

    def _make_host(self, client: _Client) -> None:
        self._client = client
        client.heard_s = time.monotonic()
        self._notify(f"{client.who} is connected")

    def _reject(self, client: _Client) -> None:
        """Close the connection of a rejected client.

        The log lines are limited, because a client may retry four times per second.
        """
        host = "" if self._client is None else self._client.who
        client.dismiss(f"rejected: this sweeper has a host already, {host}; end it first")
        self._waiting.remove(client)
        now_s = time.monotonic()
        self._rejected += 1
        if now_s - self._rejection_s < QUIET_S:
            return
        more = f" ({self._rejected} times)" if self._rejected > 1 else ""
        self._notify(
            f"{client.who} was rejected{more}: {host} is connected, and a sweeper has one host"
        )
        self._rejected, self._rejection_s = 0, now_s

    def _drop(self, client: _Client) -> None:
        client.socket.close()
        self._waiting.remove(client)

    def _has_left(self) -> bool:
        """Return whether the host has disconnected, possibly in the present loop iteration."""
        if self._client is None:
            return True
        try:
            gone = self._client.socket.recv(1, socket.MSG_PEEK) == b""
        except (BlockingIOError, InterruptedError):
            gone = False
        except OSError:
            gone = True
        if gone:
            self._disconnect_host()
        return gone

    def _disconnect_host(self) -> None:
        if self._client is not None:
            self._client.socket.close()
            self._notify(f"{self._client.who} has left")
            self._client = None
