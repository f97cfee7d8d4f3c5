"""A planner that drives straight ahead without end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.coverage.planner import PlannerEvent, PlannerState
from bridge.motion.legs import Drive

if TYPE_CHECKING:
    from bridge.motion.legs import LegResult
    from bridge.motion.observation import Observation


class Straight:
    """Planner that drives straight along the present heading."""

    state = PlannerState("straight")

    def start(self, obs: Observation) -> Drive:
        return Drive(obs.pose.theta_rad, 5.0)

    def next(self, result: LegResult, obs: Observation) -> Drive:  # noqa: ARG002 - a planner's
        return self.start(obs)

    def drain_events(self) -> list[PlannerEvent]:
        return []
