"""A port under examination: listened to, or asked what cannot move anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.doctor.visit import Visit
from bridge.errors import PortError
from bridge.io import clock
from bridge.io.identifiers import new_session_id
from bridge.io.port_loop import Listening, serve
from bridge.io.ports import link_of, open_port
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.link import Medium
from protocol.uart.framing import Frame, UartParser

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from bridge.doctor import Examination
    from bridge.io.ports import BytePort

RATES = (
    *(921_600, 115_200, 460_800, 230_400, 1_000_000, 500_000, 3_000_000, 2_000_000, 1_500_000),
    *(57_600, 38_400, 19_200, 9_600),
)
"""Those of common firmwares first."""
HELLO_S = 1.3
"""A device that nobody talks to says hello once a second."""


def attend(  # noqa: PLR0913 - what a visit can be asked for
    port: BytePort,
    name: str,
    duration_s: float,
    *,
    node: int | None = None,
    ask: bool = True,
    ended: Callable[[], bool] = lambda: False,
) -> Examination:
    """Examine a device for so long; with ``ask`` false not a byte is sent.

    The port is closed at the end; where it goes away meanwhile, that is on record.
    """
    link = link_of(name)
    visit = Visit(new_session_id, node=node, link=link)
    examination = visit.examination
    examination.medium = Medium.CAN if link is CanLink else Medium.UART
    begun_ns = clock.now()
    end_ns = HostNs(begun_ns + round(duration_s * 1e9))
    if ask:
        visit.open(begun_ns)
    engine = visit if ask else Listening(examination.received)
    try:
        serve(port, engine, end_ns, lambda: visit.over or ended())
    except PortError as error:
        examination.port_lost.append(str(error))
    finally:
        port.close()
    return examination


def find_baud(
    name: str, rates: Iterable[int] = RATES, *, on_rate: Callable[[int], None] = lambda _: None
) -> int | None:
    """Listen at one rate after the other until an intact frame comes; None: at no one.

    Not a byte is sent. ``on_rate`` is called with each rate as it begins.

    Raises:
        PortError: the port cannot be opened, or has gone.

    """
    for baud in rates:
        on_rate(baud)
        try:
            port = open_port(name, baud=baud)
        except ValueError:  # a rate that this driver does not know
            continue
        frames = _Frames()
        end_ns = HostNs(clock.now() + round(HELLO_S * 1e9))
        try:
            serve(port, Listening(frames.take), end_ns, frames.came)
        finally:
            port.close()
        if frames.came():
            return baud
    return None


class _Frames:
    """Looks for an intact frame."""

    def __init__(self) -> None:
        self._seen = False
        self._parser = UartParser()

    def came(self) -> bool:
        """Whether there was one."""
        return self._seen

    def take(self, data: bytes, now_ns: HostNs) -> None:  # noqa: ARG002 - of every listener
        self._seen |= any(isinstance(event, Frame) for event in self._parser.feed(data))
