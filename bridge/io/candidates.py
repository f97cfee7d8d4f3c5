"""Search for serial ports with a possible robot, and probing of ports.

The list is made from USB descriptors, without opening a port. A probe opens a port with DTR and RTS
inactive. By default it only listens, because an unknown device may react to any bytes.
"""

from __future__ import annotations

import os
import threading
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from serial.tools import list_ports

from bridge.errors import PortError
from bridge.io import clock
from bridge.io.device_lock import owner_pid
from bridge.io.identifiers import new_session_id
from bridge.io.port_loop import serve
from bridge.io.ports import DEFAULT_BAUD, SerialPort
from bridge.io.reopening import BY_ID, stable_name
from protocol.clock import HostNs
from protocol.link import NODE_ALL, Received, Rejected
from protocol.messages.device import Hello
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

LISTEN_S = 1.5
"""Time to listen, s. A device without a host sends a hello every second."""
NET = Path("/sys/class/net")
"""Folder with the network interfaces of the Linux kernel."""
_CAN = "280"
"""Interface type ARPHRD_CAN of Linux' if_arp.h."""
ADAPTERS: dict[tuple[int, int], str] = {
    (0x0403, 0x6001): "FTDI FT232R",
    (0x0403, 0x6010): "FTDI FT2232",
    (0x0403, 0x6014): "FTDI FT232H",
    (0x0403, 0x6015): "FTDI FT-X",
    (0x0483, 0x374B): "ST-LINK/V2-1 serial port",
    (0x0483, 0x374E): "STLINK-V3 serial port",
    (0x0483, 0x374F): "STLINK-V3 serial port",
    (0x0483, 0x5740): "STM32 USB serial port",
    (0x067B, 0x2303): "Prolific PL2303",
    (0x10C4, 0xEA60): "Silicon Labs CP210x",
    (0x16D0, 0x117E): "CANable (slcan)",
    (0x1A86, 0x7523): "WCH CH340",
    (0x1A86, 0x55D4): "WCH CH9102",
    (0xAD50, 0x60C4): "CANtact (slcan)",
}
"""Map of vendor and product id to the name of a USB adapter that is usual on such boards. The udev
rule has the same list."""
_SLCAN = frozenset({(0x16D0, 0x117E), (0xAD50, 0x60C4)})


