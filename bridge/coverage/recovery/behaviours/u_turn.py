"""U-turn: from the end of a lane to the lane beside it, on arcs over swept floor.

It takes about 2 s. Two turns in place and the drive between them take 3.5 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.coverage.recovery.behaviours.obstacle_following import drive
from bridge.coverage.recovery.behaviours.perimeter import QUARTER
from bridge.coverage.recovery.behaviours.transit import straight, take_block
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Turn

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.legs import Leg

_SAMPLES = 5
"""Number of points on each part of the path at which the map is checked."""


@dataclass(frozen=True, slots=True)
class UTurn:
    """A drive straight ahead, an arc of 90°, a drive to the side, and a second arc of 90°."""

    choice: Choice
    """The next lane."""
    across_m: float
    """Distance of the lane from the robot's line, m; positive: to the left of the lane's
    heading."""
    ahead_m: float
    """Distance that the robot drives before the first arc, m."""
    radius_m: float

    @classmethod
    def into(cls, context: RecoveryContext, choice: Choice) -> UTurn | None:
        """Return the U-turn to a lane.

        None: the lane is not beside the robot, or the path is not free and swept.
        """
        options, width_m, lane = context.options, context.geometry.width_m, choice.begin
        if abs(wrap_angle(lane.theta_rad + math.pi - context.pose.theta_rad)) > options.bend_rad:
            return None
        before_m, across_m = offset(context.pose, lane)
        low, high = options.u_turn_widths
        if not low * width_m < abs(across_m) < high * width_m:
            return None
        if not -options.u_turn_ahead * width_m < before_m < options.u_turn_behind * width_m:
            return None
        for share in options.u_turn_radii:
            turn = cls(choice, across_m, max(-before_m, 0.0), share * abs(across_m))
            if context.evidence_map.is_swept_path(turn.points(context.pose)):
                return turn
        return None

    def points(self, pose: Pose2) -> Iterator[tuple[float, float]]:
        """Yield points of the path from a pose, m."""
        frame = Pose2(pose.x_m, pose.y_m, self.choice.heading_rad)
        radius_m = self.radius_m
        for k in range(_SAMPLES):
            share = k / (_SAMPLES - 1)
            yield frame.transform(-share * self.ahead_m, 0.0)
            along_m = self.ahead_m + radius_m * math.sin(QUARTER * share)
            aside_m = radius_m * (1.0 - math.cos(QUARTER * share))
            yield frame.transform(-along_m, self._side * aside_m)
            yield frame.transform(-along_m, self.across_m - self._side * aside_m)

    def drive(self, context: RecoveryContext) -> Generator[Leg, Step, bool]:
        """Drive the U-turn. Return True if the robot is at the lane."""
        lane, end_m_s = self.choice.begin, context.options.bend_m_s
        context.enter("transit", self.choice.path[-1])
        context.stuck.begin_transit()
        parts: list[Drive | Turn] = []
        if self.ahead_m > context.options.min_leg_m:
            parts.append(straight(context, lane.theta_rad + math.pi, self.ahead_m, end_m_s))
        between_m = abs(self.across_m) - 2.0 * self.radius_m
        if between_m > context.options.min_leg_m:
            aside_rad = lane.theta_rad + self._side * QUARTER
            parts.append(_arc(aside_rad, self._side * self.radius_m))
            parts.append(straight(context, aside_rad, between_m, end_m_s))
        for part in parts:
            if not (yield from self._reaches_end(context, part)):
                return False
        _, across_m = offset(context.pose, lane)
        if across_m * self.across_m < 0.0:
            across_m = 0.0  # the robot has passed the line: turn in place
        return (yield from self._reaches_end(context, _arc(lane.theta_rad, across_m)))

    # -- internal ------------------------------------------------------------------------------

    @property
    def _side(self) -> float:
        """1 if the lane is to the left of its heading, from the robot; else -1."""
        return math.copysign(1.0, self.across_m)

    def _reaches_end(
        self, context: RecoveryContext, part: Drive | Turn
    ) -> Generator[Leg, Step, bool]:
        result = yield from drive(context, part)
        if not result.reason.blocked:
            return True
        return (yield from take_block(context, self.choice, result, result.pose.theta_rad))


def _arc(heading_rad: float, across_m: float) -> Turn:
    return Turn(
        wrap_angle(heading_rad),
        flowing=True,
        purpose="transit",
        across_m=across_m,
        ends_at_cliff=True,
    )


def offset(pose: Pose2, lane: Pose2) -> tuple[float, float]:
    """Return how far the lane begins ahead of a pose, and to the left, along the lane's axes, m."""
    dx, dy = lane.x_m - pose.x_m, lane.y_m - pose.y_m
    c, s = math.cos(lane.theta_rad), math.sin(lane.theta_rad)
    return dx * c + dy * s, dy * c - dx * s
