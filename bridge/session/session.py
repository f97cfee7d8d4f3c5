"""A session with one device: hello, agreement, commands, heartbeats, loss and return.

Sans-I/O. States and the moves between them are a table; whoever owns the port feeds bytes
and time in and carries events and bytes out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.session.agreement import QUESTIONS_AT_ONCE, Agreement
from bridge.session.diagnosis import Evidence
from bridge.session.discovery import LISTEN_NS, Answers
from bridge.session.event_kinds import EventKind
from bridge.session.key import SessionKey
from bridge.session.outbox import CommandCounts, Outbox
from bridge.session.pace import Pace
from bridge.session.round_trip import RoundTrip
from bridge.session.states import (
    RESTLESS,
    TRANSITIONS,
    Agreed,
    CommandEnded,
    Data,
    Failed,
    Ping,
    Restless,
    SessionEvent,
    State,
    StateChanged,
)
from protocol.clock import HostNs
from protocol.commands import CommandSender
from protocol.link import LinkBase, Medium, Received, Rejected
from protocol.messages import (
    Ack,
    Challenge,
    ClearStop,
    DescribeReply,
    Hello,
    HostHello,
    Nack,
    SetMode,
    Stop,
    TimeReply,
)
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

HELLO_PERIOD_NS = 200_000_000
ANSWER_PERIOD_NS = 100_000_000
HANDSHAKES_AT_ONCE = 3
"""Handshakes that may follow each other at once: a device that boots twice as it is plugged in."""
HANDSHAKE_PERIOD_NS = 1_000_000_000
"""Period of further handshakes, ns: that of a device's own hellos. A device that answers each of
our hellos with another boot id would else be answered as often as the link carries it."""
OPEN_TIMEOUT_NS = 3_000_000_000
"""Three of the device's own hellos, which it sends at 1 Hz."""
AGREE_TIMEOUT_NS = 8_000_000_000
"""From opening to the first agreement: a device that is heard but never answers us."""
LOST_AFTER_NS = 1_000_000_000
FAST_PING_NS = 100_000_000
FAST_PINGS = 50
SLOW_PING_NS = 200_000_000
"""Period of pings after the first fifty, ns: at 5 Hz four pings show within a second that a link
has become slow, and the device, which holds us lost after 1 s, may lose a few."""
PING_SPREAD_NS = 16_000_000
"""By up to so much each comes early, the slowest adapter's period: in step with one that looks
every so often, each would wait for it as long as the one before, and none be quick."""
_GOLDEN_NS = round(PING_SPREAD_NS * 0.6180339887)
"""Moments so far apart fall evenly into a period, and into a whole part of it."""
_new = tuple.__new__
_BACKOFF_NS = (250_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)


