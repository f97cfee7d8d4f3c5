"""Examination of a live device, only by handshake, time requests and listening.

Sans-I/O. The owner of the port passes received bytes and the time, and writes the returned bytes.
The messages sent (hello, describe, time request) cannot move a wheel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.doctor.examination import Examination
from bridge.session.session import Session
from bridge.session.states import Failed, SessionReady, State, StateChanged
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.session.states import SessionEvent
    from protocol.clock import HostNs
    from protocol.link import LinkBase


class LiveExamination:
    """Examination of one device. Its result is :attr:`examination`."""

    def __init__(
        self,
        new_session_id: Callable[[], int],
        *,
        node: int | None = None,
        link: type[LinkBase] = Link,
    ) -> None:
        """Create the session; nothing is sent before :meth:`open`."""
        self._session = Session(new_session_id, name="sweepctl doctor", node=node, link=link)
        self.examination = Examination(self._session.link.medium)
        self.negotiated = False
        self.over = False
        """True if the session has failed, so that no more data will arrive."""

    def open(self, now_ns: HostNs) -> None:
        """Send the hello."""
        self._session.open(now_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes that the port received at ``now_ns``."""
        if data:
            self.examination.received(data, now_ns)
            self._digest(self._session.receive(data, now_ns))

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Handle expired timers and return the bytes to write to the port."""
        self._digest(self._session.poll(now_ns))
        data = self._session.data_to_send()
        if data:
            self.examination.sent(data, now_ns)
        return data

    def next_deadline(self) -> HostNs | None:
        """Return the time of the next timer; None if none is set."""
        return self._session.next_deadline()

    def _digest(self, events: list[SessionEvent]) -> None:
        for event in events:
            if isinstance(event, SessionReady):
                self.negotiated = True
                self.examination.differences = [d.report() for d in event.differences]
            elif isinstance(event, Failed):
                self.examination.failure = event.kind, event.text
                self.over = True
            elif isinstance(event, StateChanged) and event.new is State.FAILED:
                self.over = True
