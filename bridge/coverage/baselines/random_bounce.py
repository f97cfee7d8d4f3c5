"""Random bounce: drive to an obstacle, turn by a random angle, and repeat."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from bridge.coverage.planner import Script, ScriptedPlanner
from bridge.motion.geometry import wrap_angle
from bridge.motion.legs import Drive, StopReason, Turn

if TYPE_CHECKING:
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel


class RandomSource(Protocol):
    """Source of random numbers, for example ``random.Random``."""

    def uniform(self, a: float, b: float, /) -> float:
        """Return a number between ``a`` and ``b`` with uniform distribution."""
        ...


@dataclass(frozen=True, slots=True)
class RandomOptions:
    """Options of the random planner."""

    max_time_s: float = 1800.0
    """Maximum duration, s. The planner cannot detect that the floor is swept."""
    min_turn_rad: float = math.radians(90.0)
    """Minimum turn, rad. Turns are uniform from this angle to 180°."""
    stop_gap_m: float = 0.01
    """Gap between rim and wall at which the ultrasonic sensor ends a drive, m."""
    back_off_m: float = 0.02
    """Distance to back off after a contact, m."""
    cliff_back_off_m: float = 0.05
    """Distance to back off from a cliff, m."""


class RandomPlanner(ScriptedPlanner):
    """Random planner, a baseline.

    The paper compares with such a planner but gives no values for it.
    """

    def __init__(
        self,
        model: RobotModel,
        rng: RandomSource,
        options: RandomOptions | None = None,
    ) -> None:
        """Create the planner. ``rng`` is the source of all random numbers."""
        super().__init__(model)
        self.options = options = options or RandomOptions()
        self._stop_range_m = model.ultrasonic.stop_range_m(model.radius_m, options.stop_gap_m)
        self._rng = rng

    def script(self, obs: Observation) -> Script:
        """Return the plan from the pose in ``obs``."""
        options = self.options
        heading = obs.pose.theta_rad
        begin_s = obs.time_s
        self.record.decide("start", "straight on along the start heading")
        while True:
            self.record.change(state="drive")
            left_s = begin_s + options.max_time_s - obs.time_s
            result, obs = yield Drive(
                heading,
                stop_range_m=self._stop_range_m,
                timeout_s=max(left_s, 0.0) if math.isfinite(left_s) else None,
                purpose="lane",
            )
            self.record.change(
                previous_lane_distance_m=self.record.state.lane_distance_m,
                lane_distance_m=result.distance_m,
                turn_count=self.record.state.turn_count + 1,
            )
            if result.reason is StopReason.BUMPER:
                _, obs = yield Drive(
                    heading, -options.back_off_m, speed_m_s=0.05, purpose="back-off"
                )
            elif result.reason is StopReason.CLIFF:
                _, obs = yield Drive(heading, -options.cliff_back_off_m, purpose="back-off")
            if obs.time_s - begin_s >= options.max_time_s:
                return f"time is up: {options.max_time_s:g} s"
            spread = math.pi - options.min_turn_rad
            turn = math.pi + self._rng.uniform(-spread, spread)
            heading = wrap_angle(heading + turn)
            self.record.decide("bounce", f"drive ended: {result.reason}", heading_rad=heading)
            self.record.change(state="turn")
            _, obs = yield Turn(heading)