@dataclass(frozen=True, slots=True)
class Candidate:
    """A port that may have a robot."""

    port: str
    """Name for :command:`connect`. It is the stable name if the port has a stable name."""
    device: str
    what: str
    """Adapter name from :data:`ADAPTERS` or from the USB descriptor."""
    serial_number: str | None = None
    usb_id: str | None = None
    """USB ids, for example ``0403:6001``."""
    known: bool = False
    """True if the adapter is in :data:`ADAPTERS`."""
    owner: int | None = None
    """Id of the process that has the port open and locked."""
    found: dict[str, Any] | None = None
    """Device that answered the probe."""
    note: str | None = None
    """Reason why a probe found no device."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return asdict(self)


def candidates(named: Sequence[str] = (), by_id: Path = BY_ID) -> list[Candidate]:
    """Return the serial and CAN ports, known adapters first; or only the ``named`` ports."""
    if named:
        return [Candidate(port, port, "as given", owner=owner_pid(port)) for port in named]
    found = [_of_serial(info, by_id) for info in list_ports.comports()]
    found += [Candidate(f"can:socketcan:{name}", name, "CAN interface") for name in _can()]
    return sorted(found, key=lambda one: (not one.known, one.device))


def _of_serial(info: Any, by_id: Path) -> Candidate:  # noqa: ANN401 - pyserial's, untyped
    usb = (info.vid, info.pid) if info.vid is not None else None
    what = ADAPTERS.get(usb) if usb else None
    name = stable_name(info.device, by_id)
    return Candidate(
        f"can:slcan:{name}" if usb in _SLCAN else name,
        info.device,
        what or _described(info),
        info.serial_number,
        f"{info.vid:04x}:{info.pid:04x}" if usb else None,
        known=what is not None,
        owner=owner_pid(os.path.realpath(info.device)),
    )


def _described(info: Any) -> str:  # noqa: ANN401 - pyserial's, untyped
    words = [info.manufacturer, info.product or info.description]
    text = " ".join(word for word in words if word and word != "n/a")
    return text or "serial port"


def _can() -> list[str]:
    """Return the CAN interfaces of this machine."""
    names = []
    for path in sorted(NET.glob("*/type")):
        try:
            if path.read_text(encoding="ascii").strip() == _CAN:
                names.append(path.parent.name)
        except OSError:
            continue
    return names


# ---- probing -------------------------------------------------------------------------------


def probe(
    found: Sequence[Candidate],
    *,
    active: bool = False,
    baud: int = DEFAULT_BAUD,
    own_baud: Mapping[str, int] | None = None,
) -> list[Candidate]:
    """Listen for a device's hello on all ports at the same time.

    With ``active`` the probe also requests a hello. Ports in use by another process are skipped.
    ``own_baud`` contains the baud rates of the ports that do not have the rate ``baud``.
    """
    results = list(found)
    rates = own_baud or {}

    def one(index: int) -> None:
        rate = rates.get(found[index].port, baud)
        results[index] = _probe(found[index], active=active, baud=rate)

    threads = [threading.Thread(target=one, args=(i,), daemon=True) for i in range(len(found))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def _probe(candidate: Candidate, *, active: bool, baud: int) -> Candidate:
    if candidate.port.startswith("can:"):
        return replace(candidate, note="a bus is not probed; use sweepctl connect")
    if candidate.owner is not None:
        return replace(candidate, note=f"process {candidate.owner} has it open")
    try:
        with SerialPort(candidate.port, baud=baud) as port:
            return _listen(candidate, port, active=active)
    except PortError as error:
        return replace(candidate, note=str(error).partition(": ")[2] or str(error))


def _listen(candidate: Candidate, port: SerialPort, *, active: bool) -> Candidate:
    listener = _HelloListener()
    if active:
        listener.ask(clock.now())
    end_ns = HostNs(clock.now() + round(LISTEN_S * 1e9))
    serve(port, listener, end_ns, lambda: listener.hello is not None)
    if listener.hello is not None:
        return replace(candidate, found=_identity(*listener.hello))
    if listener.others:
        return replace(candidate, note="a device with another protocol version sends here")
    if listener.received:
        return replace(
            candidate, note=f"received {listener.received} bytes but no hello of a device"
        )
    return replace(candidate, note="silent")


class _HelloListener:
    """Engine that waits for a device's hello."""

    def __init__(self) -> None:
        self.hello: tuple[Hello, int] | None = None
        """Hello and its node."""
        self.received = 0
        """Number of received bytes."""
        self.others = 0
        """Number of frames of another protocol version."""
        self._link = Link(Direction.HOST)

    def ask(self, now_ns: HostNs) -> None:
        """Send a hello to all nodes. A device answers it at once."""
        hello = HostHello(CATALOGUE.hash, new_session_id(), 0, 0, "sweepctl ports")
        self._link.send(hello, now_ns // 1000, node=NODE_ALL)

    def receive(self, data: bytes, now_ns: HostNs) -> None:  # noqa: ARG002 - the interface of an engine
        """Handle received bytes."""
        self.received += len(data)
        for event in self._link.receive(data):
            if isinstance(event, Received) and isinstance(event.message, Hello):
                self.hello = self.hello or (event.message, event.frame.node)
            self.others += isinstance(event, Rejected)

    def data_to_send(self, now_ns: HostNs) -> bytes:  # noqa: ARG002 - the interface of an engine
        """Return the hello of :meth:`ask` once."""
        return self._link.data_to_send()

    def next_deadline(self) -> None:
        """Return None: nothing is ever due."""
        return


def _identity(hello: Hello, node: int) -> dict[str, Any]:
    version = f"{hello.version_major}.{hello.version_minor}.{hello.version_patch}"
    return {"node": node, "uid": hello.uid.hex(), "firmware": f"{hello.name} {version}"}
