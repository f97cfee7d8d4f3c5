"""What a coverage planner is: legs out, results in, and every decision told with its reason."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field, fields
from numbers import Real
from reprlib import repr as shortened
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np

from bridge.motion.legs import Leg, LegResult

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

Scalar = float | int | str | bool


@dataclass(frozen=True, slots=True)
class Finish:
    """The planner has ended by itself."""

    reason: str


@dataclass(frozen=True, slots=True)
class PlannerEvent:
    """A decision. ``kind`` is a fixed word of the planner, ``reason`` a sentence for people."""

    kind: str
    reason: str
    data: dict[str, Scalar] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PlannerState:
    """The paper's variables (Table 1) and where the planner stands."""

    state: str = "idle"
    turn_count: int = 0
    """T."""
    lane_distance_m: float = 0.0
    """D."""
    previous_lane_distance_m: float = 0.0
    """Prev-D."""
    length_m: float = 0.0
    """Length = W·T of the last case 3."""
    case: int = 0
    """Case 1, 2 or 3 of the last lane; 0: none of them."""
    target: tuple[float, float] | None = None
    """Point being driven to, in metres, when there is one."""


class Planner(Protocol):
    """Decides the next leg when one has ended; knows only what the observations tell."""

    @property
    def state(self) -> PlannerState:
        """Where the planner stands."""
        ...

    def start(self, obs: Observation) -> Leg | Finish:
        """First leg, from the pose observed now."""
        ...

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        """Leg after the one that gave ``result``."""
        ...

    def drain_events(self) -> list[PlannerEvent]:
        """Decisions since the last call, oldest first."""
        ...


@runtime_checkable
class Watcher(Protocol):
    """A planner that looks at every observation, not only at the ends of legs."""

    @property
    def speed_limit_m_s(self) -> float:
        """Fastest forward speed allowed by what is known ahead, as of the last observation."""
        ...

    def watch(self, obs: Observation) -> bool:
        """Take an observation; true: the leg under way is to be cancelled."""
        ...


class PlannerError(TypeError):
    """An object that is no planner, or a leg that is none; the text names what is wrong."""


def check_planner(planner: object) -> None:
    """See that an object has everything that a run asks a planner for.

    Raises:
        PlannerError: it lacks a method or an attribute, or has only half of a watcher's.

    """
    kind = type(planner).__name__
    if isinstance(planner, type):
        raise PlannerError(f"{planner.__name__} is a class; give a planner made from it")
    lacks = [f"{name}()" for name in _METHODS if not callable(getattr(planner, name, None))]
    if not hasattr(planner, "state"):
        lacks.append("state")
    if lacks:
        raise PlannerError(f"{kind} is no planner: it lacks {', '.join(lacks)}")
    if callable(getattr(planner, "watch", None)) != hasattr(planner, "speed_limit_m_s"):
        has, other = (
            ("watch()", "speed_limit_m_s")
            if hasattr(planner, "watch")
            else ("speed_limit_m_s", "watch()")
        )
        raise PlannerError(f"{kind} has {has} and lacks {other}: a watcher needs both")


def check_leg(planner: object, leg: object) -> None:
    """See that what a planner handed over is a leg, and its fields are finite and of their types.

    Raises:
        PlannerError: it is not; the text names planner, leg and field.

    """
    name = type(planner).__name__
    if not isinstance(leg, Leg):
        kinds = ", ".join(kind.__name__ for kind in Leg.__args__)
        raise PlannerError(f"{name} gave {shortened(leg)}; a leg is one of {kinds}, or Finish")
    for each in fields(leg):
        value = getattr(leg, each.name)
        if not _is_of(value, each.type):
            raise PlannerError(
                f"{name}: its leg {type(leg).__name__} has {each.name} = {shortened(value)}; "
                f"it must be {_WANTED[each.type]}"
            )


def _is_of(value: object, wanted: object) -> bool:
    match wanted:
        case "bool":
            return isinstance(value, bool | np.bool_)
        case "str":
            return isinstance(value, str)
        case "float | None" if value is None:
            return True
        case _:
            if isinstance(value, bool) or not isinstance(value, Real):
                return False
            try:
                return math.isfinite(float(value))
            except OverflowError:  # an integer beyond every float
                return False


_WANTED: dict[object, str] = {
    "bool": "True or False",
    "str": "a text",
    "float": "a finite number",
    "float | None": "a finite number or None",
}
"""By the fields' annotations, which are texts."""
_METHODS = ("start", "next", "drain_events")
"""What :class:`Planner` asks for, besides ``state``."""


class Step(NamedTuple):
    """What a script is sent when its leg has ended."""

    result: LegResult
    obs: Observation


Script = Generator[Leg, Step, str]
"""A plan as a coroutine: yields legs, is sent how they ended, returns why it finished."""


class ScriptedPlanner(ABC):
    """A planner written as a coroutine, so that an algorithm reads as its pseudo-code does."""

    def __init__(self, model: RobotModel) -> None:
        """Nothing begins before ``start``."""
        self.model = model
        self._state = PlannerState()
        self.end_figures: dict[str, Scalar] = {}
        """What the event of the end says beside its reason."""
        self._events: list[PlannerEvent] = []
        self._script: Script | None = None

    @abstractmethod
    def script(self, obs: Observation) -> Script:
        """The plan from the pose in ``obs``."""

    @property
    def state(self) -> PlannerState:
        """Where the planner stands."""
        return self._state

    def start(self, obs: Observation) -> Leg | Finish:
        """Begin anew."""
        self._state = PlannerState()
        self.end_figures = {}
        self._script = self.script(obs)
        return self._resume(self._script, None)

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        """Leg after ``result``; ``Finish`` if the plan was never started."""
        if self._script is None:
            return Finish("not started")
        return self._resume(self._script, Step(result, obs))

    def drain_events(self) -> list[PlannerEvent]:
        """Decisions since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def decide(self, kind: str, reason: str, **data: Scalar) -> None:
        """Put a decision on record."""
        self.emit(PlannerEvent(kind, reason, data))

    def emit(self, event: PlannerEvent) -> None:
        """The same of one that is ready."""
        self._events.append(event)

    def _resume(self, script: Script, step: Step | None) -> Leg | Finish:
        try:
            return next(script) if step is None else script.send(step)
        except StopIteration as stop:
            reason = str(stop.value)
            self.decide("finish", reason, **self.end_figures)
            return Finish(reason)
