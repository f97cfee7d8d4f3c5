"""The emulator's only I/O: pseudo-terminals, CAN buses, and the clock that paces the device.

Like a UART, the pseudo-terminal does not care whether anybody listens: what does not fit
its buffer is dropped and counted.
"""

from __future__ import annotations

import os
import selectors
import sys
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol, Self

from protocol.can_frames import RECORD
from sim_device.slcan import SlcanAdapter

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import TracebackType

    import can

    from sim_device.device import VirtualSweeper
    from sim_device.plant import Truth

_READ = 4096
MULTICAST_GROUP = "239.74.163.2"
"""The IPv4 group that python-can names as its default."""
_ECHOES = 512


class PortUnavailableError(OSError):
    """The pseudo-terminal cannot be made or linked; one line for people."""


class DevicePort(Protocol):
    """What :func:`serve` needs of the device's end of a link."""

    path: str
    """What a host opens."""

    def fileno(self) -> int:
        """Becomes readable when something has come."""

    def read(self) -> bytes:
        """What has come; empty when nothing has."""

    def write(self, data: bytes) -> None:
        """Write what fits; the rest is lost, as on a wire."""


class PtyPort:
    """A pseudo-terminal whose far end is the device's serial port."""

    def __init__(self, link: Path | None = None) -> None:
        """Make it, raw, and optionally a symbolic link with a stable name to it.

        Raises:
            PortUnavailableError: no pseudo-terminals on this system, or the link's path is
                taken by something that is not a link.

        """
        if sys.platform == "win32":
            raise PortUnavailableError("a pty needs Linux or macOS; use --link tcp there")
        import pty  # noqa: PLC0415 - not on every platform
        import tty  # noqa: PLC0415 - not on every platform

        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.dropped_bytes = 0
        self.path = os.ttyname(self._slave)
        self._link = link
        if link is not None:
            self._make_link(link)
            self.path = str(link)

    def _make_link(self, link: Path) -> None:
        try:
            if link.is_symlink():
                link.unlink()
            link.symlink_to(self.path)
        except OSError as error:
            self._link = None
            self.close()
            raise PortUnavailableError(f"cannot make the link {link}: {error.strerror}") from None

    def fileno(self) -> int:
        """The device's end."""
        return self._master

    def read(self) -> bytes:
        """What has come; empty when nothing has."""
        try:
            return os.read(self._master, _READ)
        except (BlockingIOError, InterruptedError):
            return b""

    def write(self, data: bytes) -> None:
        """Write what fits; the rest is lost, as on a wire."""
        written = 0
        with suppress(BlockingIOError, InterruptedError):
            written = os.write(self._master, data)
        self.dropped_bytes += len(data) - written

    def close(self) -> None:
        """Take the pseudo-terminal and its link away."""
        if self._link is not None:
            with suppress(OSError):
                self._link.unlink()
        for end in (self._master, self._slave):
            with suppress(OSError):
                os.close(end)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class SlcanPort(PtyPort):
    """A serial CAN adapter on a pseudo-terminal, the device alone on its bus."""

    def __init__(self, link: Path | None = None, *, bitrate: int = 500_000) -> None:
        """Plug it in; the host opens its bus.

        Raises:
            PortUnavailableError: as for :class:`PtyPort`.

        """
        super().__init__(link)
        self.path = f"can:slcan:{self.path}"
        self._adapter = SlcanAdapter(bitrate)

    def read(self) -> bytes:
        """Frames that the host has put on the bus."""
        records, answer = self._adapter.feed(super().read())
        super().write(answer)
        return records

    def write(self, data: bytes) -> None:
        """Frames for the host; while its bus is closed they go nowhere."""
        super().write(self._adapter.from_bus(data))


class MulticastPort:
    """A CAN bus made of UDP datagrams, which any process on this machine can join."""

    def __init__(self, group: str = MULTICAST_GROUP, *, lan: bool = False) -> None:
        """Join the group; nothing leaves this machine unless ``lan``.

        Raises:
            PortUnavailableError: this system has no multicast.

        """
        import can  # noqa: PLC0415 - slow to import, and for one kind of link only

        self.path = f"can:udp_multicast:{group}"
        self.dropped_bytes = 0
        self._echoes: deque[bytes] = deque(maxlen=_ECHOES)
        try:
            self._bus = can.Bus(
                interface="udp_multicast",
                channel=group,
                hop_limit=1 if lan else 0,
                fd=False,
                ignore_config=True,
            )
        except (can.CanError, OSError) as error:
            cause = error.__cause__ or error
            raise PortUnavailableError(
                f"cannot join the multicast group {group}: {cause}; "
                "it needs a route (ip route add 224.0.0.0/4 dev lo)"
            ) from None
        self._error = can.CanError

    def fileno(self) -> int:
        """The socket."""
        return self._bus.fileno()

    def read(self) -> bytes:
        """One frame of another node on the bus; the socket gives our own back to us too."""
        try:
            message = self._bus.recv(0.0)
        except (self._error, ValueError):  # any process may send anything to the group
            return b""
        if message is None or message.is_fd or message.is_extended_id or message.is_remote_frame:
            return b""
        record = _record(message)
        if record in self._echoes:
            self._echoes.remove(record)
            return b""
        return record

    def write(self, data: bytes) -> None:
        """Send frames; what the system does not take is lost."""
        import can  # noqa: PLC0415 - loaded already

        for can_id, length, content in RECORD.iter_unpack(data):
            message = can.Message(
                arbitration_id=can_id, data=content[:length], is_extended_id=False
            )
            self._echoes.append(_record(message))
            try:
                self._bus.send(message)
            except (self._error, OSError):
                self._echoes.pop()
                self.dropped_bytes += RECORD.size

    def close(self) -> None:
        """Leave the group."""
        self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _record(message: can.Message) -> bytes:
    return RECORD.pack(message.arbitration_id, min(message.dlc, 8), bytes(message.data)[:8])


class Stopper:
    """Ends a serving loop from a signal handler or another thread."""

    def __init__(self) -> None:
        self.stopped = False
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)

    def stop(self) -> None:
        """End the loop now."""
        self.stopped = True
        with suppress(OSError):
            os.write(self._write, b"!")

    def fileno(self) -> int:
        """Becomes readable when the loop should end."""
        return self._read


def serve(
    device: VirtualSweeper,
    port: DevicePort,
    stopper: Stopper,
    on_truth: Callable[[Truth, int], None] | None = None,
) -> None:
    """Run the device in real time on a port until stopped.

    ``on_truth`` gets the truth and its Unix time in nanoseconds after every control period.
    """
    start_ns = time.monotonic_ns()
    unix_at_boot_ns = time.time_ns()
    last_tick = -1
    with selectors.DefaultSelector() as selector:
        selector.register(port.fileno(), selectors.EVENT_READ)
        selector.register(stopper.fileno(), selectors.EVENT_READ)
        while not stopper.stopped:
            now_us = (time.monotonic_ns() - start_ns) // 1000
            wait_s = max(0.0, (device.next_deadline_us() - now_us) / 1e6)
            ready = selector.select(wait_s)
            data = port.read() if any(key.fd == port.fileno() for key, _ in ready) else b""
            out = device.step(data, (time.monotonic_ns() - start_ns) // 1000)
            if out:
                port.write(out)
            if on_truth is not None:
                truth = device.truth
                if truth.tick_ms != last_tick:
                    last_tick = truth.tick_ms
                    on_truth(truth, unix_at_boot_ns + truth.tick_ms * 1_000_000)
