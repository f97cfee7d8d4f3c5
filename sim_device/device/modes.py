"""The device's modes as a transition table: the effect of each event in each state.

The firmware looks up each event in the table and applies the result. The diagrams in the
specification are generated from the table, and the tests cover every entry.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from protocol.messages.values import Mode, NackReason

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator


class DeviceState(Enum):
    """A state of the device; the value is its name in the specification."""

    OFF = "off"
    """No supply: outputs off, memory lost."""
    BOOT = "boot"
    """The device starts: outputs off; nothing is received or sent."""
    STOPPED = "stopped"
    """A stop is latched."""
    IDLE = "idle"
    VELOCITY = "velocity"
    BRINGUP = "bringup"
    ONBOARD = "onboard"
    """Ready for the device's own planner."""
    RUNNING = "running"
    """The device's own planner drives."""
    PAUSED = "paused"
    """The device's own planner is paused and can resume its plan."""


class Event(Enum):
    """An event; the value is its name in the specification."""

    SUPPLY_LOST = "supply lost"
    SUPPLY_BACK = "supply back"
    RESET = "reset"
    BOOTED = "booted"
    STOP = "stop"
    CLEAR = "clear_stop"
    SET_IDLE = "set_mode idle"
    SET_VELOCITY = "set_mode velocity"
    SET_BRINGUP = "set_mode bringup"
    SET_ONBOARD = "set_mode onboard"
    START = "planner start"
    PAUSE = "planner pause"
    RESUME = "planner resume"
    ABORT = "planner abort"
    FINISHED = "planner finished"
    FAULT = "stopping fault"
    SILENCE = "host silent"
    NEW_SESSION = "hello of another session"


class Guard(Enum):
    """A condition that rejects an event."""

    OTHER_CAUSE = "a different cause is latched"
    CAUSE_HOLDS = "the fault that stopped it persists"
    FAULT_HOLDS = "a stopping fault holds"
    NO_PLANNER = "no such planner"


Outcome = DeviceState | NackReason | None
"""Outcome of an event. A state: enter the state. A reason: reject the event. None: ignore the
event."""


class Branch(NamedTuple):
    """One outcome and its condition (guard); without a guard the outcome always applies."""

    outcome: Outcome
    guard: Guard | None = None


Branches = tuple[Branch, ...]

MODE_OF: dict[DeviceState, Mode] = {
    DeviceState.OFF: Mode.IDLE,
    DeviceState.BOOT: Mode.IDLE,
    DeviceState.STOPPED: Mode.IDLE,
    DeviceState.IDLE: Mode.IDLE,
    DeviceState.VELOCITY: Mode.VELOCITY,
    DeviceState.BRINGUP: Mode.BRINGUP,
    DeviceState.ONBOARD: Mode.ONBOARD,
    DeviceState.RUNNING: Mode.ONBOARD,
    DeviceState.PAUSED: Mode.ONBOARD,
}
"""Mode in the status message for each state."""
SET_EVENT: dict[int, Event] = {
    Mode.IDLE: Event.SET_IDLE,
    Mode.VELOCITY: Event.SET_VELOCITY,
    Mode.BRINGUP: Event.SET_BRINGUP,
    Mode.ONBOARD: Event.SET_ONBOARD,
}
PLANNING = frozenset({DeviceState.RUNNING, DeviceState.PAUSED})
"""States in which a plan exists."""
GUARDED = frozenset(
    {DeviceState.VELOCITY, DeviceState.ONBOARD, DeviceState.RUNNING, DeviceState.PAUSED}
)
"""States that end at a fault that prevents driving. Bring-up is not in this set, because the wheels
are off the floor, the duty is limited, and a person is present."""
_UNPOWERED = frozenset({DeviceState.OFF, DeviceState.BOOT})
_AWAKE = tuple(s for s in DeviceState if s not in _UNPOWERED)
_FREE = tuple(s for s in _AWAKE if s is not DeviceState.STOPPED)


def _to(state: DeviceState, *rejections: Branch) -> Branches:
    return (*rejections, Branch(state))


