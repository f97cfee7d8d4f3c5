"""The perimeter pass: follow the boundary of a wall or an obstacle until its floor is swept."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.contact import react
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import FollowWall, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Leg, LegResult

QUARTER = 0.5 * math.pi


def _touches_only(result: LegResult, side: int) -> bool:
    """Return True if the bumper switch on one side is pressed and the other switch is not."""
    left, right = result.bumper_left, result.bumper_right
    return (left and not right) if side > 0 else (right and not left)


def turn(
    context: RecoveryContext, heading_rad: float, min_rad: float = 0.0
) -> Generator[Leg, Step, bool]:
    """Turn in place to a heading, rad, if the turn is at least ``min_rad``.

    If a cliff appears during the turn, the robot backs off from it and continues the turn.

    Returns:
        True if a cliff appeared, so that the robot is no longer at its place.

    """
    moved = False
    for _ in range(context.options.max_backs):
        if abs(wrap_angle(heading_rad - context.pose.theta_rad)) <= min_rad:
            break
        step = yield Turn(wrap_angle(heading_rad), flowing=True, ends_at_cliff=True)
        if step.result.reason is not StopReason.CLIFF:
            break
        moved = True
        yield from react(context, step.result, step.result.pose.theta_rad)
    return moved


def follow_perimeter(
    context: RecoveryContext, *, left: bool, touching: bool = False, min_m: float | None = None
) -> Generator[Leg, Step]:
    """Follow a wall until its perimeter is swept or the wall is lost.

    Args:
        context: the plan's context.
        left: True if the wall is on the left.
        touching: True if the robot already touches the wall.
        min_m: minimum path before the pass can end as complete, m; None: the value in the options.

    """
    wall, options = context.monitor.wall, context.options
    wall.begin_pass(options.closed_after_m if min_m is None else min_m)
    context.enter("perimeter")
    context.record.decide(
        "perimeter-begin", f"perimeter pass: wall on the {'left' if left else 'right'}"
    )
    stuck = again = 0
    side, last_stop_m = 1 if left else -1, -math.inf
    speed_m_s = context.geometry.perimeter_speed_m_s
    model = context.model
    by_contact = not (model.infrared_left if left else model.infrared_right).fitted
    while True:
        wall.begin_leg(side)
        begun_m = wall.distance_m
        step = yield FollowWall(
            left, options.perimeter_gap_m, touching=touching, speed_m_s=speed_m_s
        )
        context.monitor.end_segment()
        result = step.result
        reason = result.reason
        stuck = stuck + 1 if wall.distance_m - begun_m < options.perimeter_stuck_m else 0
        if (
            not reason.blocked
            or reason is StopReason.TIMEOUT
            or stuck > options.perimeter_max_stuck
        ):
            break
        again = again + 1 if wall.distance_m - last_stop_m < options.same_bump_m else 0
        last_stop_m = wall.distance_m
        abeam = side if by_contact and not again and _touches_only(result, side) else 0
        yield from react(context, result, result.pose.theta_rad, abeam=abeam)
        if reason is StopReason.CLIFF:
            break
        # Turn until the contact is beside the robot. A contact on the other side is an inner
        # corner.
        if abeam:
            away = options.oblique_rad
        else:
            away = side * context.evidence_map.bearing_rad(result, beside=side if again else 0)
        away = max(QUARTER - away, min(options.min_away_rad * (1 + again), QUARTER))
        heading = result.pose.theta_rad - side * away
        ahead = Pose2(context.pose.x_m, context.pose.y_m, heading)
        unswept = context.monitor.fresh_along(ahead, side)
        if wall.distance_m > wall.min_m and unswept < options.fresh_share:
            reason = StopReason.CANCELLED
            break
        if (yield from turn(context, heading)):
            reason = StopReason.CLIFF
            break
        touching = True
    context.record.emit(events.perimeter_ended(reason, wall.distance_m))