class Session:
    """The host's end of a conversation with one device."""

    def __init__(  # noqa: PLR0913 - what a session can be made with
        self,
        new_session_id: Callable[[], int],
        *,
        name: str = "sweepctl",
        node: int | None = None,
        catalogue: Catalogue = CATALOGUE,
        link: type[LinkBase] = Link,
        key: bytes | None = None,
    ) -> None:
        """Make a closed session; ``new_session_id`` gives random non-zero 32-bit ids.

        With a ``key`` what moves the robot is signed, where the device asks for it.

        Raises:
            BadKeyError: the key has not 16 bytes.

        """
        self.link = made = link(Direction.HOST, codec=Codec(catalogue))
        self.state = State.CLOSED
        self.hello: Hello | None = None
        self.session_id = 0
        self._key = SessionKey(made, key)
        self._new_session_id = new_session_id
        self._name = name
        self._agreement = Agreement(catalogue, made)
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
        self._outbox = Outbox(made, node)
        self._catalogue = catalogue
        self._open_stop: int | None = None
        """Gravest cause of a stop that no device has confirmed yet; it outlives a lost link."""
        self._pings = 0
        self.round_trip = RoundTrip()
        """Of the pings since both ends agreed."""
        self._wanted_node = node
        self._evidence = Evidence()
        self._heard_ns = HostNs(0)
        self._handlers: dict[type[Message], Callable[[Any, Received, HostNs], None]] = {
            Hello: self._hello,
            DescribeReply: self._answer,
            Ack: self._reply,
            Nack: self._reply,
            TimeReply: self._time_reply,
            Challenge: self._challenge,
        }
        """What the session itself listens to; all else is telemetry."""

    # ---- in and out -----------------------------------------------------------------------

    def open(self, now_ns: HostNs) -> None:
        """Start to look for a device, any device: what was known of another is forgotten."""
        if self.state is not State.CLOSED:
            return
        self._opened_ns = self._next_ns = now_ns
        if self.link.medium is Medium.CAN:  # a hello would end another host's session
            self._next_ns = now_ns + LISTEN_NS
        self.hello = self._boot_known = self._schema_known = self._open_stop = None
        self._outbox.node = self._wanted_node
        self._evidence = Evidence()
        self._restless = self._renew = False
        self._answers.clear()
        self._move("open", "opened")
        self.session_id = self._new_session_id()
        # Replies name no session: ids that start anywhere are not those of an earlier host.
        self._outbox.commands = CommandSender(self.session_id & 0xFFFF)

    def close(self) -> None:
        """End; says nothing to the device."""
        self.commands.cancel()
        self._move("close", "closed")

    def unplugged(self, now_ns: HostNs) -> None:
        """The port has vanished: the device is lost without a second's wait."""
        if self.state in {State.READY, State.AGREEING}:
            self._lose(now_ns, "unplugged", "its port is gone")
        elif self.state is State.OPENING and self._evidence.words is not None:
            self._no_device()  # what is behind the port gave its reason, and would again

    def replugged(self, now_ns: HostNs) -> None:
        """A port is there again: ask at once who is on it."""
        if self.state is State.LOST:
            self._tries = 0
            self._next_ns = now_ns

    def receive(self, data: bytes, now_ns: HostNs) -> list[SessionEvent]:
        """Take bytes from the port."""
        ready = State.READY
        if self.state is not ready:
            self._evidence.hear(data)
        events, handlers = self._events, self._handlers
        for event in self.link.receive(data, now_ns // 1000):
            if type(event) is Received:
                node = self._outbox.node
                if node is None or event[1][1] == node:
                    self._heard_ns = now_ns
                    if self.state is ready and event[0].__class__ not in handlers:
                        events.append(_new(Data, (event, now_ns)))  # nearly all of them
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
        """Do what time asks for: hellos, questions, pings, retries, and noticing silence."""
        state = self.state
        if (  # what it nearly always is, said first: this is asked at every turn of a loop
            state is State.READY
            and now_ns < self._next_ns
            and now_ns - self._heard_ns <= LOST_AFTER_NS
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
        """Draw conclusions from silence, and from what was heard by now."""
        if self.state in {State.READY, State.AGREEING}:
            if now_ns - self._heard_ns > LOST_AFTER_NS:
                self._lose(now_ns)
        elif self._others_talk:
            self._no_device()
        elif self._answers.settled_ns is not None and now_ns >= self._answers.settled_ns:
            self._choose(now_ns)
        elif self.state is State.OPENING and now_ns - self._opened_ns > OPEN_TIMEOUT_NS:
            self._no_device()
        if (
            self.state in {State.AGREEING, State.LOST}
            and self._boot_known is None
            and now_ns - self._opened_ns > AGREE_TIMEOUT_NS
        ):
            if self._restless:
                self._fail("give_up", EventKind.RESTLESS, RESTLESS)
            else:
                self._fail(
                    "give_up",
                    EventKind.DEAF,
                    "the device is heard but does not answer; check the wire from this host's TX "
                    "to its RX",
                )

    def data_to_send(self) -> bytes:
        """Bytes for the port."""
        return self.link.data_to_send()

    def next_deadline(self) -> HostNs | None:
        """When :meth:`poll` has work next; None where nothing is awaited."""
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
    def heard_ns(self) -> HostNs:
        """When the device's last intact frame came; 0: never."""
        return self._heard_ns

    # ---- what its user asks for -----------------------------------------------------------

    @property
    def node(self) -> int | None:
        """The device's node; None until one has answered, or while any will do."""
        return self._outbox.node

    @property
    def commands(self) -> CommandSender:
        """Commands on their way."""
        return self._outbox.commands

    @property
    def command_counts(self) -> CommandCounts:
        """What became of all commands so far."""
        return self._outbox.counts

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity; it replaces one that still waits to be written.

        What is faster than the wire can say is sent as the fastest that it can.
        """
        self._outbox.setpoint(v_m_s, yaw_rate_rad_s, ttl_ms, now_ns)

    def duty(self, left: float, right: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send motor duties, -1..1, which a device obeys in bring-up mode only, capped."""
        self._outbox.duty(left, right, ttl_ms, now_ns)

    def stop(self, cause: int, now_ns: HostNs) -> int:
        """Latch a stop, repeated until the device has said yes, in a later session if need be.

        It is sent at once in any state: a device obeys a stop outside a session too.
        """
        self._open_stop = max(cause, self._open_stop or 0)
        return self._command(Stop, cause, now_ns, forever=True)

    def clear_stop(self, cause: int, now_ns: HostNs) -> int:
        """Release a latched stop of this cause."""
        return self._command(ClearStop, cause, now_ns)

    def set_mode(self, mode: int, now_ns: HostNs) -> int:
        """Choose what moves the wheels."""
        return self._command(SetMode, mode, now_ns)

    def command(self, kind: type[Message], fields: tuple[int, ...], now_ns: HostNs) -> int:
        """Send any other command, its fields after the id; gives the id."""
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
        """Sign with this key from now on, and ask for the challenge; None: sign nothing."""
        self._key.use(key)
        if key is not None and self.state is State.READY:
            self._send_hello(now_ns, agreed=1)

    @property
    def signs(self) -> bool:
        """Whether what moves the robot is signed: there is a key, and the device's challenge."""
        return self.link.key is not None and self.link.key.begun

    # ---- inside ---------------------------------------------------------------------------

    def _drain(self) -> list[SessionEvent]:
        events = self._events
        if events:
            self._events = []
            return events
        return []

    def _periodic(self, now_ns: HostNs) -> None:
        match self.state:
            case State.OPENING:
                self._send_hello(now_ns, agreed=0)
                self._next_ns = now_ns + HELLO_PERIOD_NS
            case State.AGREEING:
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
                self._send_hello(now_ns, agreed=0)
                self._next_ns = now_ns + _BACKOFF_NS[min(self._tries, len(_BACKOFF_NS) - 1)]
                self._tries += 1
            case _:
                pass

    def _handle(self, event: Received, now_ns: HostNs) -> None:
        handler = self._handlers.get(event.message.__class__)
        if handler is not None:
            handler(event.message, event, now_ns)
        elif self.state is State.AGREEING and self._agreement.settled and self._joined:
            if not self._key.allows(self.hello):
                return  # the next hello brings the challenge
            # Telemetry flows once the device knows that we agree; but what comes before it has
            # named our session may still be of an earlier one.
            self._ready(now_ns)
            self.round_trip.begin(now_ns)
        state = self.state
        if state is State.READY or (state is State.AGREEING and handler == self._hello):
            self._events.append(Data(event, now_ns))

    def _reply(self, reply: Ack | Nack, event: Received, now_ns: HostNs) -> None:  # noqa: ARG002 - of every handler
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
            turnaround_us = (event.frame.t_us - reply.received_us) & 0xFFFF_FFFF
            self.round_trip.answered(sent_ns, now_ns, turnaround_us)
            self._events.append(Ping(sent_ns, reply.received_us, event.frame.t_us, now_ns))

    @property
    def _others_talk(self) -> bool:
        """On a bus that we are about to use, another host does."""
        bus = self.link.medium is Medium.CAN
        return bus and self.state is State.OPENING and self._evidence.echoes > 0

    def _lose(
        self, now_ns: HostNs, what: str = "silence", why: str = "nothing heard for 1 s"
    ) -> None:
        self._tries = 0
        self._next_ns = now_ns
        self.commands.cancel()
        self._move(what, why)

    def _no_device(self) -> None:
        kind, text = self._evidence.verdict(self.link.medium, self.link.statistics.damaged)
        self._fail("no_device", kind, text)

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
            self._fail("no_device", EventKind.SEVERAL, chosen)
        else:
            self._accept(*chosen, now_ns)

    def _accept(self, hello: Hello, node: int, now_ns: HostNs) -> None:
        known = self.hello
        if known is not None and known.uid != hello.uid:
            self._fail(
                "other_device",
                EventKind.OTHER_DEVICE,
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
            self._fail(
                "disagree", EventKind.DISAGREEMENT, f"no common ground with the device: {broken}"
            )
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

    def _fail(self, what: str, kind: EventKind, text: str) -> None:
        if (self.state, what) in TRANSITIONS:
            self._move(what, text)
            self._events.append(Failed(kind, text))
