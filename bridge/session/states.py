"""Where a session may stand, how it may move, and what it tells."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from protocol.link import Received, Rejected
from protocol.uart.framing import DamagedFrame

if TYPE_CHECKING:
    from bridge.session.event_kinds import EventKind
    from protocol.clock import HostNs
    from protocol.commands import Outcome
    from protocol.messages import Hello
    from protocol.schema.agreement import MessageAgreement


class State(Enum):
    """Where a session stands."""

    CLOSED = "closed"
    OPENING = "opening"
    AGREEING = "agreeing"
    READY = "ready"
    LOST = "lost"
    FAILED = "failed"


TRANSITIONS: dict[tuple[State, str], State] = {
    (State.CLOSED, "open"): State.OPENING,
    (State.OPENING, "hello"): State.AGREEING,
    (State.OPENING, "no_device"): State.FAILED,
    (State.AGREEING, "agreed"): State.READY,
    (State.AGREEING, "disagree"): State.FAILED,
    (State.AGREEING, "silence"): State.LOST,
    (State.AGREEING, "unplugged"): State.LOST,
    (State.AGREEING, "give_up"): State.FAILED,
    (State.READY, "silence"): State.LOST,
    (State.READY, "unplugged"): State.LOST,
    (State.READY, "rebooted"): State.AGREEING,
    (State.READY, "forgotten"): State.AGREEING,
    (State.LOST, "hello"): State.AGREEING,
    (State.LOST, "other_device"): State.FAILED,
    (State.LOST, "give_up"): State.FAILED,
    (State.AGREEING, "other_device"): State.FAILED,
    (State.READY, "other_device"): State.FAILED,
    **{(state, "close"): State.CLOSED for state in State},
}
"""Every legal move: (state, what happened) → next state."""


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The session moved."""

    old: State
    new: State
    why: str


@dataclass(frozen=True, slots=True)
class Agreed:
    """Both ends know what they share; streams and commands may start."""

    hello: Hello
    node: int
    rebooted: bool
    """True where the device is not in the boot that we knew."""
    differences: tuple[MessageAgreement, ...] = ()
    again: bool = False
    """True where a session with this device was ready before."""
    other_schema: bool = False
    """True where it declares its messages otherwise than it did then."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The session cannot go on."""

    kind: EventKind
    """Of those that say why a session cannot go on."""
    text: str


RESTLESS = (
    "the device begins anew again and again: each hello has another boot id or session; it is "
    "answered once a second; check its supply and its reset line"
)


@dataclass(frozen=True, slots=True)
class Restless:
    """The device begins anew so often that it is not answered each time; said once."""

    text: str


class Data(NamedTuple):
    """A telemetry message; a bare tuple, for it is made for each one that comes."""

    received: Received
    arrived_ns: HostNs


@dataclass(frozen=True, slots=True)
class Ping:
    """A time exchange is complete."""

    sent_ns: HostNs
    received_us: int
    replied_us: int
    arrived_ns: HostNs


class CommandEnded(NamedTuple):
    """A command was accepted, refused or never answered."""

    outcome: Outcome


SessionEvent = (
    StateChanged | Agreed | Failed | Restless | Data | Ping | CommandEnded | DamagedFrame | Rejected
)
