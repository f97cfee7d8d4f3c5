"""The ``recovery`` planner: perimeters along the walls, lanes between them, and occluded regions.

It uses the paper's idea: store at low cost which region an obstacle has occluded, and revisit this
region. A map of evidence replaces the paper's single memory slot. The robot follows each wall that
it contacts until the perimeter pass is complete. This pass sweeps the strip beside the wall, which
no lane can sweep, and maps the wall. Then the planner repeatedly chooses the lane or perimeter with
the largest swept area per time. It ends when no choice is worth its time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.coverage.planner import Script, ScriptedPlanner, Step
from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.heading_fix import HeadingFix
from bridge.coverage.recovery.behaviours.sweeping import (
    approach_wall,
    choose,
    sweep_lane,
    sweep_perimeter,
)
from bridge.coverage.recovery.context import RecoveryContext
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Choice, Chooser
from bridge.coverage.recovery.stuck import Verdict
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.legs import Leg
from bridge.motion.robot_model import MISSING_SENSOR_EFFECTS

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

Sweep = Callable[[RecoveryContext, Choice], Generator[Leg, Step, bool]]


@dataclass(frozen=True, slots=True)
class Behaviours:
    """Functions for the parts of the plan. Each can be replaced."""

    approach: Callable[[RecoveryContext], Generator[Leg, Step]] = approach_wall
    choose: Callable[[RecoveryContext], Generator[Leg, Step, Choice | None]] = choose
    lane: Sweep = sweep_lane
    perimeter: Sweep = sweep_perimeter
    heading_fix: Callable[[], HeadingFix] = HeadingFix


class RecoveryPlanner(ScriptedPlanner):
    """Chooses a target, executes it, and rates the result.

    Repeats this until nothing is worthwhile.
    """

    def __init__(
        self,
        model: RobotModel,
        options: RecoveryOptions | None = None,
        behaviours: Behaviours | None = None,
        motion: MotionTuning | None = None,
    ) -> None:
        """Create a planner for a robot. The plan begins when ``start`` is called.

        ``motion`` is the tuning of the leg executor: the planner computes with its braking.
        """
        super().__init__(model)
        self.options = (options or RecoveryOptions()).for_model(model)
        self._behaviours = behaviours or Behaviours()
        self._motion = motion or MotionTuning()
        self._chooser = Chooser(self.options)
        self._context: RecoveryContext | None = None

    @property
    def context(self) -> RecoveryContext:
        """Map, helpers and progress of the plan.

        Raises:
            RuntimeError: the plan has not started.

        """
        if self._context is None:
            raise RuntimeError("the plan was not started")
        return self._context

    @property
    def speed_limit_m_s(self) -> float:
        """Maximum forward speed at which contacts with known obstacles are harmless, m/s."""
        return math.inf if self._context is None else self._context.monitor.speed_limit_m_s

    def observe(self, obs: Observation) -> bool:
        """Process an observation. Return True to cancel the running leg.

        Its perimeter pass is complete, or an unswept wall is beside its lane.
        """
        return self._context is not None and self._context.monitor.observe(obs)

    def script(self, obs: Observation) -> Script:
        """Return the plan from the pose in ``obs``."""
        context = RecoveryContext.begin(
            self.model, self.options, self._chooser, self.record, obs, motion=self._motion
        )
        self._context = context
        heading_fix = self._behaviours.heading_fix()
        context.enter("approach")
        self.record.decide("start", "search for a wall to follow")
        for name, mount in self.model.rangers.items():
            if not mount.fitted:
                self.record.decide("sensor", f"without {name} {MISSING_SENSOR_EFFECTS[name]}")
        yield from self._behaviours.approach(context)
        for _ in range(self.options.max_decisions):
            choice = yield from self._behaviours.choose(context)
            if choice is None and context.stuck.clear_bumps():
                continue
            enclosed, unreachable_at = self._chooser.enclosed, self._chooser.unreachable_at
            verdict = context.stuck.judge(
                context.pose, enclosed=enclosed, unreachable_at=unreachable_at
            )
            if verdict is Verdict.CLEARED:
                continue
            if verdict is Verdict.ENCLOSED:
                return self._end(context, "enclosed: no target is reachable")
            if choice is None:
                return self._end(context, "no reachable unswept piece is worth its time")
            if not (yield from heading_fix.take(context)):
                yield from self._carry_out(context, choice)
        return self._end(context, f"{self.options.max_decisions} decisions, the limit")

    def _carry_out(self, context: RecoveryContext, choice: Choice) -> Generator[Leg, Step]:
        """Sweep the chosen target and rate the result."""
        before = context.evidence_map.new_cells
        self.record.emit(events.chosen(choice))
        begin = choice.begin
        is_lane = choice.kind == "lane"
        region = context.occlusions.overlapping(begin, choice.length_m) if is_lane else None
        context.recovering = region
        if region is not None:
            self.record.emit(events.recovery_begun(region))
        sweep = self._behaviours.lane if is_lane else self._behaviours.perimeter
        arrived = yield from sweep(context, choice)
        new_cells, context.recovering = context.evidence_map.new_cells - before, None
        if region is not None:
            closed = arrived and context.occlusions.swept(region, begin, context.lane_m)
            new_m2 = context.geometry.area_m2(new_cells)
            ended = events.recovery_ended(region, new_m2, arrived=arrived, closed=closed)
            self.record.emit(ended)
        context.stuck.take(choice, new_cells, context.pose, arrived=arrived)

    def _end(self, context: RecoveryContext, reason: str) -> str:
        context.enter("finished")
        beside_cm2 = round(self._chooser.beside_walls_m2 * 1e4)
        if context.geometry.ahead_cells and beside_cm2 > 0:
            reason += (
                f"; {beside_cm2} cm² beside walls are left: the mouth, ahead of the axle, reaches "
                "them only by turning towards the wall, which sweeps too little for its time"
            )
        self.record.end_figures = {
            "swept_m2": round(context.geometry.area_m2(context.evidence_map.new_cells), 2),
            "left_cm2": round(self._chooser.left_m2 * 1e4),
            "occlusions_open": len(context.occlusions.open),
            "beside_walls_cm2": beside_cm2,
        }
        return reason
