"""States, transitions and events of a session."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from protocol.link import Received, Rejected
from protocol.uart.framing import DamagedFrame

if TYPE_CHECKING:
    from bridge.session.event_kinds import EventKind
    from protocol.clock import HostNs
    from protocol.messages.device import Hello
    from protocol.retransmission import Outcome
    from protocol.schema.comparison import Difference


class State(Enum):
    """State of a session."""

    CLOSED = "closed"
    OPENING = "opening"
    NEGOTIATING = "negotiating"
    READY = "ready"
    LOST = "lost"
    FAILED = "failed"


TRANSITIONS: dict[tuple[State, str], State] = {
    (State.CLOSED, "open"): State.OPENING,
    (State.OPENING, "hello"): State.NEGOTIATING,
    (State.OPENING, "no_device"): State.FAILED,
    (State.NEGOTIATING, "negotiated"): State.READY,
    (State.NEGOTIATING, "incompatible"): State.FAILED,
    (State.NEGOTIATING, "silence"): State.LOST,
    (State.NEGOTIATING, "unplugged"): State.LOST,
    (State.NEGOTIATING, "give_up"): State.FAILED,
    (State.READY, "silence"): State.LOST,
    (State.READY, "unplugged"): State.LOST,
    (State.READY, "rebooted"): State.NEGOTIATING,
    (State.READY, "forgotten"): State.NEGOTIATING,
    (State.LOST, "hello"): State.NEGOTIATING,
    (State.LOST, "other_device"): State.FAILED,
    (State.LOST, "give_up"): State.FAILED,
    (State.NEGOTIATING, "other_device"): State.FAILED,
    (State.READY, "other_device"): State.FAILED,
    **{(state, "close"): State.CLOSED for state in State},
}
"""Transition table from (state, cause) to the next state."""


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The session changed its state."""

    old: State
    new: State
    why: str


@dataclass(frozen=True, slots=True)
class SessionReady:
    """The session is ready: streams and commands may start."""

    hello: Hello
    node: int
    rebooted: bool
    """True if the device has a new boot id."""
    differences: tuple[Difference, ...] = ()
    again: bool = False
    """True if a session with this device was ready before."""
    other_schema: bool = False
    """True if the device's catalogue differs from its catalogue in the previous session."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The session cannot continue."""

    kind: EventKind
    """Reason: a kind of :class:`EventKind` for a session that cannot continue."""
    text: str


RESTLESS = (
    "the device restarts repeatedly: each hello has another boot id or session; the host answers "
    "once a second; check the device's supply and its reset line"
)


@dataclass(frozen=True, slots=True)
class Restless:
    """The device restarts so often that its handshakes are rate-limited; emitted once."""

    text: str


class Data(NamedTuple):
    """A telemetry message. It is a plain tuple, because one is created for each message."""

    received: Received
    arrived_ns: HostNs


@dataclass(frozen=True, slots=True)
class Ping:
    """A completed time exchange."""

    sent_ns: HostNs
    received_us: int
    replied_us: int
    arrived_ns: HostNs


class CommandEnded(NamedTuple):
    """A command was accepted or rejected, or received no answer."""

    outcome: Outcome


SessionEvent = (
    StateChanged
    | SessionReady
    | Failed
    | Restless
    | Data
    | Ping
    | CommandEnded
    | DamagedFrame
    | Rejected
)
