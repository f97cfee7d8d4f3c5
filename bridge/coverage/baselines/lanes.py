"""Common parts of the lane planners: lanes, side steps and backing off.

Each is part of a script.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Dwell, Leg, LegResult, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Part, Step
    from bridge.motion.robot_model import RobotModel

Side = Literal["left", "right"]
End = Literal["last_partial_lane", "blocked_step", "never"]


@dataclass(frozen=True, slots=True)
class LaneOptions:
    """Options of the lane planners. The paper does not define their values. Lengths are in m."""

    side: Side = "left"
    """Side of the first lane on which the second lane is."""
    end: End = "last_partial_lane"
    """Rule that ends the plan. A side step counts as blocked if it ends before W. ``blocked_step``
    ends the plan at the first blocked side step. ``last_partial_lane`` sweeps one more lane after a
    blocked side step. The plan ends if the side step at the other end of that lane is blocked too.
    ``never`` continues until ``max_lanes``."""
    stop_gap_m: float = 0.006
    """Gap between rim and wall at which the ultrasonic sensor ends a lane, m."""
    step_stop_gap_m: float = 0.014
    """Gap between rim and wall at which the ultrasonic sensor ends a side step, m. The next lane
    runs along that wall. So the gap must allow for a heading error of 1 cm in 1.7 m."""
    back_off_m: float = 0.015
    """Distance to back off after a contact, m. The next turn then does not graze the obstacle."""
    cliff_back_off_m: float = 0.05
    """Distance to back off from a cliff, m."""
    short_step_m: float = 0.015
    """Maximum missing length with which a side step still counts as complete, m."""
    step_from: Literal["lane_line", "here"] = "lane_line"
    """Start point of the paper's "move distance W": the planned line of the last lane, or the
    robot's present position. With ``lane_line``, lanes stay W apart after a contact or slip."""
    rest_s: float = 0.6
    """Duration of the standstill at the end of each lane, s; 0: no standstill. Its second half
    measures the gyro bias. A bias error of 0.01 °/s would turn the map by 2° in a run of case 1."""
    min_step_m: float = 0.02
    """Minimum length of a side step, m, even if the last lane ended nearer to the next line."""
    both_ends_widths: float = 1.0
    """Minimum length of a lane whose ends count as two places, in units of W. On a shorter lane,
    blocked side steps at both ends count once. Used by ``last_partial_lane`` only."""
    max_blocked: int = 3
    """Maximum number of blocked side steps in a row, on lanes of any length. One more blocked step
    ends the plan. Used by ``last_partial_lane`` only."""
    max_lanes: int = 2000
    """Maximum number of lanes in a run."""


class LaneSweep:
    """Parallel lanes along the start heading. Each lane is W beside the previous lane."""

    def __init__(self, model: RobotModel, options: LaneOptions, start: Pose2) -> None:
        """Begin at ``start``. New lanes are added on ``options.side`` of the first lane."""
        self._model, self._options = model, options
        ultrasonic, radius_m = model.ultrasonic, model.radius_m
        self.stop_range_m = ultrasonic.stop_range_m(radius_m, options.stop_gap_m)
        """Ultrasonic range that ends a lane, m."""
        self._step_stop_range_m = ultrasonic.stop_range_m(radius_m, options.step_stop_gap_m)
        self._origin = start
        turn = math.pi / 2 if options.side == "left" else -math.pi / 2
        self._step_heading = wrap_angle(start.theta_rad + turn)
        self.line_m = 0.0
        """Lateral distance of the last lane's line from the first lane, m."""
        self.blocked_steps = 0
        """Number of blocked side steps in a row."""
        self._lanes = 0

    def offset_m(self, pose: Pose2) -> float:
        """Return the distance of a pose from the first lane, along the stepping direction, m."""
        return (pose.x_m - self._origin.x_m) * math.cos(self._step_heading) + (
            pose.y_m - self._origin.y_m
        ) * math.sin(self._step_heading)

    def lane(self, heading_rad: float) -> Part:
        """Turn to the lane and drive it until a sensor stops the robot."""
        self._lanes += 1
        yield Turn(heading_rad)
        options = self._options
        lane = yield from self._drive(
            Drive(heading_rad, stop_range_m=self.stop_range_m, purpose="lane"),
        )
        if options.rest_s > 0.0:
            yield Dwell(options.rest_s)
        return lane

    def side_step(self, pose: Pose2, distance_m: float) -> Part:
        """Turn across the lanes and drive to the line at ``distance_m`` from the last lane.

        A negative distance drives back. The path starts at the robot's pose ``pose``.
        """
        options = self._options
        if options.step_from == "here":
            self.line_m = self.offset_m(pose)
        self.line_m += distance_m
        path_m = self.line_m - self.offset_m(pose)
        if distance_m < 0.0:
            path_m = -path_m
        turn = 0.0 if distance_m >= 0.0 else math.pi
        heading_rad = wrap_angle(self._step_heading + turn)
        yield Turn(heading_rad)
        result = yield from self._drive(
            Drive(
                heading_rad,
                max(path_m, options.min_step_m),
                stop_range_m=self._step_stop_range_m,
                purpose="step",
            ),
        )
        if self.is_short(result):
            self.line_m = self.offset_m(result.pose)
        return result

    def _drive(self, leg: Drive) -> Part:
        """Drive a leg; after a bump or a cliff, back off far enough to turn."""
        result = (yield leg).result
        yield from self.back_off(leg.heading_rad, result)
        return result

    def back_off(self, heading_rad: float, result: LegResult) -> Generator[Leg, Step]:
        """Back off after a bump or a cliff, against the heading of the leg, rad."""
        options = self._options
        if result.reason is StopReason.BUMPER:
            yield Drive(heading_rad, -options.back_off_m, speed_m_s=0.05, purpose="back-off")
        elif result.reason is StopReason.CLIFF:
            yield Drive(heading_rad, -options.cliff_back_off_m, speed_m_s=0.1, purpose="back-off")

    def is_short(self, result: LegResult) -> bool:
        """Return True if an obstacle or a cliff ended a side step before its length."""
        wanted_m = result.leg.distance_m if isinstance(result.leg, Drive) else None
        lacking = (wanted_m or 0.0) - result.distance_m
        return result.reason.blocked and lacking > self._options.short_step_m

    def stuck(self, lane: LegResult, *, blocked: bool) -> str | None:
        """Return the reason if the sweep ends after a lane and a side step.

        Otherwise return None.
        """
        options = self._options
        if self._lanes >= options.max_lanes:
            return f"{self._lanes} lanes driven, the limit"
        if not blocked:
            self.blocked_steps = 0
            return None
        self.blocked_steps += 1
        if options.end == "never":
            return None
        if options.end == "blocked_step":
            return "side step blocked: the robot could not go further"
        two_ends_m = options.both_ends_widths * self._model.cleaning_width_m
        both_ends = self.blocked_steps > 1 and lane.distance_m >= two_ends_m
        if both_ends or self.blocked_steps > options.max_blocked:
            return "side step blocked at both ends of the last lane"
        return None
