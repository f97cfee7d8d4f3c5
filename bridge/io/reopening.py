"""A port that can be opened again as the same device, under whatever name it comes back."""

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
    """How a port is opened; what does not apply to its kind is passed over."""

    baud: int = DEFAULT_BAUD
    dtr: bool = False
    rts: bool = False
    bitrate: int | None = None
    lan: bool = False


class Opener:
    """Opens a port, and after it has vanished the same device's port again.

    ``/dev/ttyUSB0`` is whatever was plugged in first; udev's link in ``/dev/serial/by-id`` names
    the adapter by its serial number. Where there is one, it is what is opened again, so that
    the device is found as ``ttyUSB1`` too, and another adapter is not taken for it. A link that
    was given as it is (by-id, a rule's own, an emulator's) is followed anew each time.
    """

    def __init__(self, port: str, options: PortOptions, *, by_id: Path = BY_ID) -> None:
        self._port = port
        self._options = options
        self._by_id = by_id
        self.stable: str | None = None
        """The name that is opened from the second time on; None before the first."""

    def __call__(self) -> BytePort:
        """Open it.

        Raises:
            PortBusyError: another program has it.
            PortError: it does not exist, may not be opened, or is no port.

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
    """The name under which the same device is found again; the port's own where none is."""
    path = device_path(port)
    if path is None or Path(path).is_symlink():
        return port
    real = os.path.realpath(path)
    try:
        links = sorted(link for link in by_id.iterdir() if os.path.realpath(link) == real)
    except OSError:
        return port
    return port.replace(path, str(links[0])) if links else port
