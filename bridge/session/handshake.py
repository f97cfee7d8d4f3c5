"""How a session finds out who is there, and whether it is the device that it knows.

From a hello through the questions to agreement, and from a later hello of another boot, session
or device back to where that leads. The moves are those of the session's table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.session.agreement import QUESTIONS_AT_ONCE, Agreement
from bridge.session.discovery import Answers
from bridge.session.key import SessionKey
from bridge.session.requests import SessionRequests
from bridge.session.states import (
    RESTLESS,
    TRANSITIONS,
    Agreed,
    Failed,
    Restless,
    SessionEvent,
    State,
    StateChanged,
)
from protocol.link import Medium
from protocol.messages import HostHello

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.clock import HostNs
    from protocol.link import LinkBase, Received
    from protocol.messages import Challenge, DescribeReply, Hello
    from protocol.schema.catalogue import Catalogue

ANSWER_PERIOD_NS = 100_000_000
HANDSHAKES_AT_ONCE = 3
"""Handshakes that may follow each other at once: a device that boots twice as it is plugged in."""
HANDSHAKE_PERIOD_NS = 1_000_000_000
"""Period of further handshakes, ns: that of a device's own hellos. A device that answers each of
our hellos with another boot id would else be answered as often as the link carries it."""


class Pace:
    """Bounds how often something is done: a few times at once, then once a period."""

    def __init__(self, at_once: int, period_ns: int) -> None:
        """All of ``at_once`` are free."""
        self._burst_ns = (at_once - 1) * period_ns
        self._period_ns = period_ns
        self._used_ns = 0
        """Until when all of them are free again."""

    def due_ns(self) -> int:
        """When the next may be done."""
        return self._used_ns - self._burst_ns

    def rested(self, now_ns: int) -> bool:
        """Whether all of them are free."""
        return now_ns >= self._used_ns

    def take(self, now_ns: int) -> None:
        """Do one."""
        self._used_ns = max(self._used_ns, now_ns) + self._period_ns


class SessionHandshake(SessionRequests):
    """The part of a session that agrees with a device; its clock is the session's."""

    def __init__(  # noqa: PLR0913 - what a session can be made with
        self,
        link: LinkBase,
        new_session_id: Callable[[], int],
        *,
        name: str,
        node: int | None,
        catalogue: Catalogue,
        key: bytes | None,
    ) -> None:
        super().__init__(link, node, catalogue)
        self.link = link
        self.state = State.CLOSED
        self.hello: Hello | None = None
        self.session_id = 0
        self._key = SessionKey(link, key)
        self._new_session_id = new_session_id
        self._name = name
        self._agreement = Agreement(catalogue, link)
        self._joined = False
        """The device has said that it is in our session."""
        self._pace = Pace(HANDSHAKES_AT_ONCE, HANDSHAKE_PERIOD_NS)
        self._greeted = False
        """The device has our hello for this handshake; else that waits for its turn."""
        self._renew = False
        """The next handshake begins another session."""
        self._restless = False
        """The device begins anew so often that it is not answered each time."""
        self._answers = Answers()
        self._opened_ns = 0
        self._next_ns = 0
        """When something is due."""
        self._tries = 0
        self._boot_known: int | None = None
        self._schema_known: int | None = None
        """The device's catalogue, as hashed, when the session was last ready."""
        self._events: list[SessionEvent] = []

    def set_key(self, key: bytes | None, now_ns: HostNs) -> None:
        """Sign with this key from now on, and ask for the challenge; None: sign nothing."""
        self._key.use(key)
        if key is not None and self.state is State.READY:
            self._send_hello(now_ns, agreed=1)

    @property
    def signs(self) -> bool:
        """Whether what moves the robot is signed: there is a key, and the device's challenge."""
        return self.link.key is not None and self.link.key.begun

    # ---- who is there ---------------------------------------------------------------------

    def _send_hello(self, now_ns: HostNs, *, agreed: int) -> None:
        self._outbox.send(
            HostHello(self._catalogue.hash, self.session_id, agreed, self._name), now_ns
        )

    def _ask(self, now_ns: HostNs) -> None:
        if self._agreement.settled:
            self._send_hello(now_ns, agreed=1)
            return
        for question in self._agreement.questions():
            self._outbox.send(question, now_ns)

    def _hello(self, hello: Hello, event: Received, now_ns: HostNs) -> None:
        if self.state is State.OPENING and self.link.medium is Medium.CAN:
            self._answers.note(hello, event, self._opened_ns, now_ns)
            return
        self._accept(hello, event.frame.node, now_ns)

    def _challenge(self, message: Challenge, event: Received, now_ns: HostNs) -> None:  # noqa: ARG002 - of every handler
        self._key.take(message, self.hello, self.session_id)

    def _choose(self, now_ns: HostNs) -> None:
        """Everybody on the bus has had time to answer: go on where it was one."""
        chosen = self._answers.choose()
        if isinstance(chosen, str):
            self._fail("no_device", "several", chosen)
        else:
            self._accept(*chosen, now_ns)

    def _accept(self, hello: Hello, node: int, now_ns: HostNs) -> None:
        known = self.hello
        if known is not None and known.uid != hello.uid:
            self._fail(
                "other_device",
                "other_device",
                f"another device answered: uid {hello.uid.hex()}, expected {known.uid.hex()}",
            )
            return
        if self.state in {State.OPENING, State.LOST}:
            self._outbox.node = node
            self._move("hello", "device answered")
            self._agree(hello, now_ns)
        elif self.state is State.READY:
            rebooted = known is not None and known.boot_id != hello.boot_id
            if rebooted or hello.session_id != self.session_id:
                self._move(
                    "rebooted" if rebooted else "forgotten",
                    "the device booted anew" if rebooted else "the device ended the session",
                )
                self._agree(hello, now_ns)
        elif self.state is State.AGREEING:
            if known is not None and (known.boot_id, known.catalogue_hash) != (
                hello.boot_id,
                hello.catalogue_hash,
            ):
                self._agree(hello, now_ns)
                return
            self.hello = hello
            if self._greeted and hello.session_id == self.session_id:
                self._joined = True

    def _agree(self, hello: Hello, now_ns: HostNs) -> None:
        """Start agreement with the device that says ``hello``, always in a new session.

        Where it begins anew too often, it is answered once a second.
        """
        self._renew = self._renew or self.hello is not None
        if self._boot_known is not None and self._boot_known != hello.boot_id:
            self.link.forget_sequence()
        self.hello = hello
        self._joined = False
        self._key.end()
        self._outbox.forget()
        self._agreement.begin(hello)
        self._greeted = False
        self._restless = self._restless and not self._pace.rested(now_ns)
        due_ns = self._pace.due_ns()
        if now_ns >= due_ns:
            self._greet(now_ns)
            return
        self._next_ns = due_ns
        if not self._restless:
            self._restless = True
            self._events.append(Restless(RESTLESS))

    def _greet(self, now_ns: HostNs) -> None:
        """Say hello in a session of its own, and ask the first questions."""
        self._pace.take(now_ns)
        self._greeted = True
        if self._renew:
            self._renew = False
            self.session_id = self._new_session_id()
        self._send_hello(now_ns, agreed=0)
        self._ask(now_ns)
        self._next_ns = now_ns + ANSWER_PERIOD_NS

    def _answer(self, reply: DescribeReply, event: Received, now_ns: HostNs) -> None:  # noqa: ARG002 - of every handler
        agreement = self._agreement
        if self.state is not State.AGREEING or not self._greeted or not agreement.answer(reply):
            return
        if not agreement.settled:
            # One answer, one new question; what is lost is asked again by the clock.
            for question in agreement.questions()[QUESTIONS_AT_ONCE - 1 :]:
                self._outbox.send(question, now_ns)
            return
        broken = agreement.apply()
        if broken is not None:
            self._fail("disagree", "disagreement", f"no common ground with the device: {broken}")
            return
        self._ask(now_ns)

    def _ready(self, now_ns: HostNs) -> None:
        hello = self.hello
        assert hello is not None  # noqa: S101 - set when agreement began
        assert self.node is not None  # noqa: S101 - set when agreement began
        again = self._boot_known is not None
        rebooted = again and self._boot_known != hello.boot_id
        other_schema = again and self._schema_known != hello.catalogue_hash
        self._boot_known, self._schema_known = hello.boot_id, hello.catalogue_hash
        self._tries = 0
        self._next_ns = now_ns
        self._move("agreed", "both ends agree")
        differences = self._agreement.differences
        self._events.append(Agreed(hello, self.node, rebooted, differences, again, other_schema))
        if self._open_stop is not None:
            self.stop(self._open_stop, now_ns)

    # ---- moves ----------------------------------------------------------------------------

    def _move(self, what: str, why: str) -> None:
        new = TRANSITIONS.get((self.state, what))
        if new is None:
            return
        if new is not self.state:
            self._events.append(StateChanged(self.state, new, why))
        self.state = new

    def _fail(self, what: str, kind: str, text: str) -> None:
        if (self.state, what) in TRANSITIONS:
            self._move(what, text)
            self._events.append(Failed(kind, text))
