"""A device whose planner reports false values, which tests must detect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from protocol.messages.device import PlannerState
from protocol.messages.values import PlannerPhase
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.sweeper import Sweeper

    Lie = Callable[[PlannerState, dict[str, int]], PlannerState]


def let_lie(device: Sweeper[Any], what: str, at_s: float) -> None:
    """Let the device's planner report a false value of this kind after ``at_s`` seconds."""
    control, lie = device.firmware.control, LIES[what]
    true_state = control.planner_state
    reported: dict[str, int] = {}

    def planner_state() -> PlannerState:
        true = true_state()
        return true if device.plant.tick_ms < 1000.0 * at_s else lie(true, reported)

    control.planner_state = planner_state


def changed(true: PlannerState, **values: int) -> PlannerState:
    """Return the state with some fields changed."""
    fields = CATALOGUE.by_class[PlannerState].fields
    return PlannerState(*(values.get(f.name, getattr(true, f.name)) for f in fields))


def _distance(true: PlannerState, _: dict[str, int]) -> PlannerState:
    far = true.lane_distance + 50
    known = true.lane_distance > 0
    return changed(true, lane_distance=far, previous_lane_distance=far) if known else true


def _case(true: PlannerState, _: dict[str, int]) -> PlannerState:
    return changed(true, lane_case=true.lane_case % 3 + 1) if true.lane_case else true


def _length(true: PlannerState, _: dict[str, int]) -> PlannerState:
    return changed(true, length=true.length + 4) if true.length else true


def _previous(true: PlannerState, _: dict[str, int]) -> PlannerState:
    far = true.lane_distance + 200
    return changed(true, previous_lane_distance=far) if true.lane_distance else true


def _turns(true: PlannerState, reported: dict[str, int]) -> PlannerState:
    more = true.turn_count > reported.setdefault("first", true.turn_count)
    return changed(true, turn_count=(true.turn_count + 2 * more) & 0xFF)


LIES: dict[str, Lie] = {
    "distance": _distance,
    "case": _case,
    "length": _length,
    "previous": _previous,
    "turns": _turns,
    "paused": lambda true, _: changed(true, phase=PlannerPhase.PAUSED),
    "turn": lambda true, _: changed(true, phase=PlannerPhase.TURN),
}
"""False values by name: D that is 5 cm too long, another case, another Length, another Prev-D, T
that jumps, and a wrong phase.
"""
