"""The traditional U-shaped trajectory (paper section 3.1): lanes without memory."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.baselines.lanes import LaneOptions, LaneSweep
from bridge.coverage.planner import ScriptedPlanner
from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.coverage.planner import Script
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel


class UShapePlanner(ScriptedPlanner):
    """Drives to a wall, steps aside by W and drives back.

    It ends as ``LaneOptions.end`` defines.
    """

    def __init__(self, model: RobotModel, options: LaneOptions | None = None) -> None:
        """Create the planner. The plan begins when ``start`` is called."""
        super().__init__(model)
        self.options = options or LaneOptions()

    def script(self, obs: Observation) -> Script:
        """Return the plan from the pose in ``obs``."""
        width = self.model.cleaning_width_m
        sweep = LaneSweep(self.model, self.options, obs.pose)
        heading = obs.pose.theta_rad
        self.record.decide("start", "lanes along the start heading", side=self.options.side)
        turns = 0
        while True:
            self.record.change(state="lane")
            lane = yield from sweep.lane(heading)
            self.record.change(
                previous_lane_distance_m=self.record.state.lane_distance_m or lane.distance_m,
                lane_distance_m=lane.distance_m,
            )
            self.record.decide("lane", f"lane ended: {lane.reason}", distance_m=lane.distance_m)
            self.record.change(state="step")
            step = yield from sweep.side_step(lane.pose, width)
            blocked = sweep.is_short(step)
            if blocked:
                self.record.decide(
                    "blocked",
                    f"side step ended early: {step.reason}",
                    distance_m=step.distance_m,
                )
            reason = sweep.stuck(lane, blocked=blocked)
            if reason is not None:
                return reason
            turns += 1
            self.record.change(turn_count=turns)
            heading = wrap_angle(heading + math.pi)
