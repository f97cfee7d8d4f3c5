"""What a session sends: velocities, pings and commands, each in its own manner."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.commands import CommandSender
from protocol.errors import ProtocolError
from protocol.link import NODE_ALL
from protocol.messages import TimeRequest, VelocitySetpoint, WheelDuty
from protocol.uart.framing import FLAG_RETRY

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.clock import HostNs
    from protocol.commands import Outcome
    from protocol.link import LinkBase
    from protocol.schema.message import Message

_PINGS_KEPT = 64
"""Pings that wait for their answer: at 10 Hz more than 6 s of them, so that the round trip of a
very slow link is measured too."""


@dataclass(slots=True)
class CommandCounts:
    """Of a session object's life."""

    issued: int = 0
    retried: int = 0
    """Sendings beyond each command's first."""
    rejected: int = 0
    unanswered: int = 0


class Outbox:
    """Gives messages to the link, and keeps what must be told apart when the answer comes."""

    def __init__(self, link: LinkBase, node: int | None) -> None:
        self.node = node
        """Whom it is sent to; None: every device."""
        self.commands = CommandSender()
        self.counts = CommandCounts()
        self._link = link
        self._pings: dict[int, HostNs] = {}
        self._ping = 0
        self._setpoint_counter = 0

    def send(
        self, message: Message, now_ns: HostNs, *, flags: int = 0, latest: bool = False
    ) -> None:
        """Queue a message; with ``latest`` it replaces one of its type that still waits."""
        node = NODE_ALL if self.node is None else self.node
        self._link.send(message, now_ns // 1000, node=node, flags=flags, latest=latest)

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity, or the fastest that the wire can say.

        Raises:
            ValueError: a velocity is not a number.

        """
        _check(v_m_s, yaw_rate_rad_s, "velocity")
        self._setpoint_counter = counter = (self._setpoint_counter + 1) & 0xFF
        v, yaw_rate = _raw(v_m_s / 0.0001), _raw(yaw_rate_rad_s / 0.0002)
        node = NODE_ALL if self.node is None else self.node
        message = VelocitySetpoint(v, yaw_rate, ttl_ms, counter)
        self._link.send(message, now_ns // 1000, node=node, latest=True)

    def duty(self, left: float, right: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send motor duties, or the greatest that the wire can say.

        Raises:
            ValueError: a duty is not a number.

        """
        _check(left, right, "duty")
        self._setpoint_counter = counter = (self._setpoint_counter + 1) & 0xFF
        raw = [round(10_000 * max(-1.0, min(1.0, duty))) for duty in (left, right)]
        self.send(WheelDuty(raw[0], raw[1], ttl_ms, counter), now_ns, latest=True)

    def ping(self, now_ns: HostNs) -> None:
        """Ask for the device's time."""
        self._ping = (self._ping + 1) & 0xFF
        self._pings[self._ping] = now_ns
        if len(self._pings) > _PINGS_KEPT:
            del self._pings[next(iter(self._pings))]
        # On a port that takes nothing, pings must not queue up behind each other.
        self.send(TimeRequest(self._ping), now_ns, latest=True)

    def pinged_ns(self, ping: int) -> HostNs | None:
        """When the ping went out that is answered now; None for one that is not awaited."""
        return self._pings.pop(ping, None)

    def command(
        self, make: Callable[[int], Message], type_id: int, now_ns: HostNs, *, forever: bool
    ) -> int:
        """Send a command made from its id, repeated until answered; gives the id.

        Raises:
            FieldRangeError: a value does not fit its field; nothing is sent or awaited.

        """
        # What else is due waits for the clock's turn, which tells what became of it.
        command_id, message = self.commands.start(make, type_id, now_ns // 1000, forever=forever)
        try:
            self.send(message, now_ns)
        except ProtocolError:
            self.commands.withdraw(command_id)  # or every repetition would raise
            raise
        self.counts.issued += 1
        return command_id

    def repeat(self, now_ns: HostNs) -> list[Outcome]:
        """Send the commands that are due, again or for the first time; those given up."""
        messages, outcomes = self.commands.due(now_ns // 1000)
        for message, retry in messages:
            self.send(message, now_ns, flags=FLAG_RETRY if retry else 0)
            self.counts.retried += retry
        self.counts.unanswered += len(outcomes)
        return outcomes

    def forget(self) -> None:
        """Await no answer any more: the session is another."""
        self.commands.cancel()
        self._pings.clear()


def _check(first: float, second: float, what: str) -> None:
    """Refuse what is not a number: no comparison holds for it, so a limit would let it pass.

    Raises:
        ValueError: one is not a number.

    """
    if math.isnan(first) or math.isnan(second):
        raise ValueError(f"not a {what}: {first}, {second}")


def _raw(steps: float) -> int:
    """To the wire's 16 bits, or the nearest that they hold."""
    if -32767.0 <= steps <= 32767.0:  # noqa: PLR2004 - what 16 bits hold, on both sides of 0
        return round(steps)
    return 32767 if steps > 0.0 else -32767
