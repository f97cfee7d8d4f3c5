"""The perimeter pass: follow the boundary of a wall or an obstacle until its floor is swept."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.obstacle import react
from bridge.coverage.recovery.lookout import CLOSED_M
from bridge.coverage.recovery.map import FELT_RAD
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import FollowWall, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Leg, LegResult

QUARTER = 0.5 * math.pi
_STUCK_M = 0.02
"""Path along a wall below which an attempt counts as stuck, m."""
_MAX_STUCK = 8
"""Stuck attempts in a row after which the pass ends."""
_MIN_AWAY_RAD = math.radians(12.0)
"""Minimum turn away from a contact, rad. The robot may mistake the followed wall for the contact
once. A repeat within ``_SAME_BUMP_M`` makes the turn grow with each contact."""
_SAME_BUMP_M = 0.06
"""Path between two contacts that are at one place, m."""
_STOP_S = 0.5
"""Time from a brisk speed to standstill, s: a robot that was faster was not rounding a corner, so
it did not graze that corner."""
_MIN_TURN_RAD = math.radians(2.0)
"""Turn below which the next leg steers instead, rad."""


def _touches_only(result: LegResult, side: int) -> bool:
    """Whether only the switch on one side is pressed."""
    left, right = result.bumper_left, result.bumper_right
    return (left and not right) if side > 0 else (right and not left)


def turn(
    context: RecoveryContext, heading_rad: float, min_rad: float = _MIN_TURN_RAD
) -> Generator[Leg, Step]:
    """Turn in place to a heading, rad, if it is at least ``min_rad`` away."""
    if abs(wrap_angle(heading_rad - context.pose.theta_rad)) > min_rad:
        yield Turn(wrap_angle(heading_rad), flowing=True)


def follow_perimeter(
    context: RecoveryContext, *, left: bool, touching: bool = False, min_m: float = CLOSED_M
) -> Generator[Leg, Step]:
    """Follow a wall until its perimeter is swept or the wall is lost.

    Args:
        context: the plan's context.
        left: whether the wall is on the left.
        touching: whether the robot touches the wall already.
        min_m: path before the pass can be closed, m.

    """
    wall, options = context.lookout.wall, context.options
    wall.begin_pass(min_m)
    context.enter("perimeter")
    context.record.decide(
        "perimeter-begin", f"perimeter pass: wall on the {'left' if left else 'right'}"
    )
    stuck = again = 0
    side, bumped_m = 1 if left else -1, -math.inf
    speed_m_s = context.geometry.perimeter_speed_m_s
    model = context.model
    felt = not (model.infrared_left if left else model.infrared_right).fitted
    while True:
        wall.begin_leg(side)
        begun_m, begun_s = wall.distance_m, context.obs.time_s
        step = yield FollowWall(
            left, options.perimeter_gap_m, touching=touching, speed_m_s=speed_m_s
        )
        context.lookout.end_segment()
        result = step.result
        reason = result.reason
        stuck = stuck + 1 if wall.distance_m - begun_m < _STUCK_M else 0
        if not reason.blocked or reason is StopReason.TIMEOUT or stuck > _MAX_STUCK:
            break
        again = again + 1 if wall.distance_m - bumped_m < _SAME_BUMP_M else 0
        bumped_m = wall.distance_m
        abeam = side if felt and not again and _touches_only(result, side) else 0
        yield from react(context, result, result.pose.theta_rad, abeam=abeam)
        if reason is StopReason.CLIFF:
            break
        # Turn until the contact is abeam. A contact on the other side is an inner corner.
        ended_s = begun_s + result.duration_s  # the robot may have rested since
        is_ahead = again or ended_s - wall.brisk_s < _STOP_S
        if abeam:
            away = FELT_RAD
        else:
            away = side * context.map.bearing_rad(result, beside=side if is_ahead else 0)
        away = max(QUARTER - away, min(_MIN_AWAY_RAD * (1 + again), QUARTER))
        heading = result.pose.theta_rad - side * away
        ahead = Pose2(context.pose.x_m, context.pose.y_m, heading)
        unswept = context.lookout.fresh_along(ahead, side)
        if wall.distance_m > wall.min_m and unswept < options.fresh_share:
            reason = StopReason.CANCELLED
            break
        yield from turn(context, heading)
        touching = True
    context.record.emit(events.perimeter_ended(reason, wall.distance_m))
