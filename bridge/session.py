"""A session with one device: hello, agreement, commands, heartbeats, loss and return.

Sans-I/O. States and the moves between them are a table; whoever owns the port feeds bytes
and time in and carries events and bytes out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.session_events import (
    TRANSITIONS,
    Agreed,
    CommandEnded,
    Data,
    Failed,
    Ping,
    SessionEvent,
    State,
    StateChanged,
)
from bridge.session_evidence import Evidence
from protocol.agreement import Comparison
from protocol.catalogue import CATALOGUE, Catalogue
from protocol.clock import HostNs
from protocol.codec import Codec
from protocol.commands import CommandSender
from protocol.link import NODE_ALL, Link, LinkBase, Medium, Received, Rejected
from protocol.message import Direction, Message
from protocol.messages import (
    Ack,
    ClearStop,
    DescribeReply,
    Hello,
    HostHello,
    Nack,
    SetMode,
    Stop,
    TimeReply,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.uart import FLAG_RETRY

if TYPE_CHECKING:
    from collections.abc import Callable

HELLO_PERIOD_NS = 200_000_000
ANSWER_PERIOD_NS = 100_000_000
OPEN_TIMEOUT_NS = 3_000_000_000
"""Three of the device's own hellos, which it sends at 1 Hz."""
AGREE_TIMEOUT_NS = 8_000_000_000
"""From opening to the first agreement: a device that is heard but never answers us."""
LOST_AFTER_NS = 1_000_000_000
FAST_PING_NS = 100_000_000
FAST_PINGS = 50
SLOW_PING_NS = 250_000_000
"""Four a second: the device holds us lost after 1 s, and one or two lost pings are normal."""
QUESTIONS_AT_ONCE = 4
LISTEN_NS = 300_000_000
"""On a bus: a host that is there already sends more than one ping in this time."""
SETTLE_NS = 300_000_000
"""On a bus every device answers the first hello at once: what else there is is heard by then."""
_BACKOFF_NS = (250_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)


