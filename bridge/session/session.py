"""A session with one device: handshake, commands, pings, loss and reconnection.

Sans-I/O. The transitions are a table (:mod:`bridge.session.states`). The caller owns the port. It
passes received bytes and the time to the session, and gets events and bytes to send.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.session.backoff import backoff_ns
from bridge.session.diagnosis import Evidence
from bridge.session.discovery import LISTEN_NS, Answers
from bridge.session.event_kinds import EventKind
from bridge.session.key import SessionKey
from bridge.session.negotiation import QUESTIONS_AT_ONCE, SchemaNegotiation
from bridge.session.outbox import CommandCounts, Outbox
from bridge.session.round_trip import RoundTrip
from bridge.session.states import (
    RESTLESS,
    TRANSITIONS,
    CommandEnded,
    Data,
    Failed,
    Ping,
    Restless,
    SessionEvent,
    SessionReady,
    State,
    StateChanged,
)
from bridge.session.token_bucket import TokenBucket
from protocol.clock import HostNs, elapsed_us
from protocol.link import LinkBase, Medium, Received, Rejected
from protocol.messages.device import (
    Ack,
    Challenge,
    DescribeEnumReply,
    DescribeReply,
    Hello,
    Nack,
    TimeReply,
)
from protocol.messages.host import ClearStop, HostHello, SetMode, Stop, StopAll
from protocol.messages.values import StopCause
from protocol.retransmission import CommandSender
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

HELLO_PERIOD_NS = 200_000_000
"""Interval of hellos while no device answers, ns."""
ANSWER_PERIOD_NS = 100_000_000
"""Interval of repeated questions during the handshake, ns."""
HANDSHAKES_AT_ONCE = 3
"""Number of handshakes allowed without a pause. A device may boot twice when it is plugged in."""
HANDSHAKE_PERIOD_NS = 1_000_000_000
"""Interval of further handshakes, ns. It equals the interval of the device's own hellos, and limits
the traffic with a device that answers each hello with a new boot id."""
OPEN_TIMEOUT_NS = 3_000_000_000
"""Maximum wait for a device, ns. In this time the device sends three hellos."""
HANDSHAKE_TIMEOUT_NS = 8_000_000_000
"""Maximum time from opening to a complete handshake, ns. It ends the wait for a device that sends
but never answers."""
LOST_AFTER_NS = 1_000_000_000
"""Silence after which the device counts as lost, ns."""
FAST_PING_NS = 100_000_000
"""Interval of the first pings, ns."""
FAST_PINGS = 50
"""Number of pings at the fast interval."""
SLOW_PING_NS = 200_000_000
"""Interval of later pings, ns. At 5 Hz, four pings detect a slow link within 1 s. The device counts
the host as lost after 1 s, so a few pings may be lost."""
PING_SPREAD_NS = 16_000_000
"""Maximum time by which a ping is early, ns. It is the latency timer of the slowest adapter. If all
pings were in phase with this timer, all would wait for the same time and none would be fast."""
_GOLDEN_NS = round(PING_SPREAD_NS * 0.6180339887)
"""Change of the early time from ping to ping, ns. The golden ratio spreads the pings evenly over
the period."""
_new = tuple.__new__


class Session:
    """The host's side of a session with one device."""

    def __init__(  # noqa: PLR0913 - the options of a session
        self,
        new_session_id: Callable[[], int],
        *,
        name: str = "sweepctl",
        node: int | None = None,
        catalogue: Catalogue = CATALOGUE,
        link: type[LinkBase] = Link,
        key: bytes | None = None,
    ) -> None:
        """Create a closed session.

        Args:
            new_session_id: Returns a random 32-bit id other than 0.
            name: Name of the host in its hello.
            node: Node of the device; None: the only device that answers.
            catalogue: Messages of the host.
            link: Framing for the port: serial or CAN.
            key: 16-byte key that signs motion commands if the device requires it.

        Raises:
            BadKeyError: the key is not 16 bytes long.

        """
        self.link = made = link(Direction.HOST, codec=Codec(catalogue))
        self.state = State.CLOSED
        self.hello: Hello | None = None
        self.session_id = 0
        self._key = SessionKey(made, key)
        self._new_session_id = new_session_id
        self._name = name
        self._negotiation = SchemaNegotiation(catalogue, made)
        self._joined = False
        """True if the device has confirmed this session."""
        self._handshakes = TokenBucket(HANDSHAKES_AT_ONCE, HANDSHAKE_PERIOD_NS)
        self._greeted = False
        """True if the host's hello of this handshake is sent. If False, the hello waits for the
        rate limit."""
        self._renew = False
        """True if the next handshake needs a new session id."""
        self._restless = False
        """True if the device restarts so often that handshakes are rate-limited."""
        self._answers = Answers()
        self._opened_ns = 0
        self._next_ns = 0
        """Time of the next periodic transmission, ns."""
        self._tries = 0
        self._boot_known: int | None = None
        self._schema_known: int | None = None
        """The device's catalogue hash when the session was last ready."""
        self._events: list[SessionEvent] = []
        self._outbox = Outbox(made, node)
        self._catalogue = catalogue
        self._open_stop: int | None = None
        """Highest cause of an unconfirmed stop. It is not cleared if the link is lost."""
        self._pings = 0
        self.round_trip = RoundTrip()
        """Round-trip times since the session became ready."""
        self._wanted_node = node
        self._evidence = Evidence()
        self._last_frame_ns = HostNs(0)
        self._handlers: dict[type[Message], Callable[[Any, Received, HostNs], None]] = {
            Hello: self._hello,
            DescribeReply: self._answer,
            DescribeEnumReply: self._answer,
            Ack: self._reply,
            Nack: self._reply,
            TimeReply: self._time_reply,
            Challenge: self._challenge,
        }
        """Messages that the session handles; all others are telemetry."""

    # ---- input and output ------------------------------------------------------------------

    def open(self, now_ns: HostNs) -> None:
        """Start to search for a device; discard the data of the previous device."""
        if self.state is not State.CLOSED:
            return
        self._opened_ns = self._next_ns = now_ns
        if self.link.medium is Medium.CAN:  # listen: a hello would end another host's session
            self._next_ns = now_ns + LISTEN_NS
        self.hello = self._boot_known = self._schema_known = self._open_stop = None
        self._outbox.node = self._wanted_node
        self._evidence = Evidence()
        self._restless = self._renew = False
        self._answers.clear()
        self.fire("open", "opened")
        self.session_id = self._new_session_id()
        # Replies contain no session id. A random first command id differs from an earlier host's
        # command ids.
        self._outbox.commands = CommandSender(self.session_id & 0xFFFF)

    def close(self) -> None:
        """Close the session; send nothing."""
        self.commands.cancel()
        self.fire("close", "closed")

    def unplugged(self, now_ns: HostNs) -> None:
        """Enter the lost state at once, because the port is gone."""
        if self.state in {State.READY, State.NEGOTIATING}:
            self._lose(now_ns, "unplugged", "its port is gone")
        elif self.state is State.OPENING and self._evidence.text_line is not None:
            self._no_device()  # a port server has sent its reason

    def replugged(self, now_ns: HostNs) -> None:
        """Search for the device on the reopened port at once."""
        if self.state is State.LOST:
            self._tries = 0
            self._next_ns = now_ns

    def receive(self, data: bytes, now_ns: HostNs) -> list[SessionEvent]:
        """Handle bytes from the port; return the events."""
        ready = State.READY
        if self.state is not ready:
            self._evidence.add(data)
        events, handlers = self._events, self._handlers
        for event in self.link.receive(data, now_ns // 1000):
            if type(event) is Received:
                node = self._outbox.node
                if node is None or event[1][1] == node:
                    self._last_frame_ns = now_ns
                    if self.state is ready and event[0].__class__ not in handlers:
                        events.append(_new(Data, (event, now_ns)))  # the usual case
                    else:
                        self._handle(event, now_ns)
                elif self.state is State.OPENING:
                    self._evidence.nodes.add(event[1][1])
            elif not isinstance(event, Received):
                if isinstance(event, Rejected):
                    self._evidence.note(event)
                self._events.append(event)
        return self._drain()

    def poll(self, now_ns: HostNs) -> list[SessionEvent]:
        """Handle due hellos, questions, pings, retries and timeouts; return the events."""
        state = self.state
        if (  # the usual case first: every pass of the loop gets here
            state is State.READY
            and now_ns < self._next_ns
            and now_ns - self._last_frame_ns <= LOST_AFTER_NS
            and self._outbox.commands.rests(now_ns // 1000)
        ):
            return self._drain()
        self._notice(now_ns)
        if now_ns >= self._next_ns:
            self._periodic(now_ns)
        if self.state is State.READY:
            self._events += map(CommandEnded, self._outbox.repeat(now_ns))
        return self._drain()

    def _notice(self, now_ns: HostNs) -> None:
        """Handle silence and the end of waiting times."""
        if self.state in {State.READY, State.NEGOTIATING}:
            if now_ns - self._last_frame_ns > LOST_AFTER_NS:
                self._lose(now_ns)
        elif self._others_talk:
            self._no_device()
        elif self._answers.settled_ns is not None and now_ns >= self._answers.settled_ns:
            self._choose(now_ns)
        elif self.state is State.OPENING and now_ns - self._opened_ns > OPEN_TIMEOUT_NS:
            self._no_device()
        if (
            self.state in {State.NEGOTIATING, State.LOST}
            and self._boot_known is None
            and now_ns - self._opened_ns > HANDSHAKE_TIMEOUT_NS
        ):
            if self._restless:
                self._fail("give_up", EventKind.RESTLESS, RESTLESS)
            else:
                self._fail(
                    "give_up",
                    EventKind.TRANSMIT_ONLY,
                    "the device is received but does not answer; check the wire from the host's TX "
                    "to the device's RX",
                )

    def data_to_send(self) -> bytes:
        """Return and remove the bytes to write to the port."""
        return self.link.data_to_send()

    def next_deadline(self) -> HostNs | None:
        """Return the next time at which :meth:`poll` is due; None if closed or failed."""
        state = self.state
        if state is State.CLOSED or state is State.FAILED:
            return None
        deadline_ns = self._next_ns
        settled_ns = self._answers.settled_ns
        if settled_ns is not None and settled_ns < deadline_ns:
            deadline_ns = settled_ns
        if state is State.READY:
            due_us = self._outbox.commands.next_deadline_us()
            if due_us is not None and (due_us + 1) * 1000 < deadline_ns:
                deadline_ns = (due_us + 1) * 1000
        return HostNs(deadline_ns)

    @property
    def last_frame_ns(self) -> HostNs:
        """Arrival time of the device's last intact frame, ns; 0: none."""
        return self._last_frame_ns

    # ---- commands ---------------------------------------------------------------------------

    @property
    def node(self) -> int | None:
        """The device's node; None before the first answer if any node is accepted."""
        return self._outbox.node

    @property
    def commands(self) -> CommandSender:
        """The commands that wait for an answer."""
        return self._outbox.commands

    @property
    def command_counts(self) -> CommandCounts:
        """Number of commands by result."""
        return self._outbox.counts

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity setpoint; it replaces a setpoint that is not written yet.

        Args:
            v_m_s: Forward speed, m/s; limited to the range of the wire format.
            yaw_rate_rad_s: Yaw rate, rad/s; limited to the range of the wire format.
            ttl_ms: Time to live on the device, ms.
            now_ns: Host time.

        Raises:
            ValueError: a velocity is NaN.

        """
        self._outbox.setpoint(v_m_s, yaw_rate_rad_s, ttl_ms, now_ns)

    def duty(self, left: float, right: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send motor duties, -1..1.

        The device limits them, and accepts them in bring-up mode only.
        """
        self._outbox.duty(left, right, ttl_ms, now_ns)

    def stop(self, cause: int, now_ns: HostNs) -> int:
        """Latch a stop of this cause; in a session, repeat it until the device confirms it.

        The stop is sent in any state, because a device obeys a stop outside a session too. Outside
        a session it is sent once, and an unconfirmed stop is sent again in the next session. If no
        device has answered yet, an operator's stop is sent to every device on the port. Returns
        the command id.
        """
        self._open_stop = max(cause, self._open_stop or 0)
        if self._outbox.node is None and cause >= StopCause.OPERATOR:
            self._outbox.send(StopAll(), now_ns)
        return self._command(Stop, cause, now_ns, forever=True)

    def clear_stop(self, cause: int, now_ns: HostNs) -> int:
        """Release a latched stop of this cause; return the command id."""
        return self._command(ClearStop, cause, now_ns)

    def set_mode(self, mode: int, now_ns: HostNs) -> int:
        """Choose the source of motion; return the command id."""
        return self._command(SetMode, mode, now_ns)

    def command(self, kind: type[Message], fields: tuple[int, ...], now_ns: HostNs) -> int:
        """Send another command with these fields after the id; return the id."""
        type_id = self._catalogue.by_class[kind].type_id
        return self._outbox.command(lambda i: kind(i, *fields), type_id, now_ns, forever=False)  # type: ignore[call-arg]  # a command's first field is its id

    def _command(
        self,
        message: Callable[[int, int], Message],
        value: int,
        now_ns: HostNs,
        *,
        forever: bool = False,
    ) -> int:
        type_id = self._catalogue.by_class[message].type_id  # type: ignore[index]  # a class
        return self._outbox.command(lambda i: message(i, value), type_id, now_ns, forever=forever)

    def set_key(self, key: bytes | None, now_ns: HostNs) -> None:
        """Sign with this key from now on and request a challenge; None: sign nothing."""
        self._key.use(key)
        if key is not None and self.state is State.READY:
            self._send_hello(now_ns, negotiated=1)

    @property
    def signs(self) -> bool:
        """True if motion commands are signed: a key is set and its challenge has arrived."""
        return self.link.key is not None and self.link.key.begun

    # ---- state ------------------------------------------------------------------------------

    def _drain(self) -> list[SessionEvent]:
        events = self._events
        if events:
            self._events = []
            return events
        return []

    def _periodic(self, now_ns: HostNs) -> None:
        match self.state:
            case State.OPENING:
                self._send_hello(now_ns, negotiated=0)
                self._next_ns = now_ns + HELLO_PERIOD_NS
            case State.NEGOTIATING:
                if self._greeted:
                    self._ask(now_ns)
                    self._next_ns = now_ns + ANSWER_PERIOD_NS
                else:
                    self._greet(now_ns)
            case State.READY:
                self._outbox.ping(now_ns)
                fast = self._tries < FAST_PINGS
                self._tries += 1
                self._pings += 1
                early_ns = self._pings * _GOLDEN_NS % PING_SPREAD_NS
                self._next_ns = now_ns + (FAST_PING_NS if fast else SLOW_PING_NS) - early_ns
            case State.LOST:
                self._send_hello(now_ns, negotiated=0)
                self._next_ns = now_ns + backoff_ns(self._tries)
                self._tries += 1
            case _:
                pass

    def _handle(self, event: Received, now_ns: HostNs) -> None:
        handler = self._handlers.get(event.message.__class__)
        if handler is not None:
            handler(event.message, event, now_ns)
        elif self.state is State.NEGOTIATING and self._negotiation.settled and self._joined:
            if not self._key.allows(self.hello):
                return  # the next hello brings the challenge
            # Telemetry starts after the device has confirmed this session. Frames received before
            # that confirmation may belong to an earlier session.
            self._ready(now_ns)
            self.round_trip.begin(now_ns)
        state = self.state
        if state is State.READY or (state is State.NEGOTIATING and handler == self._hello):
            self._events.append(Data(event, now_ns))

    def _reply(self, reply: Ack | Nack, event: Received, now_ns: HostNs) -> None:  # noqa: ARG002 - the signature of every handler
        outcome = self._outbox.commands.reply(reply, now_ns // 1000)
        if outcome is not None:
            message = outcome.message
            if (
                isinstance(message, Stop)
                and outcome.accepted
                and message.cause >= (self._open_stop or 0)
            ):
                self._open_stop = None
            self._outbox.counts.rejected += not outcome.accepted
            self._events.append(CommandEnded(outcome))

    def _time_reply(self, reply: TimeReply, event: Received, now_ns: HostNs) -> None:
        sent_ns = self._outbox.pinged_ns(reply.ping)
        if sent_ns is not None:
            turnaround_us = elapsed_us(reply.received_us, event.frame.t_us)
            self.round_trip.answered(sent_ns, now_ns, turnaround_us)
            self._events.append(Ping(sent_ns, reply.received_us, event.frame.t_us, now_ns))

    @property
    def _others_talk(self) -> bool:
        """Another host sends on the bus that this session is about to use."""
        bus = self.link.medium is Medium.CAN
        return bus and self.state is State.OPENING and self._evidence.echoes > 0

    def _lose(
        self, now_ns: HostNs, what: str = "silence", why: str = "nothing received for 1 s"
    ) -> None:
        self._tries = 0
        self._next_ns = now_ns
        self.commands.cancel()
        self.fire(what, why)

    def _no_device(self) -> None:
        kind, text = self._evidence.verdict(self.link.medium, self.link.statistics.damaged)
        self._fail("no_device", kind, text)

    # ---- handshake --------------------------------------------------------------------------

    def _send_hello(self, now_ns: HostNs, *, negotiated: int) -> None:
        self._outbox.send(
            HostHello(
                self._catalogue.hash,
                self.session_id,
                0 if self.hello is None else self.hello.boot_id,
                negotiated,
                self._name,
            ),
            now_ns,
        )

    def _ask(self, now_ns: HostNs) -> None:
        if self._negotiation.settled:
            self._send_hello(now_ns, negotiated=1)
            return
        for question in self._negotiation.questions():
            self._outbox.send(question, now_ns)

    def _hello(self, hello: Hello, event: Received, now_ns: HostNs) -> None:
        if self.state is State.OPENING and self.link.medium is Medium.CAN:
            self._answers.note(hello, event, self._opened_ns, now_ns)
            return
        self._accept(hello, event.frame.node, now_ns)

    def _challenge(self, message: Challenge, event: Received, now_ns: HostNs) -> None:  # noqa: ARG002 - the signature of every handler
        self._key.take(message, self.hello, self.session_id)

    def _choose(self, now_ns: HostNs) -> None:
        """Continue with the only device on the bus; fail if there are several."""
        chosen = self._answers.choose()
        if isinstance(chosen, str):
            self._fail("no_device", EventKind.SEVERAL, chosen)
        else:
            self._accept(*chosen, now_ns)

    def _accept(self, hello: Hello, node: int, now_ns: HostNs) -> None:
        known = self.hello
        if known is not None and known.uid != hello.uid:
            self._fail(
                "other_device",
                EventKind.OTHER_DEVICE,
                f"another device answered: uid {hello.uid.hex()}, expected {known.uid.hex()}; "
                "connect the expected device or open a new session",
            )
            return
        if self.state in {State.OPENING, State.LOST}:
            self._outbox.node = node
            self.fire("hello", "device answered")
            self._negotiate(hello, now_ns)
        elif self.state is State.READY:
            rebooted = known is not None and known.boot_id != hello.boot_id
            if rebooted or hello.session_id != self.session_id:
                self.fire(
                    "rebooted" if rebooted else "forgotten",
                    "the device rebooted" if rebooted else "the device ended the session",
                )
                self._negotiate(hello, now_ns)
        elif self.state is State.NEGOTIATING:
            if known is not None and (known.boot_id, known.catalogue_hash) != (
                hello.boot_id,
                hello.catalogue_hash,
            ):
                self._negotiate(hello, now_ns)
                return
            self.hello = hello
            if self._greeted and hello.session_id == self.session_id:
                self._joined = True

    def _negotiate(self, hello: Hello, now_ns: HostNs) -> None:
        """Start schema negotiation with the device that sent ``hello``, in a new session.

        The rate limit delays it if the device restarts too often.
        """
        self._renew = self._renew or self.hello is not None
        if self._boot_known is not None and self._boot_known != hello.boot_id:
            self.link.forget_sequence()
        self.hello = hello
        self._joined = False
        self._key.end()
        self._outbox.forget()
        self._negotiation.begin(hello)
        self._greeted = False
        self._restless = self._restless and not self._handshakes.rested(now_ns)
        due_ns = self._handshakes.due_ns()
        if now_ns >= due_ns:
            self._greet(now_ns)
            return
        self._next_ns = due_ns
        if not self._restless:
            self._restless = True
            self._events.append(Restless(RESTLESS))

    def _greet(self, now_ns: HostNs) -> None:
        """Send the hello of this handshake and the first questions."""
        self._handshakes.take(now_ns)
        self._greeted = True
        if self._renew:
            self._renew = False
            self.session_id = self._new_session_id()
        self._send_hello(now_ns, negotiated=0)
        self._ask(now_ns)
        self._next_ns = now_ns + ANSWER_PERIOD_NS

    def _answer(
        self,
        reply: DescribeReply | DescribeEnumReply,
        event: Received,  # noqa: ARG002 - the signature of every handler
        now_ns: HostNs,
    ) -> None:
        negotiation = self._negotiation
        if (
            self.state is not State.NEGOTIATING
            or not self._greeted
            or not negotiation.answer(reply)
        ):
            return
        if not negotiation.settled:
            # One reply, one new question. Lost questions are repeated by `poll`.
            for question in negotiation.questions()[QUESTIONS_AT_ONCE - 1 :]:
                self._outbox.send(question, now_ns)
            return
        broken = negotiation.apply()
        if broken is not None:
            self._fail(
                "incompatible",
                EventKind.INCOMPATIBLE,
                f"host and device are incompatible: {broken}",
            )
            return
        self._ask(now_ns)

    def _ready(self, now_ns: HostNs) -> None:
        hello = self.hello
        assert hello is not None  # noqa: S101 - set at the start of the negotiation
        assert self.node is not None  # noqa: S101 - set at the start of the negotiation
        again = self._boot_known is not None
        rebooted = again and self._boot_known != hello.boot_id
        other_schema = again and self._schema_known != hello.catalogue_hash
        self._boot_known, self._schema_known = hello.boot_id, hello.catalogue_hash
        self._tries = 0
        self._next_ns = now_ns
        self.fire("negotiated", "host and device are compatible")
        differences = self._negotiation.differences
        self._events.append(
            SessionReady(hello, self.node, rebooted, differences, again, other_schema)
        )
        if self._open_stop is not None:
            self.stop(self._open_stop, now_ns)

    # ---- transitions ------------------------------------------------------------------------

    def fire(self, what: str, why: str) -> None:
        """Fire an event of the transition table.

        Ignore an event that the table does not contain.
        """
        new = TRANSITIONS.get((self.state, what))
        if new is None:
            return
        if new is not self.state:
            self._events.append(StateChanged(self.state, new, why))
        self.state = new

    def _fail(self, what: str, kind: EventKind, text: str) -> None:
        if (self.state, what) in TRANSITIONS:
            self.fire(what, text)
            self._events.append(Failed(kind, text))
