"""The interface of coverage planners. A planner returns legs, receives results and emits events."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from reprlib import repr as shortened
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from bridge.motion.legs import Leg, LegResult

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

Scalar = float | int | str | bool


@dataclass(frozen=True, slots=True)
class Finish:
    """Returned instead of a leg when the plan has ended."""

    reason: str
    """Sentence for the user."""


@dataclass(frozen=True, slots=True)
class PlannerEvent:
    """A decision of the planner."""

    kind: str
    """Code of the decision; each planner defines its own."""
    reason: str
    """Sentence for the user."""
    data: dict[str, Scalar] = field(default_factory=dict)
    """Figures of the decision, by name."""


@dataclass(frozen=True, slots=True)
class PlannerState:
    """The paper's variables (Table 1) and the state of the planner."""

    state: str = "idle"
    """Name of the state; a planner chooses its own names."""
    turn_count: int = 0
    """Turn count T."""
    lane_distance_m: float = 0.0
    """Length D of the last lane, m."""
    previous_lane_distance_m: float = 0.0
    """Prev-D, m: the length with which the next lane is compared. ``paper`` sets it to D at the end
    of a lane; other planners report the lane before."""
    length_m: float = 0.0
    """Length = W·T of the last case 3, m."""
    case: int = 0
    """Case of the last lane: 1, 2 or 3; 0: no case."""
    target: tuple[float, float] | None = None
    """Point to which the robot drives, m; None: no point."""


class Planner(Protocol):
    """Chooses the next leg at the end of each leg, from observations only."""

    @property
    def state(self) -> PlannerState:
        """Present state of the planner."""
        ...

    def start(self, obs: Observation) -> Leg | Finish:
        """Return the first leg, from the pose in ``obs``."""
        ...

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        """Return the next leg. ``result`` is the result of the last leg."""
        ...

    def drain_events(self) -> list[PlannerEvent]:
        """Return the decisions since the last call, oldest first."""
        ...


@runtime_checkable
class ObservingPlanner(Protocol):
    """A planner that receives every observation, not only the observations at the ends of legs."""

    @property
    def speed_limit_m_s(self) -> float:
        """Maximum forward speed that the last observation allows, m/s."""
        ...

    def observe(self, obs: Observation) -> bool:
        """Use an observation. Return True to cancel the running leg."""
        ...


class PlannerError(TypeError):
    """The planner or one of its legs is invalid. The text names the error."""


ORIGINS: dict[type, str] = {}
"""Source of each planner class that is not part of the project, for error messages."""


def check_planner(planner: object) -> None:
    """Check that an object has the methods and attributes of a planner.

    Raises:
        PlannerError: the object lacks a method or an attribute, or has only one of ``observe`` and
            ``speed_limit_m_s``.

    """
    kind = type(planner).__name__
    if isinstance(planner, type):
        raise PlannerError(f"{planner.__name__} is a class; give a planner made from it")
    lacks = [f"{name}()" for name in _METHODS if not callable(getattr(planner, name, None))]
    if not hasattr(planner, "state"):
        lacks.append("state")
    if lacks:
        raise PlannerError(f"{kind} is no planner: it lacks {', '.join(lacks)}")
    if callable(getattr(planner, "observe", None)) != hasattr(planner, "speed_limit_m_s"):
        has, other = (
            ("observe()", "speed_limit_m_s")
            if hasattr(planner, "observe")
            else ("speed_limit_m_s", "observe()")
        )
        raise PlannerError(
            f"{kind} has {has} and lacks {other}: a planner that observes needs both"
        )


def check_leg(planner: object, leg: object) -> None:
    """Check that a planner returned a leg with finite fields of the right types.

    Raises:
        PlannerError: the leg is invalid. The text names planner, leg and field.

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
        low = _LOWEST.get(each.name)
        if low is not None and value is not None and not float(value) >= low:
            raise PlannerError(
                f"{name}: its leg {type(leg).__name__} has {each.name} = {shortened(value)}; "
                f"it must be at least {low:g}"
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
            except OverflowError:  # an integer that is too large for a float
                return False


_WANTED: dict[object, str] = {
    "bool": "True or False",
    "str": "a text",
    "float": "a finite number",
    "float | None": "a finite number or None",
}
"""Text for the expected value of a field, by the field's annotation (a string)."""
_LOWEST = {"speed_m_s": 0.001, "gap_m": 0.0, "timeout_s": 0.0, "duration_s": 0.0, "end_m_s": 0.0}
"""Lowest value of a field."""
_METHODS = ("start", "next", "drain_events")
"""Methods that a :class:`Planner` must have, besides ``state``."""


class Step(NamedTuple):
    """End of a leg, as a script receives it."""

    result: LegResult
    obs: Observation


Script = Generator[Leg, Step, str]
"""A plan as a coroutine. It yields legs, receives the end of each leg, and returns the reason for
its end."""
Part = Generator[Leg, Step, LegResult]
"""Part of a script. It returns the result of its main leg."""


class PlannerReports:
    """Reports of a planner: its state, its decisions and the values of its last event."""

    def __init__(self) -> None:
        """Begin with the state ``idle`` and no decision."""
        self.state = PlannerState()
        self.end_figures: dict[str, Scalar] = {}
        """The additional values of the planner's event ``finish``."""
        self._events: list[PlannerEvent] = []

    def change(self, **fields: Any) -> None:  # noqa: ANN401 - the fields of PlannerState
        """Replace fields of the state."""
        self.state = replace(self.state, **fields)

    def decide(self, kind: str, reason: str, **data: Scalar) -> None:
        """Record a decision."""
        self.emit(PlannerEvent(kind, reason, data))

    def emit(self, event: PlannerEvent) -> None:
        """Record an event."""
        self._events.append(event)

    def drain(self) -> list[PlannerEvent]:
        """Return the events since the last call, oldest first."""
        events, self._events = self._events, []
        return events


class ScriptedPlanner(ABC):
    """A planner that is written as a coroutine.

    Its code can follow the pseudo-code of an algorithm.
    """

    def __init__(self, model: RobotModel) -> None:
        """Create a planner for a robot. The plan begins when ``start`` is called."""
        self.model = model
        self.record = PlannerReports()
        self._script: Script | None = None

    @abstractmethod
    def script(self, obs: Observation) -> Script:
        """Return the plan from the pose in ``obs``."""

    @property
    def state(self) -> PlannerState:
        """The paper's variables and the phase of the plan."""
        return self.record.state

    def start(self, obs: Observation) -> Leg | Finish:
        """Restart the plan and return its first leg."""
        self.record.state, self.record.end_figures = PlannerState(), {}
        self._script = self.script(obs)
        return self._resume(self._script, None)

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        """Return the leg after ``result``. Return ``Finish`` if the plan was never started."""
        if self._script is None:
            return Finish("not started")
        return self._resume(self._script, Step(result, obs))

    def drain_events(self) -> list[PlannerEvent]:
        """Return the decisions since the last call, oldest first."""
        return self.record.drain()

    def _resume(self, script: Script, step: Step | None) -> Leg | Finish:
        try:
            return next(script) if step is None else script.send(step)
        except StopIteration as stop:
            reason = str(stop.value)
            self.record.decide("finish", reason, **self.record.end_figures)
            return Finish(reason)
