"""Outgoing messages of a session: setpoints, pings and commands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.errors import ProtocolError
from protocol.link import NODE_ALL
from protocol.messages.host import TimeRequest, VelocitySetpoint, WheelDuty
from protocol.retransmission import CommandSender
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.clock import HostNs
    from protocol.link import LinkBase
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

_V_STEP, _YAW_RATE_STEP = (float(f.scale) for f in CATALOGUE.spec(VelocitySetpoint).fields[:2])
"""Resolution of a velocity setpoint, m/s and rad/s."""
_DUTY_ONE = int(1 / CATALOGUE.spec(WheelDuty).fields[0].scale)
"""Number of steps of a full duty."""
_PINGS_KEPT = 64
"""Maximum number of pings that wait for a reply. They cover 6 s at 10 Hz, so that the round trip of
a very slow link is measured too."""


@dataclass(slots=True)
class CommandCounts:
    """Number of commands by result, since the session object was created."""

    issued: int = 0
    retried: int = 0
    """Repetitions after the first transmission."""
    rejected: int = 0
    unanswered: int = 0


class Outbox:
    """Passes messages to the link and matches replies to pings and commands."""

    def __init__(self, link: LinkBase, node: int | None) -> None:
        self.node = node
        """Destination node; None: every device."""
        self.commands = CommandSender()
        self.counts = CommandCounts()
        self._link = link
        self._pings: dict[int, HostNs] = {}
        self._ping = 0
        self._setpoint_counter = 0

    def send(
        self, message: Message, now_ns: HostNs, *, flags: int = 0, latest: bool = False
    ) -> None:
        """Queue a message; ``latest`` replaces a queued message of the same type."""
        node = NODE_ALL if self.node is None else self.node
        self._link.send(message, now_ns // 1000, node=node, flags=flags, latest=latest)

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity setpoint, limited to the range of the wire format.

        Raises:
            ValueError: a velocity is NaN.

        """
        _check(v_m_s, yaw_rate_rad_s, "velocity")
        self._setpoint_counter = counter = (self._setpoint_counter + 1) & 0xFF
        v, yaw_rate = _raw(v_m_s / _V_STEP), _raw(yaw_rate_rad_s / _YAW_RATE_STEP)
        node = NODE_ALL if self.node is None else self.node
        message = VelocitySetpoint(v, yaw_rate, ttl_ms, counter)
        self._link.send(message, now_ns // 1000, node=node, latest=True)

    def duty(self, left: float, right: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send motor duties, limited to -1..1.

        Raises:
            ValueError: a duty is NaN.

        """
        _check(left, right, "duty")
        self._setpoint_counter = counter = (self._setpoint_counter + 1) & 0xFF
        raw = [round(_DUTY_ONE * max(-1.0, min(1.0, duty))) for duty in (left, right)]
        self.send(WheelDuty(raw[0], raw[1], ttl_ms, counter), now_ns, latest=True)

    def ping(self, now_ns: HostNs) -> None:
        """Request the device's time."""
        self._ping = (self._ping + 1) & 0xFF
        self._pings[self._ping] = now_ns
        if len(self._pings) > _PINGS_KEPT:
            del self._pings[next(iter(self._pings))]
        # If the port accepts no bytes, only the newest ping waits.
        self.send(TimeRequest(self._ping), now_ns, latest=True)

    def pinged_ns(self, ping: int) -> HostNs | None:
        """Return the transmission time of an answered ping; None if the ping is unknown."""
        return self._pings.pop(ping, None)

    def command(
        self, make: Callable[[int], Message], type_id: int, now_ns: HostNs, *, forever: bool
    ) -> int:
        """Send a command and repeat it until it is answered. Return its id.

        Args:
            make: Creates the message from its command id.
            type_id: Message type.
            now_ns: Host time.
            forever: Repeat without a limit.

        Raises:
            FieldRangeError: a value does not fit its field; nothing is sent.

        """
        if self.node is None:  # no device to send it to yet
            self.counts.issued += 1
            return self.commands.issue(make, type_id, now_ns // 1000, forever=forever)
        # Other due commands wait for the next `repeat`, which reports their outcomes.
        command_id, message = self.commands.start(make, type_id, now_ns // 1000, forever=forever)
        try:
            self.send(message, now_ns)
        except ProtocolError:
            self.commands.withdraw(command_id)  # otherwise every repetition raises
            raise
        self.counts.issued += 1
        return command_id

    def repeat(self, now_ns: HostNs) -> list[Outcome]:
        """Send the due commands; return the outcomes of the commands that received no answer."""
        messages, outcomes = self.commands.due(now_ns // 1000)
        for message, retry in messages:
            self.send(message, now_ns)
            self.counts.retried += retry
        self.counts.unanswered += len(outcomes)
        return outcomes

    def forget(self) -> None:
        """Discard all open commands and pings of a session."""
        self.commands.cancel()
        self._pings.clear()


def _check(first: float, second: float, what: str) -> None:
    """Reject NaN, which passes every limit because its comparisons are false.

    Raises:
        ValueError: a value is NaN.

    """
    if math.isnan(first) or math.isnan(second):
        raise ValueError(f"{what} is not a number: {first}, {second}")


def _raw(steps: float) -> int:
    """Round to a 16-bit integer and limit it to -32767..32767."""
    if -32767.0 <= steps <= 32767.0:  # noqa: PLR2004 - symmetric 16-bit range
        return round(steps)
    return 32767 if steps > 0.0 else -32767