class Session:
    """The host's end of a conversation with one device."""

    def __init__(
        self,
        new_session_id: Callable[[], int],
        *,
        name: str = "sweepctl",
        node: int | None = None,
        catalogue: Catalogue = CATALOGUE,
        link: type[LinkBase] = Link,
    ) -> None:
        """Make a closed session; ``new_session_id`` gives random non-zero 32-bit ids."""
        self.state = State.CLOSED
        self.link = link(Direction.HOST, codec=Codec(catalogue))
        self.commands = CommandSender()
        self.hello: Hello | None = None
        self.node = node
        self.session_id = 0
        self._wanted_node = node
        self._new_session_id = new_session_id
        self._name = name
        self._catalogue = catalogue
        self._comparison: Comparison | None = None
        self._joined = False
        """The device has said that it is in our session."""
        self._open_stop: int | None = None
        """Cause of a stop that no device has confirmed yet; it outlives a lost link."""
        self._evidence = Evidence()
        self._answers: dict[tuple[int, bytes], Received] = {}
        """On a bus: who answered, by node and uid, until it is known that no other does."""
        self._settled_ns: HostNs | None = None
        self._opened_ns = 0
        self._heard_ns = HostNs(0)
        self._next_ns = 0
        self._tries = 0
        self._pings: dict[int, HostNs] = {}
        self._ping = 0
        self._setpoint_counter = 0
        self._boot_known: int | None = None
        self._events: list[SessionEvent] = []

    # ---- in and out -----------------------------------------------------------------------

    def open(self, now_ns: HostNs) -> None:
        """Start to look for a device, any device: what was known of another is forgotten."""
        if self.state is not State.CLOSED:
            return
        self._opened_ns = self._next_ns = now_ns
        if self.link.medium is Medium.CAN:  # a hello would end another host's session
            self._next_ns = now_ns + LISTEN_NS
        self.hello = self._boot_known = self._open_stop = None
        self.node = self._wanted_node
        self._evidence = Evidence()
        self._answers.clear()
        self._settled_ns = None
        self._move("open", "opened")
        self.session_id = self._new_session_id()
        # Replies name no session: ids that start anywhere are not those of an earlier host.
        self.commands = CommandSender(self.session_id & 0xFFFF)

    def close(self) -> None:
        """End; says nothing to the device."""
        self.commands.cancel()
        self._move("close", "closed")

    def receive(self, data: bytes, now_ns: HostNs) -> list[SessionEvent]:
        """Take bytes from the port."""
        self._evidence.received += len(data)
        for event in self.link.receive(data, now_ns // 1000):
            if isinstance(event, Received):
                if self.node is None or event.frame.node == self.node:
                    self._heard_ns = now_ns
                    self._handle(event, now_ns)
            else:
                if isinstance(event, Rejected):
                    self._evidence.note(event)
                self._events.append(event)
        return self._drain()

    def poll(self, now_ns: HostNs) -> list[SessionEvent]:
        """Do what time asks for: hellos, questions, pings, retries, and noticing silence."""
        if self.state in {State.READY, State.AGREEING}:
            if now_ns - self._heard_ns > LOST_AFTER_NS:
                self._lose(now_ns)
        elif self._others_talk:
            self._no_device()
        elif self._settled_ns is not None and now_ns >= self._settled_ns:
            self._choose(now_ns)
        elif self.state is State.OPENING and now_ns - self._opened_ns > OPEN_TIMEOUT_NS:
            self._no_device()
        if (
            self.state in {State.AGREEING, State.LOST}
            and self._boot_known is None
            and now_ns - self._opened_ns > AGREE_TIMEOUT_NS
        ):
            self._fail(
                "give_up",
                "deaf",
                "the device is heard but does not answer; check the wire from this host's TX "
                "to its RX",
            )
        if now_ns >= self._next_ns:
            self._periodic(now_ns)
        if self.state is State.READY:
            messages, outcomes = self.commands.due(now_ns // 1000)
            for message, retry in messages:
                self._send(message, now_ns, flags=FLAG_RETRY if retry else 0)
            self._events += [CommandEnded(o) for o in outcomes]
        return self._drain()

    def data_to_send(self) -> bytes:
        """Bytes for the port."""
        return self.link.data_to_send()

    def next_deadline(self) -> HostNs | None:
        """When :meth:`poll` has work next; None where nothing is awaited."""
        if self.state in {State.CLOSED, State.FAILED}:
            return None
        deadlines = [self._next_ns]
        if self._settled_ns is not None:
            deadlines.append(self._settled_ns)
        if self.state is State.READY:
            due_us = self.commands.next_deadline_us()
            if due_us is not None:
                deadlines.append((due_us + 1) * 1000)
        return min(deadlines)  # type: ignore[return-value]  # all of them host nanoseconds

    @property
    def heard_ns(self) -> HostNs:
        """When the device's last intact frame came; 0: never."""
        return self._heard_ns

    # ---- what a user of the session asks for ----------------------------------------------

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity; it replaces one that still waits to be written.

        What is faster than the wire can say is sent as the fastest that it can.
        """
        self._setpoint_counter = (self._setpoint_counter + 1) & 0xFF
        message = VelocitySetpoint(
            _raw(v_m_s / 0.0001), _raw(yaw_rate_rad_s / 0.0002), ttl_ms, self._setpoint_counter
        )
        self._send(message, now_ns, latest=True)

    def stop(self, cause: int, now_ns: HostNs) -> int:
        """Latch a stop, repeated until the device has said yes, in a later session if need be.

        It is sent at once in any state: a device obeys a stop outside a session too.
        """
        self._open_stop = cause
        return self._command(Stop, cause, now_ns, forever=True)

    def clear_stop(self, cause: int, now_ns: HostNs) -> int:
        """Release a latched stop of this cause."""
        return self._command(ClearStop, cause, now_ns)

    def set_mode(self, mode: int, now_ns: HostNs) -> int:
        """Choose what moves the wheels."""
        return self._command(SetMode, mode, now_ns)

    def _command(
        self,
        message: Callable[[int, int], Message],
        value: int,
        now_ns: HostNs,
        *,
        forever: bool = False,
    ) -> int:
        type_id = self._catalogue.by_class[message].type_id  # type: ignore[index]  # a class
        command_id = self.commands.issue(
            lambda i: message(i, value), type_id, now_ns // 1000, forever=forever
        )
        for made, retry in self.commands.due(now_ns // 1000)[0]:
            self._send(made, now_ns, flags=FLAG_RETRY if retry else 0)
        return command_id

    # ---- inside ---------------------------------------------------------------------------

    def _send(
        self, message: Message, now_ns: HostNs, *, flags: int = 0, latest: bool = False
    ) -> None:
        node = NODE_ALL if self.node is None else self.node
        self.link.send(message, now_ns // 1000, node=node, flags=flags, latest=latest)

    def _move(self, what: str, why: str) -> None:
        new = TRANSITIONS.get((self.state, what))
        if new is None:
            return
        if new is not self.state:
            self._events.append(StateChanged(self.state, new, why))
        self.state = new

    def _drain(self) -> list[SessionEvent]:
        events, self._events = self._events, []
        return events

    def _periodic(self, now_ns: HostNs) -> None:
        match self.state:
            case State.OPENING:
                self._send_hello(now_ns, agreed=0)
                self._next_ns = now_ns + HELLO_PERIOD_NS
            case State.AGREEING:
                self._ask(now_ns)
                self._next_ns = now_ns + ANSWER_PERIOD_NS
            case State.READY:
                self._send_ping(now_ns)
                fast = self._tries < FAST_PINGS
                self._tries += 1
                self._next_ns = now_ns + (FAST_PING_NS if fast else SLOW_PING_NS)
            case State.LOST:
                self._send_hello(now_ns, agreed=0)
                self._next_ns = now_ns + _BACKOFF_NS[min(self._tries, len(_BACKOFF_NS) - 1)]
                self._tries += 1
            case _:
                pass

    def _send_hello(self, now_ns: HostNs, *, agreed: int) -> None:
        self._send(HostHello(self._catalogue.hash, self.session_id, agreed, self._name), now_ns)

    def _send_ping(self, now_ns: HostNs) -> None:
        self._ping = (self._ping + 1) & 0xFF
        self._pings[self._ping] = now_ns
        if len(self._pings) > 16:  # noqa: PLR2004 - four seconds of pings without an answer
            del self._pings[next(iter(self._pings))]
        # On a port that takes nothing, pings must not queue up behind each other.
        self._send(TimeRequest(self._ping), now_ns, latest=True)

    def _ask(self, now_ns: HostNs) -> None:
        comparison = self._comparison
        if comparison is None or comparison.complete:
            self._send_hello(now_ns, agreed=1)
            return
        for question in comparison.questions(QUESTIONS_AT_ONCE):
            self._send(question, now_ns)

    def _handle(self, event: Received, now_ns: HostNs) -> None:
        message = event.message
        match message:
            case Hello():
                self._hello(message, event, now_ns)
            case DescribeReply():
                self._answer(message, now_ns)
            case Ack() | Nack():
                outcome = self.commands.reply(message, now_ns // 1000)
                if outcome is not None:
                    if isinstance(outcome.message, Stop) and outcome.accepted:
                        self._open_stop = None
                    self._events.append(CommandEnded(outcome))
            case TimeReply():
                sent_ns = self._pings.pop(message.ping, None)
                if sent_ns is not None:
                    self._events.append(
                        Ping(sent_ns, message.received_us, event.frame.t_us, now_ns)
                    )
            case _:
                # Telemetry flows once the device knows that we agree; but what comes before it
                # has named our session may still be of an earlier one.
                if self.state is State.AGREEING and self._settled and self._joined:
                    self._ready(now_ns)
        told = State.AGREEING if isinstance(message, Hello) else State.READY
        if self.state in {State.READY, told}:
            self._events.append(Data(event, now_ns))

    @property
    def _settled(self) -> bool:
        return self._comparison is None or self._comparison.complete

    def _hello(self, hello: Hello, event: Received, now_ns: HostNs) -> None:
        if self.state is State.OPENING and self.link.medium is Medium.CAN:
            if self._settled_ns is None:
                said_ns = max(now_ns, self._opened_ns + LISTEN_NS)
                self._settled_ns = HostNs(said_ns + SETTLE_NS)
            self._answers[event.frame.node, hello.uid] = event
            return
        self._accept(hello, event.frame.node, now_ns)

    @property
    def _others_talk(self) -> bool:
        """On a bus that we are about to use, another host does."""
        bus = self.link.medium is Medium.CAN
        return bus and self.state is State.OPENING and self._evidence.echoes > 0

    def _choose(self, now_ns: HostNs) -> None:
        """Everybody on the bus has had time to answer: go on where it was one."""
        self._settled_ns = None
        answers = dict(sorted(self._answers.items()))
        self._answers.clear()
        if len(answers) == 1:
            ((node, _), event) = answers.popitem()
            if isinstance(event.message, Hello):
                self._accept(event.message, node, now_ns)
            return
        named = "; ".join(
            f"node {node}: {hello.name} {hello.version_major}.{hello.version_minor}."
            f"{hello.version_patch}, uid {uid.hex()}"
            for (node, uid), event in answers.items()
            if isinstance(hello := event.message, Hello)
        )
        advice = "choose one with --node N"
        if len({node for node, _ in answers}) < len(answers):
            advice = "two devices may not share a node"
        self._fail("no_device", "several", f"several devices answer; {advice} ({named})")

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
            self.node = node
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
            self._joined = self._joined or hello.session_id == self.session_id

    def _agree(self, hello: Hello, now_ns: HostNs) -> None:
        """Start agreement with the device that says ``hello``, always in a new session."""
        if self.hello is not None:
            self.session_id = self._new_session_id()
        if self._boot_known is not None and self._boot_known != hello.boot_id:
            self.link.forget_sequence()
        self.hello = hello
        self._joined = False
        self.commands.cancel()
        self._pings.clear()
        for spec in self._catalogue:  # what an earlier agreement said may be wrong now
            self.link.codec.limit(spec.type_id, None)
        self.link.disabled.clear()
        same = hello.catalogue_hash == self._catalogue.hash
        self._comparison = None if same else Comparison(self._catalogue)
        self._send_hello(now_ns, agreed=0)
        self._ask(now_ns)
        self._next_ns = now_ns + ANSWER_PERIOD_NS

    def _answer(self, reply: DescribeReply, now_ns: HostNs) -> None:
        comparison = self._comparison
        if self.state is not State.AGREEING or comparison is None:
            return
        if not comparison.answer(reply):
            return
        if not comparison.complete:
            # One answer, one new question; what is lost is asked again by the clock.
            for question in comparison.questions(QUESTIONS_AT_ONCE)[QUESTIONS_AT_ONCE - 1 :]:
                self._send(question, now_ns)
            return
        broken = [a for a in comparison.outcome.values() if not a.usable and a.spec.bootstrap]
        if broken:
            lines = "; ".join(a.report() for a in broken)
            self._fail("disagree", "disagreement", f"no common ground with the device: {lines}")
            return
        for type_id, agreement in comparison.outcome.items():
            if agreement.usable:
                shared = agreement.shared_fields
                equal = shared == len(agreement.spec.fields) == agreement.peer_fields
                self.link.codec.limit(type_id, None if equal else shared)
                self.link.disabled.discard(type_id)
            else:
                self.link.disabled.add(type_id)
        self._ask(now_ns)

    def _ready(self, now_ns: HostNs) -> None:
        hello = self.hello
        assert hello is not None  # noqa: S101 - set when agreement began
        assert self.node is not None  # noqa: S101 - set when agreement began
        rebooted = self._boot_known is not None and self._boot_known != hello.boot_id
        self._boot_known = hello.boot_id
        self._tries = 0
        self._next_ns = 0
        self._move("agreed", "both ends agree")
        outcome = self._comparison.outcome.values() if self._comparison else ()
        self._events.append(
            Agreed(
                hello, self.node, rebooted, tuple(a for a in outcome if a.match.value != "equal")
            )
        )
        if self._open_stop is not None:
            self.stop(self._open_stop, now_ns)

    def _lose(self, now_ns: HostNs) -> None:
        self._tries = 0
        self._next_ns = now_ns
        self.commands.cancel()
        self._move("silence", "nothing heard for 1 s")

    def _no_device(self) -> None:
        kind, text = self._evidence.verdict(self.link.medium, self.link.statistics.damaged)
        self._fail("no_device", kind, text)

    def _fail(self, what: str, kind: str, text: str) -> None:
        if (self.state, what) in TRANSITIONS:
            self._move(what, text)
            self._events.append(Failed(kind, text))


def _raw(steps: float) -> int:
    """To the wire's 16 bits, or the nearest that they hold."""
    return round(min(32767.0, max(-32767.0, steps)))
