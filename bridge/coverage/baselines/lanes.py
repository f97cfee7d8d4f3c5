"""Common parts of the lane planners: lanes, side steps and backing off, as parts of a script."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bridge.coverage.planner import Step
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Leg, LegResult, Rest, StopReason, Turn

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

Side = Literal["left", "right"]
End = Literal["last_partial_lane", "blocked_step", "never"]

Part = Generator[Leg, Step, LegResult]
"""Part of a script: returns how its main leg ended."""


@dataclass(frozen=True, slots=True)
class LaneOptions:
    """Choices of the lane planners that the paper leaves open, with lengths in metres."""

    side: Side = "left"
    """Side of the first lane on which the next one lies."""
    end: End = "last_partial_lane"
    """Condition that ends the plan if a side step is blocked before W. ``blocked_step`` ends it
    there. ``last_partial_lane`` sweeps one more lane there, and ends the plan if the step at that
    lane's other end is blocked too. ``never`` continues until ``max_lanes``."""
    stop_range_m: float = 0.046
    """Ultrasonic reading that is a wall: 6 mm of clearance, for the sensor sits 4 cm inside
    the body's front."""
    step_stop_range_m: float = 0.054
    """The same at the end of a side step, m. The next lane runs along that wall, and a heading
    error of 1 cm in 1.7 m must not make it graze."""
    back_off_m: float = 0.015
    """Distance of backing off after a contact, so that the turn does not graze."""
    cliff_back_off_m: float = 0.05
    short_step_m: float = 0.015
    """Maximum shortfall of W at which a side step still counts as whole, m."""
    step_from: Literal["lane_line", "here"] = "lane_line"
    """Reference of "move distance W": the intended line of the last lane, or the robot's place.
    With the line, lanes stay W apart whatever a contact or slip did in between."""
    rest_s: float = 0.6
    """Rest at the end of each lane; the gyro bias is measured in its second half. With an error of
    0.01 °/s a run of case 1 would end 2° off. 0: no rest."""
    min_step_m: float = 0.02
    """Minimum length of a side step, m, however far a lane strayed towards the next one."""
    both_ends_widths: float = 1.0
    """Length in W from which a lane has two ends. The ends of a shorter lane are the same place,
    so two blocked steps there count as one. Only for ``last_partial_lane``."""
    max_blocked: int = 3
    """Blocked side steps in a row with which the robot is not yet shut in, however short the lanes
    between them; one more is the end of ``last_partial_lane``."""
    max_lanes: int = 2000
    """Maximum number of lanes of a run that no other rule ends."""


class LaneSweep:
    """Parallel lanes along the heading of the start, each a step of W beside the last."""

    def __init__(self, model: RobotModel, options: LaneOptions, start: Pose2) -> None:
        """Begin at a pose; ``options.side`` decides to which side the lanes proceed."""
        self._model, self._options = model, options
        self._origin = start
        turn = math.pi / 2 if options.side == "left" else -math.pi / 2
        self._step_heading = wrap_angle(start.theta_rad + turn)
        self.line_m = 0.0
        """Offset of the last lane's line from the first, m."""
        self.blocked_steps = 0
        """Side steps blocked in a row."""
        self._lanes = 0

    def offset_m(self, pose: Pose2) -> float:
        """How far a pose lies from the first lane, along the stepping direction."""
        return (pose.x_m - self._origin.x_m) * math.cos(self._step_heading) + (
            pose.y_m - self._origin.y_m
        ) * math.sin(self._step_heading)

    def lane(self, heading_rad: float) -> Part:
        """Turn to the lane and drive it until a sensor stops the robot."""
        self._lanes += 1
        yield Turn(heading_rad)
        options = self._options
        lane = yield from self._drive(
            Drive(heading_rad, stop_range_m=options.stop_range_m, purpose="lane"),
        )
        if options.rest_s > 0.0:
            yield Rest(options.rest_s)
        return lane

    def side_step(self, pose: Pose2, distance_m: float) -> Part:
        """Turn across the lanes and drive to the line ``distance_m`` on, or back if negative.

        The path depends on ``pose``, the robot's place, and on the line of the last lane.
        """
        options = self._options
        if options.step_from == "here":
            self.line_m = self.offset_m(pose)
        self.line_m += distance_m
        way_m = self.line_m - self.offset_m(pose)
        if distance_m < 0.0:
            way_m = -way_m
        turn = 0.0 if distance_m >= 0.0 else math.pi
        heading_rad = wrap_angle(self._step_heading + turn)
        yield Turn(heading_rad)
        result = yield from self._drive(
            Drive(
                heading_rad,
                max(way_m, options.min_step_m),
                stop_range_m=options.step_stop_range_m,
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
        """Back off after a bump or a cliff, on the heading of the leg, rad."""
        options = self._options
        if result.reason is StopReason.BUMPER:
            yield Drive(heading_rad, -options.back_off_m, speed_m_s=0.05, purpose="back-off")
        elif result.reason is StopReason.CLIFF:
            yield Drive(heading_rad, -options.cliff_back_off_m, speed_m_s=0.1, purpose="back-off")

    def is_short(self, result: LegResult) -> bool:
        """Whether a step ended before its length for a reason in the world."""
        wanted_m = result.leg.distance_m if isinstance(result.leg, Drive) else None
        lacking = (wanted_m or 0.0) - result.distance_m
        return result.reason.blocked and lacking > self._options.short_step_m

    def stuck(self, lane: LegResult, *, blocked: bool) -> str | None:
        """Why the sweep ends after a lane and a side step, if it does."""
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
