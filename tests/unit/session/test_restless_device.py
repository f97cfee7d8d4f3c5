"""The host answers a device that reboots at every hello at a bounded rate, and reports it once."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest

from bridge.session.session import (
    HANDSHAKE_PERIOD_NS,
    HANDSHAKE_TIMEOUT_NS,
    HANDSHAKES_AT_ONCE,
    Session,
)
from bridge.session.states import RESTLESS, Failed, Restless, SessionEvent, SessionReady, State
from protocol.clock import HostNs
from protocol.link import Received
from protocol.messages.device import Hello, Status
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.ends import Ends, SessionEnd, session_end, sweeper

if TYPE_CHECKING:
    from collections.abc import Callable

STEP_NS = 100_000
"""Duration of a turn, ns: ten thousand turns a second, on a link without delay."""
SECOND_NS = 1_000_000_000


def hello(session_id: int, *, boot: int = 7, schema: int = CATALOGUE.hash) -> Hello:
    return Hello(schema, bytes(12), boot, session_id, 0, 0, 1, 0, 0, "fickle")


class Fickle:
    """A device that answers each hello of the host with the hello that ``change`` returns."""

    def __init__(self, change: Callable[[int, int], Hello]) -> None:
        self.hellos = 0
        self.received = 0
        """Number of frames from the host."""
        self.calm = False
        """True: the device behaves normally from now on."""
        self.joins = False
        """True: the device joins the host's session before it sends each changed hello."""
        self._change = change
        self._link = Link(Direction.DEVICE)

    def turn(self, data: bytes, now_ns: int) -> bytes:
        for event in self._link.receive(data):
            if not isinstance(event, Received):
                continue
            self.received += 1
            if isinstance(event.message, HostHello):
                self.inform(event.message.session_id, now_ns)
        return self._link.data_to_send()

    def inform(self, session_id: int, now_ns: int) -> None:
        stamp_us = now_ns // 1000 & 0xFFFF_FFFF
        if self.calm or self.joins:
            self._link.send(hello(session_id), stamp_us, node=1)
            self._link.send(Status(0, 1, 0, 0, 5), stamp_us, node=1)
        if not self.calm:
            self.hellos += 1
            self._link.send(self._change(session_id, self.hellos), stamp_us, node=1)


CHANGES: dict[str, Callable[[int, int], Hello]] = {
    "boot": lambda session_id, n: hello(session_id, boot=1000 + n),
    "schema": lambda session_id, n: hello(session_id, schema=1000 + n),
    "session": lambda _session_id, n: hello(1000 + n),
}


def run(session: Session, device: Fickle, begin_ns: int, seconds: float) -> list[SessionEvent]:
    events: list[SessionEvent] = []
    came = b""
    for now in range(begin_ns, begin_ns + round(seconds * SECOND_NS), STEP_NS):
        events += session.receive(came, HostNs(now))
        events += session.poll(HostNs(now))
        came = device.turn(session.data_to_send(), now)
        if now == begin_ns and not device.received:
            device.inform(0, now)
    return events


def opened() -> Session:
    ids = itertools.count(500_000)
    session = Session(lambda: next(ids))
    session.open(HostNs(SECOND_NS))
    return session


@pytest.mark.parametrize("joins", [False, True])
@pytest.mark.parametrize("what", CHANGES)
def test_it_is_answered_three_times_and_then_once_a_second(
    what: str,
    joins: bool,  # noqa: FBT001 - both cases are compared
) -> None:
    session, device = opened(), Fickle(CHANGES[what])
    device.joins = joins
    seconds = 0.9 * HANDSHAKE_TIMEOUT_NS / SECOND_NS
    events = run(session, device, SECOND_NS, seconds)
    handshakes = HANDSHAKES_AT_ONCE + seconds * SECOND_NS / HANDSHAKE_PERIOD_NS
    # A handshake is a hello and its first requests. An unanswered request is repeated at 10 Hz.
    assert device.received <= 10 * handshakes + 10 * seconds
    assert device.hellos <= 10 * handshakes
    if what != "session" or joins:
        assert [e.text for e in events if isinstance(e, Restless)] == [RESTLESS]
    assert len(events) < 20 * handshakes


def test_one_that_never_calms_down_is_given_up_by_that_name() -> None:
    session, device = opened(), Fickle(CHANGES["boot"])
    events = run(session, device, SECOND_NS, 1.1 * HANDSHAKE_TIMEOUT_NS / SECOND_NS)
    assert [(e.kind, e.text) for e in events if isinstance(e, Failed)] == [("restless", RESTLESS)]


def test_one_that_calms_down_completes_the_handshake() -> None:
    session, device = opened(), Fickle(CHANGES["boot"])
    before = run(session, device, SECOND_NS, 3.0)
    assert not [e for e in before if isinstance(e, SessionReady)]
    device.calm = True
    events = run(session, device, 4 * SECOND_NS, 1.5 * HANDSHAKE_PERIOD_NS / SECOND_NS)
    (negotiated,) = [e for e in events if isinstance(e, SessionReady)]
    assert negotiated.hello.boot_id == 7
    assert session.state is State.READY


def test_a_session_never_continues_with_an_ungreeted_boot() -> None:
    """Answers and data of a boot are ignored until the host has sent a hello to that boot."""
    session, device = opened(), Fickle(CHANGES["boot"])
    run(session, device, SECOND_NS, 0.5)
    link, now_ns = Link(Direction.DEVICE), SECOND_NS + SECOND_NS // 2
    for _ in range(2):
        link.send(hello(session.session_id, boot=9), 0, node=1)
    link.send(Status(0, 1, 0, 0, 5), 0, node=1)
    session.receive(link.data_to_send(), HostNs(now_ns))
    assert session.state is State.NEGOTIATING


def test_three_resets_in_a_row_are_no_matter() -> None:
    host: SessionEnd = session_end()
    ends = Ends(host, sweeper())
    assert ends.run(3.0, lambda: host.session.state is State.READY)
    for boot in (11, 12):
        ends.reboot_device(boot)
        assert ends.run(1.5, lambda: host.session.state is not State.READY)
        assert ends.run(1.5, lambda: host.session.state is State.READY)
    assert not host.of(Restless)
