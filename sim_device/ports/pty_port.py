"""Ports on pseudo-terminals: a serial port, and a serial CAN adapter."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from protocol.can.frames import RECORD
from sim_device.line.line import FIFO_BYTES
from sim_device.line.slcan import SHORTEST_LINE, SlcanAdapter
from sim_device.ports.base import DevicePort, PortUnavailableError

if TYPE_CHECKING:
    from pathlib import Path

    from sim_device.ports.pty_link import PtyLink

_GONE = -1


class PtyPort(DevicePort):
    """A pseudo-terminal that is connected to the device's serial port."""

    def __init__(self, link: Path | None = None) -> None:
        """Create a raw pseudo-terminal, and optionally a symbolic link with a stable name to it.

        Raises:
            PortUnavailableError: this system has no pseudo-terminals, or a running emulator uses
                the link's path, or the path is a file that is not a link.

        """
        if sys.platform == "win32":
            raise PortUnavailableError("a pty needs Linux or macOS; use --link tcp there")
        self._wanted = link
        self._link: PtyLink | None = None
        self._master = self._slave = _GONE
        self.path = ""
        self.plug()

    def plug(self) -> None:
        """Create the pseudo-terminal, and the link to it."""
        import pty  # noqa: PLC0415 - not on every platform
        import tty  # noqa: PLC0415 - not on every platform

        from sim_device.ports.pty_link import PtyLink  # noqa: PLC0415 - not on every platform

        if self._master != _GONE:
            return
        try:
            self._master, self._slave = pty.openpty()
        except OSError as error:
            raise PortUnavailableError(f"cannot open a pseudo-terminal: {error.strerror}") from None
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        if self._wanted is not None:
            try:
                self._link = PtyLink(self._wanted, self._slave)
            except PortUnavailableError:
                self.unplug()
                raise
            self.path = str(self._wanted)

    def unplug(self) -> None:
        """Remove the pseudo-terminal and its link."""
        if self._link is not None:
            self._link.remove()
            self._link = None
        for end in (self._master, self._slave):
            if end != _GONE:
                with suppress(OSError):
                    os.close(end)
        self._master = self._slave = _GONE

    def close(self) -> None:
        """Remove the pseudo-terminal and its link."""
        self.unplug()

    def filenos(self) -> list[int]:
        """File descriptor of the device's end."""
        return [] if self._master == _GONE else [self._master]

    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Return the received bytes; empty if there are none."""
        try:
            return os.read(self._master, min(limit, FIFO_BYTES))
        except (BlockingIOError, InterruptedError):
            return b""

    def write(self, data: bytes) -> int:
        """Write the bytes that fit."""
        written = 0
        with suppress(BlockingIOError, InterruptedError):
            written = os.write(self._master, data)
        return written


class SlcanPort(PtyPort):
    """A serial CAN adapter on a pseudo-terminal; the device is the only node on its bus."""

    def __init__(self, link: Path | None = None, *, bitrate: int = 500_000) -> None:
        """Create the adapter; its bus is closed until the host opens it.

        Raises:
            PortUnavailableError: the pseudo-terminal or its link cannot be created.

        """
        self._adapter = SlcanAdapter(bitrate)
        self._bitrate = bitrate
        self._text = b""
        super().__init__(link)

    def plug(self) -> None:
        """Create the pseudo-terminal. The bus is closed, as after power-on of an adapter."""
        super().plug()
        self._adapter = SlcanAdapter(self._bitrate)
        self._text = b""
        if not self.path.startswith("can:"):
            self.path = f"can:slcan:{self.path}"

    def read(self, limit: int = FIFO_BYTES) -> bytes:
        """Return the frames that the host has sent to the bus, at most ``limit`` bytes."""
        frames = max(1, limit // RECORD.size)
        records, answer = self._adapter.feed(super().read(frames * SHORTEST_LINE))
        self._write_text(answer)
        return records

    def write(self, data: bytes) -> int:
        """Send frames to the host; drop them while its bus is closed."""
        self._write_text(b"")
        if self._text:
            return 0
        self._write_text(self._adapter.from_bus(data))
        return len(data)

    def _write_text(self, text: bytes) -> None:
        self._text += text
        if self._text:
            self._text = self._text[super().write(self._text) :]
