"""Reopening of a port as the same device, under any name."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.io.owner_names import device_path
from bridge.io.ports import DEFAULT_BAUD, open_port

if TYPE_CHECKING:
    from bridge.io.ports import BytePort

BY_ID = Path("/dev/serial/by-id")


@dataclass(frozen=True, slots=True, kw_only=True)
class PortOptions:
    """Options of a port. Options that its kind does not have are ignored."""

    baud: int = DEFAULT_BAUD
    dtr: bool = False
    rts: bool = False
    bitrate: int | None = None
    lan: bool = False


class Opener:
    """Opens a port and, after a loss, the port of the same device.

    ``/dev/ttyUSB0`` is the first adapter on the system. After a reconnection, it may be another
    adapter. A link in ``/dev/serial/by-id`` contains the adapter's serial number. The opener uses
    this link if it exists. So it finds the same device even as ``ttyUSB1``, and opens no other
    adapter. The user may also pass a link: from by-id, a udev rule or the emulator. It is resolved
    again at each opening.
    """

    def __init__(self, port: str, options: PortOptions, *, by_id: Path = BY_ID) -> None:
        self._port = port
        self._options = options
        self._by_id = by_id
        self.stable: str | None = None
        """Name for the next opening; None before the first opening."""

    def __call__(self) -> BytePort:
        """Open the port.

        Raises:
            PortBusyError: another program uses the port.
            PortError: the port does not exist, cannot be opened, or is not a port.

        """
        asked = self._options
        opened = open_port(
            self.stable or self._port,
            baud=asked.baud,
            dtr=asked.dtr,
            rts=asked.rts,
            bitrate=asked.bitrate,
            lan=asked.lan,
        )
        if self.stable is None:
            self.stable = stable_name(self._port, self._by_id)
        return opened


def stable_name(port: str, by_id: Path = BY_ID) -> str:
    """Return a stable name of the same device; the port's own name if there is none."""
    path = device_path(port)
    if path is None or Path(path).is_symlink():
        return port
    real = os.path.realpath(path)
    try:
        links = sorted(link for link in by_id.iterdir() if os.path.realpath(link) == real)
    except OSError:
        return port
    return port.replace(path, str(links[0])) if links else port
