"""Examination of the device at a port. It only listens, or sends messages that cause no motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.doctor.live_examination import LiveExamination
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
"""Baud rates to try, in bit/s; the rates of common firmware come first."""
HELLO_S = 1.3
"""Listening time at each baud rate, s. A device without a session sends a hello every second."""


def examine_port(  # noqa: PLR0913 - options of a live
    port: BytePort,
    name: str,
    duration_s: float,
    *,
    node: int | None = None,
    ask: bool = True,
    ended: Callable[[], bool] = lambda: False,
) -> Examination:
    """Examine a device for ``duration_s`` seconds, then close the port.

    If ``ask`` is False, nothing is sent. If the port disappears, the examination contains the
    error.
    """
    link = link_of(name)
    live = LiveExamination(new_session_id, node=node, link=link)
    examination = live.examination
    examination.medium = Medium.CAN if link is CanLink else Medium.UART
    begun_ns = clock.now()
    end_ns = HostNs(begun_ns + round(duration_s * 1e9))
    if ask:
        live.open(begun_ns)
    engine = live if ask else Listening(examination.received)
    try:
        serve(port, engine, end_ns, lambda: live.over or ended())
    except PortError as error:
        examination.port_lost.append(str(error))
    finally:
        port.close()
    return examination


def find_baud(
    name: str,
    rates: Iterable[int] = RATES,
    *,
    dtr: bool = False,
    rts: bool = False,
    on_rate: Callable[[int], None] = lambda _: None,
) -> int | None:
    """Listen at each baud rate. Return the first rate with an intact frame, or None.

    Nothing is sent. ``on_rate`` is called with each rate before listening at it.

    Raises:
        PortError: the port cannot be opened, or has disappeared.

    """
    for baud in rates:
        on_rate(baud)
        try:
            port = open_port(name, baud=baud, dtr=dtr, rts=rts)
        except ValueError:  # the driver does not support this rate
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
    """Detects the first intact frame of a serial line."""

    def __init__(self) -> None:
        self._seen = False
        self._parser = UartParser()

    def came(self) -> bool:
        """Return whether an intact frame has arrived."""
        return self._seen

    def take(self, data: bytes, now_ns: HostNs) -> None:  # noqa: ARG002 - of every listener
        self._seen |= any(isinstance(event, Frame) for event in self._parser.feed(data))
