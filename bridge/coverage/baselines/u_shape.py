"""The traditional U-shaped trajectory (paper section 3.1): lanes with no memory."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from bridge.coverage.baselines.lanes import LaneOptions, LanePlanner
from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.coverage.planner import Script
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel


class UShapePlanner(LanePlanner):
    """Drive to a wall, step aside by W, drive back, until the step is blocked."""

    def __init__(self, model: RobotModel, options: LaneOptions | None = None) -> None:
        """Nothing begins before ``start``."""
        super().__init__(model, options or LaneOptions())

    def script(self, obs: Observation) -> Script:
        """The plan from the pose in ``obs``."""
        width = self.model.cleaning_width_m
        self._begin(obs.pose)
        heading = obs.pose.theta_rad
        self.decide("start", "lanes along the start heading", side=self._lane_options.side)
        turns = 0
        while True:
            self._state = replace(self._state, state="lane")
            lane = yield from self._lane(heading)
            self._state = replace(
                self._state,
                previous_lane_distance_m=self._state.lane_distance_m or lane.distance_m,
                lane_distance_m=lane.distance_m,
            )
            self.decide("lane", f"lane ended: {lane.reason}", distance_m=lane.distance_m)
            self._state = replace(self._state, state="step")
            step = yield from self._side_step(lane.pose, width)
            blocked = self._is_short(step)
            if blocked:
                self.decide(
                    "blocked",
                    f"side step ended early: {step.reason}",
                    distance_m=step.distance_m,
                )
            reason = self._stuck(lane, blocked=blocked)
            if reason is not None:
                return reason
            turns += 1
            self._state = replace(self._state, turn_count=turns)
            heading = wrap_angle(heading + math.pi)
