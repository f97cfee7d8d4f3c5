"""A device on the line: agrees with it, asks it the time, and listens; nothing else is sent.

Sans-I/O: whoever owns the port feeds bytes and time in and carries bytes out. Nothing of what
is sent can move a wheel: hellos, questions and time requests.
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


class Visit:
    """One visit; :meth:`conclude` once it has lasted long enough."""

    def __init__(
        self,
        new_session_id: Callable[[], int],
        *,
        node: int | None = None,
        link: type[LinkBase] = Link,
    ) -> None:
        """Nothing is sent before :meth:`open`."""
        self._session = Session(new_session_id, name="sweepctl doctor", node=node, link=link)
        self.examination = Examination(self._session.link.medium)
        self.agreed = False
        self.over = False
        """True where the session has failed: there is no more to be heard."""

    def open(self, now_ns: HostNs) -> None:
        """Say hello."""
        self._session.open(now_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Bytes that the port gave."""
        if data:
            self.examination.received(data, now_ns)
            self._digest(self._session.receive(data, now_ns))

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Do what time asks for, and give the bytes for the port."""
        self._digest(self._session.poll(now_ns))
        data = self._session.data_to_send()
        if data:
            self.examination.sent(data, now_ns)
        return data

    def next_deadline(self) -> HostNs | None:
        """When :meth:`data_to_send` has work next."""
        return self._session.next_deadline()

    def _digest(self, events: list[SessionEvent]) -> None:
        for event in events:
            if isinstance(event, SessionReady):
                self.agreed = True
                self.examination.differences = [d.report() for d in event.differences]
            elif isinstance(event, Failed):
                self.examination.failure = event.kind, event.text
                self.over = True
            elif isinstance(event, StateChanged) and event.new is State.FAILED:
                self.over = True
