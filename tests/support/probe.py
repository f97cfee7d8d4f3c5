"""A minimal host for checks: it sends the requested messages and stores all received messages.

It depends only on the bytes of the device's port. So the checks apply to the emulator, to a
firmware in another emulator, and to a real robot.
"""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, cast

import pytest

from protocol.messages.device import (
    Ack,
    DescribeReply,
    Encoders,
    Hello,
    LinkCounters,
    Nack,
    Status,
    TimeReply,
)
from protocol.messages.host import (
    ClearStop,
    HostHello,
    SetMode,
    SetStreamRate,
    Stop,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.messages.values import Capability, Mode, NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.comparison import Comparison
from support.wire_probe import Heard, Ping, WireProbe, now_us, since

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.retransmission import Command
    from protocol.schema.message import Message

__all__ = ["Heard", "Ping", "Probe", "now_us", "since"]
TRY_S = 0.4
SETPOINT_S = 0.02
QUICK_STATUS = 500
"""Rate of the status message, tenths of a hertz. A change of state appears within one control
period of a host (20 ms).
"""


class Probe(WireProbe):
    """One port with one device behind it, and the messages of a host."""

    # ---- session --------------------------------------------------------------------------

    @property
    def boot_id(self) -> int:
        """Boot id that a hello must contain to open a session; 0 before the device has sent it."""
        return 0 if self.hello is None else self.hello.boot_id

    def send_hello(self, *, negotiated: int = 0, session_id: int | None = None) -> int:
        """Send a hello in the probe's session, or in another session."""
        session = self.session_id if session_id is None else session_id
        return self.send(
            HostHello(CATALOGUE.hash, session, self.boot_id, negotiated, "conformance")
        )

    def greet(self) -> Hello:
        """Open a session and return the device's answer; no schema is negotiated yet."""
        self.session_id = secrets.randbelow(0xFFFF_FFFE) + 1
        if self.link.key is not None:
            self.link.key.end()
        mark = len(self.received)
        for _ in range(5):
            self.send_hello()
            found = self.wait_for(Hello, TRY_S, mark=mark, alive=False)
            if found is None:
                continue
            assert isinstance(found.message, Hello)
            self.node, self.hello = found.frame.node, found.message
            if found.message.session_id == self.session_id:
                self._await_challenge(found.message)
                return found.message
            mark = len(self.received)
        raise AssertionError("the device does not answer a hello")

    def _await_challenge(self, hello: Hello) -> None:
        """Wait until commands can be signed, if the device has a key and the probe has one too."""
        key = self.link.key
        if key is not None and hello.capabilities & Capability.AUTHENTICATION:
            assert self.until(lambda: key.begun, TRY_S, alive=False), "no challenge after the hello"

    def handshake(self, *, quick_status: bool = True) -> Hello:
        """Open a session and complete the handshake, as a host does; then the device streams."""
        hello = self.greet()
        self._compare(hello)
        mark = len(self.received)
        for _ in range(5):
            self.send_hello(negotiated=1)
            if self.until(lambda: self._streams_since(mark), TRY_S, alive=False):
                break
        else:
            raise AssertionError("the device sends no stream after agreement")
        if quick_status:
            self.refusal(lambda i: SetStreamRate(i, 0x11, QUICK_STATUS))
        return hello

    def _streams_since(self, mark: int) -> bool:
        return any(not isinstance(h.message, Hello | DescribeReply) for h in self.received[mark:])

    def _compare(self, hello: Hello) -> None:
        codec = self.link.codec
        for spec in CATALOGUE:
            codec.limit(spec.type_id, None)
        self.link.disabled.clear()
        if hello.catalogue_hash == CATALOGUE.hash:
            return
        comparison = Comparison(CATALOGUE)
        for _ in range(100):
            mark = len(self.received)
            for question in comparison.questions(4):
                self.send(question)
            self.until(lambda m=mark: len(self.of(DescribeReply, m)) >= 4, 0.1)  # type: ignore[misc]  # bound now
            for reply in self.of(DescribeReply, mark):
                comparison.answer(reply)
            if comparison.complete:
                break
        assert comparison.complete, "the device does not answer every describe"
        for type_id, outcome in comparison.outcome.items():
            if not outcome.usable:
                self.link.disabled.add(type_id)
            elif outcome.shared_fields != len(outcome.spec.fields) or outcome.peer_fields != len(
                outcome.spec.fields
            ):
                codec.limit(type_id, outcome.shared_fields)

    def has(self, kind: type[Message]) -> bool:
        """Return whether the device supports this message."""
        return CATALOGUE.by_class[kind].type_id not in self.link.disabled

    def needs(self, what: Capability | type[Message] | bool, name: str = "") -> None:  # noqa: FBT001 - what is needed
        """Skip the test as not applicable if the device lacks a feature."""
        if isinstance(what, Capability):
            assert self.hello is not None
            present, name = bool(self.hello.capabilities & what), f"no {what.name} in its hello"
        elif isinstance(what, bool):
            present = what
        else:
            present, name = self.has(what), f"it does not declare {what.__name__}"
        if not present:
            pytest.skip(f"not applicable: {name}")

    # ---- questions and commands -----------------------------------------------------------

    def ping(self) -> Ping | None:
        """Ask for the device's time; return None without a reply."""
        number = self._next_ping()
        mark = len(self.received)
        sent_us = self.send(TimeRequest(number))
        found = self.wait_for(
            TimeReply, TRY_S, mark=mark, such=lambda r: r.ping == number, alive=False
        )
        if found is None:
            return None
        assert isinstance(found.message, TimeReply)
        return Ping(sent_us, found.message.received_us, found.frame.t_us, found.at_us)

    def alive(self) -> None:
        """Check that the device still answers."""
        assert any(self.ping() is not None for _ in range(5)), "the device no longer answers"

    def next_id(self) -> int:
        """Return a command id that was not used recently."""
        self._command_id = (self._command_id + 1) & 0xFFFF
        return self._command_id

    def reply_to(self, message: Message, *, flags: int = 0, node: int | None = None) -> Ack | Nack:
        """Send a command, repeatedly if necessary, and return the answer."""
        command_id = cast("Command", message).command_id
        type_id = CATALOGUE.by_class[type(message)].type_id
        mark = len(self.received)
        for _ in range(4):
            self.send(message, flags=flags, node=node)
            if self.until(lambda: bool(self.replies(command_id, type_id, mark)), TRY_S):
                return self.replies(command_id, type_id, mark)[0]
        raise AssertionError(f"no answer to {message}")

    def replies(self, command_id: int, type_id: int, mark: int = 0) -> list[Ack | Nack]:
        """Return the answers to one command."""
        return [
            h.message
            for h in self.received[mark:]
            if isinstance(h.message, Ack | Nack)
            and (h.message.command_id, h.message.command_type) == (command_id, type_id)
        ]

    def refusal(self, make: Callable[[int], Message]) -> NackReason | None:
        """Send a command; return the reason of its rejection, or None."""
        reply = self.reply_to(make(self.next_id()))
        return NackReason(reply.reason) if isinstance(reply, Nack) else None

    def stop(self, cause: int = StopCause.OPERATOR) -> None:
        """Latch a stop."""
        assert self.refusal(lambda i: Stop(i, cause)) is None

    def status(self) -> Status:
        """Return a status that was sampled after this call."""
        for _ in range(5):
            ping = self.ping()
            if ping is None:
                continue
            mark = len(self.received)
            if self.until(lambda m=mark, p=ping: self._status_after(m, p) is not None, TRY_S):  # type: ignore[misc]  # bound now
                status = self._status_after(mark, ping)
                assert status is not None
                return status
        raise AssertionError("the device sends no status")

    def _status_after(self, mark: int, ping: Ping) -> Status | None:
        for received in self.received[mark:]:
            if (
                isinstance(received.message, Status)
                and since(ping.replied_us, received.frame.t_us) > 0
            ):
                return received.message
        return None

    def counters(self) -> LinkCounters:
        """Return the device's present link counters."""
        self.needs(LinkCounters)
        if self.refusal(lambda i: SetStreamRate(i, 0x28, 200)) is None:
            ping = self.ping()
            found = self.wait_for(LinkCounters)
        else:
            ping = None
            found = self.wait_for(LinkCounters)
        while ping is not None and found is not None and since(ping.replied_us, found[2].t_us) < 0:
            found = self.wait_for(LinkCounters)
        assert found is not None, "the device sends no link counters"
        assert isinstance(found.message, LinkCounters)
        return found.message

    def free(self) -> None:
        """Clear the latched stop, if any."""
        for _ in range(3):
            cause = self.status().stop_cause
            if cause == StopCause.NONE:
                return
            reason = self.refusal(lambda i, c=cause: ClearStop(i, c))  # type: ignore[misc]  # bound now
            assert reason in {None, NackReason.OTHER_CAUSE}, f"cannot clear {cause}: {reason}"
        raise AssertionError("the device cannot be freed")

    def enter(self, mode: Mode) -> None:
        """Clear the stop and enter a mode with motion."""
        self.free()
        reason = self.refusal(lambda i: SetMode(i, mode))
        assert reason is None, f"mode {mode.name.lower()} refused: {reason}"

    # ---- motion ---------------------------------------------------------------------------

    def setpoint(
        self,
        v_m_s: float,
        yaw_rate_rad_s: float,
        *,
        ttl_ms: int = 200,
        counter: int | None = None,
        late_us: int = 0,
    ) -> int:
        """Send a velocity once; ``late_us`` makes it look that old."""
        message = VelocitySetpoint(
            round(v_m_s / 0.0001), round(yaw_rate_rad_s / 0.0002), ttl_ms, self._count(counter)
        )
        return self.send(message, stamp_us=now_us() - late_us)

    def duty(self, left: float, right: float, *, ttl_ms: int = 200) -> int:
        """Send wheel duties once."""
        return self.send(
            WheelDuty(round(left * 10_000), round(right * 10_000), ttl_ms, self._count(None))
        )

    def _count(self, counter: int | None) -> int:
        if counter is not None:
            return counter
        self._counter = (self._counter + 1) & 0xFF
        return self._counter

    def keep_saying(self, inform: Callable[[], int], duration_s: float) -> int:
        """Repeat a message at the rate of a host's control loop.

        Return our clock at the last one.
        """
        end_us = now_us() + round(duration_s * 1e6)
        reply_us = inform()
        while now_us() < end_us:
            self.until(lambda: False, SETPOINT_S, alive=False)
            reply_us = inform()
        return reply_us

    def counts(self) -> list[tuple[int, int, int]]:
        """Return stamps and both wheels' counts since the first kept sample, unwrapped."""
        out: list[tuple[int, int, int]] = []
        left = right = 0
        before: Encoders | None = None
        for received in self.received:
            if isinstance(received.message, Encoders):
                now = received.message
                if before is not None:
                    left += (now.left - before.left + 0x8000 & 0xFFFF) - 0x8000
                    right += (now.right - before.right + 0x8000 & 0xFFFF) - 0x8000
                before = now
                out.append((received.frame.t_us, left, right))
        return out
