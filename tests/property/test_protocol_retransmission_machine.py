"""Every command ends correctly over a wire with loss, duplicates, delay and reordering.

Whole frames pass through two hostile wires between two links. Framing, sequence numbers, sender
and log therefore work as in a session.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from protocol.link import Received
from protocol.messages.device import Ack, Nack
from protocol.messages.host import ClearStop, SetMode, Stop
from protocol.retransmission import MAX_TIMEOUT_US, MAX_TRIES, REMEMBERED, CommandLog, CommandSender
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link
from support.hostile import BitFlips, Delayed, Duplicating, Lossy, Pipe, Wire

TYPES = {Stop: 0x01, ClearStop: 0x05, SetMode: 0x06}
LONGEST_US = MAX_TRIES * MAX_TIMEOUT_US
"""Maximum duration of a command that may end without an answer, µs."""


@dataclass
class Device:
    """The executing end; it rejects odd command ids with the id modulo 3 as the reason."""

    link: Link = field(default_factory=lambda: Link(Direction.DEVICE))
    log: CommandLog = field(default_factory=CommandLog)
    done: list[tuple[int, int]] = field(default_factory=list)
    """(session, command id) of every executed or rejected command in order, except stops."""
    stopped: set[int] = field(default_factory=set)
    """Ids of the executed stops."""

    def take(self, data: bytes, session_id: int, now_us: int) -> list[bytes]:
        replies: list[bytes] = []
        for event in self.link.receive(data):
            if isinstance(event, Received):
                reply = self.obey(event.message, session_id)
                if reply is None:
                    continue
                self.link.send(reply, now_us, node=1)
                replies.append(self.link.data_to_send())
        return replies

    def obey(self, message: Message, session_id: int) -> Ack | Nack | None:
        assert isinstance(message, Stop | ClearStop | SetMode)
        command_id = message.command_id

        reason = command_id % 3 if command_id % 2 else None

        def act() -> int | None:
            self.done.append((session_id, command_id))
            return reason

        if isinstance(message, Stop):  # a stop is executed each time it arrives
            self.stopped.add(command_id)
            stop = TYPES[Stop]
            return Ack(command_id, stop) if reason is None else Nack(command_id, stop, reason)
        return self.log.once(session_id, TYPES[type(message)], message, act)


class CommandsOverAHostileWire(RuleBasedStateMachine):
    """Issue commands at random times over two wires with random faults."""

    @initialize(
        seed=st.integers(0, 2**32),
        p=st.sampled_from([0.0, 0.2, 0.5]),
        delay_us=st.sampled_from([0, 5_000, 300_000]),
        first_id=st.sampled_from([1, 0xFFFD]),
    )
    def connect(self, seed: int, p: float, delay_us: int, first_id: int) -> None:
        rng = Random(seed)

        def wire() -> Wire:
            line: Wire = Duplicating(Lossy(Pipe(500), p=p, rng=rng), p=p / 2, rng=rng)
            line = Delayed(line, rng, low_us=0, high_us=delay_us, reorder=True)
            return BitFlips(line, p=p / 4, rng=rng)

        self.there, self.back = wire(), wire()
        self.link = Link(Direction.HOST)
        self.sender = CommandSender(first_id)
        self.device = Device()
        self.now_us = 0
        self.waiting: dict[int, tuple[type[Message], int]] = {}
        """Kind and issue time of each waiting command, by its id."""
        self.ended: dict[int, str] = {}

    @rule(kind=st.sampled_from([Stop, ClearStop, SetMode]))
    def issue(self, kind: type[Stop | ClearStop | SetMode]) -> None:
        if len(self.waiting) >= REMEMBERED:
            return  # the device remembers no more commands at once
        command_id = self.sender.issue(
            lambda i: kind(i, 1), TYPES[kind], self.now_us, forever=kind is Stop
        )
        assert command_id not in self.waiting
        self.waiting[command_id] = (kind, self.now_us)

    @rule(for_us=st.sampled_from([1_000, 20_000, 150_000, 1_000_000]))
    def wait(self, for_us: int) -> None:
        until_us = self.now_us + for_us
        while True:
            moments = [self.sender.next_deadline_us(), self.there.next_us(), self.back.next_us()]
            next_us = min((m for m in moments if m is not None), default=until_us + 1)
            if next_us > until_us:
                break
            self.now_us = max(self.now_us, next_us)
            self.step()
        self.now_us = until_us

    def step(self) -> None:
        messages, outcomes = self.sender.due(self.now_us)
        for message, _ in messages:
            self.link.send(message, self.now_us, node=1)
            self.there.push(self.link.data_to_send(), self.now_us)
        for outcome in outcomes:
            assert outcome.timed_out
            self.end(outcome.message, "silence")
        for data in self.there.pull(self.now_us):
            for reply in self.device.take(data, 7, self.now_us):
                self.back.push(reply, self.now_us)
        for data in self.back.pull(self.now_us):
            for event in self.link.receive(data):
                if isinstance(event, Received):
                    assert isinstance(event.message, Ack | Nack)
                    answered = self.sender.reply(event.message, self.now_us)
                    if answered:
                        verdict = "accepted" if answered.accepted else f"no {answered.reason}"
                        self.end(answered.message, verdict)

    def end(self, message: Message, verdict: str) -> None:
        assert isinstance(message, Stop | ClearStop | SetMode)
        command_id = message.command_id
        assert command_id in self.waiting, "ended twice"
        del self.waiting[command_id]
        self.ended[command_id] = verdict
        device = self.device
        carried_out = command_id in device.stopped or (7, command_id) in device.done
        if verdict == "silence":
            assert not isinstance(message, Stop)  # a stop is repeated until its reply arrives
        else:
            assert carried_out
            expected = f"no {command_id % 3}" if command_id % 2 else "accepted"
            assert verdict == expected

    @invariant()
    def nothing_is_carried_out_twice(self) -> None:
        done = self.device.done
        assert len(set(done)) == len(done)

    @invariant()
    def nothing_waits_for_ever_but_stop(self) -> None:
        for command_id, (kind, at_us) in self.waiting.items():
            assert kind is Stop or self.now_us - at_us <= LONGEST_US, command_id

    def teardown(self) -> None:
        """Repair the line and check that every command ends, including stops."""
        if not hasattr(self, "sender"):
            return
        self.there, self.back = Pipe(500), Pipe(500)
        self.wait(LONGEST_US + MAX_TIMEOUT_US)
        assert not self.waiting
        assert self.sender.idle
        self.nothing_is_carried_out_twice()


TestCommandsOverAHostileWire = CommandsOverAHostileWire.TestCase
TestCommandsOverAHostileWire.settings = settings(max_examples=60, stateful_step_count=25)
