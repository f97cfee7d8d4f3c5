"""U-turn: from the end of a lane to the lane beside it, on arcs over swept floor.

It takes about 2 s. Two turns in place and the drive between them take 3.5 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.coverage.recovery.behaviours.obstacle_following import drive, follow_obstacle
from bridge.coverage.recovery.behaviours.perimeter import QUARTER
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Turn

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.legs import Leg

_NO_LEG_M = 0.01
"""Maximum distance that is too short to drive, m."""
_SAMPLES = 5
"""Number of points on each part of the path at which the map is checked."""


@dataclass(frozen=True, slots=True)
class UTurn:
    """A drive straight ahead, an arc of 90°, a drive to the side, and a second arc of 90°.

    Distances are in m, in the frame of the next lane: its beginning and its heading.
    """

    lane: Pose2
    """Beginning and heading of the next lane."""
    across_m: float
    """Distance of the next lane to the left of its heading, from the robot's line."""
    ahead_m: float
    """Distance that the robot drives before the first arc."""
    radius_m: float

    @classmethod
    def into(cls, context: RecoveryContext, choice: Choice) -> UTurn | None:
        """Return the U-turn to a lane.

        None: the lane is not beside the robot, or the path is not free and swept.
        """
        options, width_m = context.options, context.geometry.width_m
        lane = choice.begin
        if abs(wrap_angle(lane.theta_rad + math.pi - context.pose.theta_rad)) > options.bend_rad:
            return None
        before_m, across_m = offset(context.pose, lane)
        low, high = options.u_turn_widths
        if not low * width_m < abs(across_m) < high * width_m:
            return None
        if not -options.u_turn_ahead * width_m < before_m < options.u_turn_behind * width_m:
            return None
        for share in options.u_turn_radii:
            turn = cls(lane, across_m, max(-before_m, 0.0), share * abs(across_m))
            if context.map.is_swept_path(turn.points(context.pose)):
                return turn
        return None

    def points(self, pose: Pose2) -> Iterator[tuple[float, float]]:
        """Yield points of the path from a pose, m."""
        side, width_m, radius_m = (
            math.copysign(1.0, self.across_m),
            abs(self.across_m),
            self.radius_m,
        )
        frame = Pose2(pose.x_m, pose.y_m, self.lane.theta_rad)
        for k in range(_SAMPLES):
            share = k / (_SAMPLES - 1)
            yield frame.transform(-share * self.ahead_m, 0.0)
            along_m = self.ahead_m + radius_m * math.sin(QUARTER * share)
            across_m = radius_m * (1.0 - math.cos(QUARTER * share))
            yield frame.transform(-along_m, side * across_m)
            yield frame.transform(-along_m, side * (width_m - across_m))

    def drive(self, context: RecoveryContext) -> Generator[Leg, Step, bool]:
        """Drive the U-turn. Return True if the robot is at the lane."""
        context.enter("transit", (self.lane.x_m, self.lane.y_m))
        context.stuck.begin_transit()
        heading_rad, side = self.lane.theta_rad, math.copysign(1.0, self.across_m)
        if self.ahead_m > _NO_LEG_M and not (
            yield from self._leg(context, self._drive(context, heading_rad + math.pi, self.ahead_m))
        ):
            return False
        between_m = abs(self.across_m) - 2.0 * self.radius_m
        if between_m > _NO_LEG_M:
            aside_rad = heading_rad + side * QUARTER
            arc = self._arc(aside_rad, side * self.radius_m)
            if not (yield from self._leg(context, arc)):
                return False
            if not (yield from self._leg(context, self._drive(context, aside_rad, between_m))):
                return False
        _, across_m = offset(context.pose, self.lane)
        return (yield from self._leg(context, self._arc(heading_rad, across_m)))

    # -- internal ------------------------------------------------------------------------------

    def _drive(self, context: RecoveryContext, heading_rad: float, distance_m: float) -> Drive:
        return Drive(
            heading_rad,
            distance_m,
            speed_m_s=context.geometry.lane_speed_m_s,
            stop_range_m=context.geometry.stop_range_m,
            end_m_s=context.options.bend_m_s,
            wary=True,
            purpose="transit",
        )

    @staticmethod
    def _arc(heading_rad: float, across_m: float) -> Turn:
        return Turn(wrap_angle(heading_rad), flowing=True, across_m=across_m, purpose="transit")

    @staticmethod
    def _leg(context: RecoveryContext, leg: Drive | Turn) -> Generator[Leg, Step, bool]:
        """Drive a part. Return True if the robot has reached its end."""
        result = yield from drive(context, leg)
        if not result.reason.blocked:
            return True
        context.record.decide("blocked", f"the U-turn to the lane ended early: {result.reason}")
        if not (yield from follow_obstacle(context, result)):
            context.stuck.blocked(result, result.pose.theta_rad)
        return False


def offset(pose: Pose2, lane: Pose2) -> tuple[float, float]:
    """Return the position of the lane's beginning in the frame of its heading, from a pose, m."""
    dx, dy = lane.x_m - pose.x_m, lane.y_m - pose.y_m
    c, s = math.cos(lane.theta_rad), math.sin(lane.theta_rad)
    return dx * c + dy * s, dy * c - dx * s
