"""The recovery planner's context without a run: a robot at rest with an empty map."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from bridge.coverage.planner import PlannerReports
from bridge.coverage.recovery.context import RecoveryContext
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Chooser
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import Observation

    Returned = TypeVar("Returned")


def context_at(
    obs: Observation = AT_REST,
    model: RobotModel | None = None,
    options: RecoveryOptions | None = None,
) -> RecoveryContext:
    """Begin a plan at an observation."""
    options = options or RecoveryOptions()
    chooser = Chooser(options)
    model, motion = model or RobotModel(), MotionTuning()
    return RecoveryContext.begin(model, options, chooser, PlannerReports(), obs, motion=motion)


def kinds(context: RecoveryContext) -> list[str]:
    """Return the kinds of the events since the last call."""
    return [event.kind for event in context.record.drain()]


def choose(
    chooser: Chooser, evidence_map: EvidenceMap, pose: Pose2, grid_rad: float
) -> Choice | None:
    """Run a whole search. Return the best choice; None: no choice is worthwhile."""
    search = chooser.search(evidence_map, pose, grid_rad)
    while True:
        try:
            next(search)
        except StopIteration as stop:
            found: Choice | None = stop.value
            return found


def returned(part: Generator[object, object, Returned]) -> Returned:
    """Return the result of a planner part (a generator) that yields no leg."""
    try:
        next(part)
    except StopIteration as stop:
        value: Returned = stop.value
        return value
    raise AssertionError("it drives a leg")