def _rows() -> Iterator[tuple[DeviceState, Event, Branches]]:
    faulty = Branch(NackReason.FAULT, Guard.FAULT_HOLDS)
    latched = (Branch(NackReason.STOP_LATCHED),)
    elsewhere = (Branch(NackReason.OTHER_MODE),)

    yield DeviceState.OFF, Event.SUPPLY_BACK, _to(DeviceState.BOOT)
    yield DeviceState.BOOT, Event.BOOTED, _to(DeviceState.STOPPED)
    yield DeviceState.BOOT, Event.RESET, _to(DeviceState.BOOT)
    yield DeviceState.BOOT, Event.SUPPLY_LOST, _to(DeviceState.OFF)
    for state in _AWAKE:
        yield state, Event.SUPPLY_LOST, _to(DeviceState.OFF)
        yield state, Event.RESET, _to(DeviceState.BOOT)
        yield state, Event.STOP, _to(DeviceState.STOPPED)

    yield (
        DeviceState.STOPPED,
        Event.CLEAR,
        _to(
            DeviceState.IDLE,
            Branch(NackReason.OTHER_CAUSE, Guard.OTHER_CAUSE),
            Branch(NackReason.FAULT, Guard.CAUSE_HOLDS),
        ),
    )
    for event in (
        Event.SET_VELOCITY,
        Event.SET_BRINGUP,
        Event.SET_ONBOARD,
        Event.START,
        Event.PAUSE,
        Event.RESUME,
    ):
        yield DeviceState.STOPPED, event, latched

    for state in _FREE:
        yield state, Event.SILENCE, _to(DeviceState.STOPPED)
        yield state, Event.NEW_SESSION, _to(DeviceState.STOPPED)
        yield state, Event.SET_IDLE, _to(DeviceState.IDLE)
        yield state, Event.SET_VELOCITY, _to(DeviceState.VELOCITY, faulty)
        yield state, Event.SET_BRINGUP, _to(DeviceState.BRINGUP)
        if state in GUARDED:
            yield state, Event.FAULT, _to(DeviceState.STOPPED)
        if state not in PLANNING:
            yield state, Event.SET_ONBOARD, _to(DeviceState.ONBOARD, faulty)
            yield state, Event.PAUSE, elsewhere
            yield state, Event.RESUME, elsewhere
        if state is not DeviceState.ONBOARD:
            yield state, Event.START, elsewhere
    yield (
        DeviceState.ONBOARD,
        Event.START,
        _to(DeviceState.RUNNING, Branch(NackReason.UNSUPPORTED, Guard.NO_PLANNER), faulty),
    )
    yield DeviceState.RUNNING, Event.PAUSE, _to(DeviceState.PAUSED)
    yield DeviceState.PAUSED, Event.RESUME, _to(DeviceState.RUNNING, faulty)
    yield DeviceState.RUNNING, Event.ABORT, _to(DeviceState.IDLE)
    yield DeviceState.PAUSED, Event.ABORT, _to(DeviceState.IDLE)
    yield DeviceState.RUNNING, Event.FINISHED, _to(DeviceState.IDLE)


NOTHING: Branches = (Branch(None),)
TABLE: dict[tuple[DeviceState, Event], Branches] = {
    **{(state, event): NOTHING for state in DeviceState for event in Event},
    **{(state, event): branches for state, event, branches in _rows()},
}
"""Branches for every state and event. The first branch with a true guard, or without a guard,
applies."""


class ModeMachine:
    """Applies events by the table."""

    def __init__(self, state: DeviceState = DeviceState.OFF) -> None:
        """Start in a state; the default is without supply."""
        self._go(state)

    def _go(self, state: DeviceState) -> None:
        self.state = state
        # Stored as a flag, because each control period reads it and hashing an enumeration is slow.
        self.awake = state not in _UNPOWERED
        self.planning = state in PLANNING

    def fire(self, event: Event, holding: Collection[Guard] = ()) -> Outcome:
        """Apply an event and change the state; return the outcome from the table.

        ``holding`` contains the guards that are true now.
        """
        outcome = next(b.outcome for b in TABLE[self.state, event] if b.guard in {None, *holding})
        if isinstance(outcome, DeviceState):
            self._go(outcome)
        return outcome


def drawn() -> list[tuple[str, str, str]]:
    """Return the transitions as (from, event and its conditions, to), for a diagram."""
    found: list[tuple[str, str, str]] = []
    for (state, event), branches in TABLE.items():
        target = branches[-1].outcome
        if isinstance(target, DeviceState) and target is not state:
            unless = " or ".join(b.guard.value for b in branches if b.guard is not None)
            label = f"{event.value} (unless {unless})" if unless else event.value
            found.append((state.value, label, target.value))
    return found


def rejections() -> list[tuple[str, str, str]]:
    """Return the rejections of the table as (event and condition, states, reason)."""
    found: dict[tuple[str, str], list[str]] = {}
    for (state, event), branches in TABLE.items():
        for outcome, guard in branches:
            if isinstance(outcome, NackReason):
                what = f"{event.value}, {guard.value}" if guard else event.value
                found.setdefault((what, outcome.name.lower()), []).append(state.value)
    return [(what, ", ".join(states), reason) for (what, reason), states in found.items()]
