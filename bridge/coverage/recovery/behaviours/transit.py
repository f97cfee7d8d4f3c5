"""Transit: a drive along a path of several segments to the start of the chosen target."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.recovery.behaviours.obstacle_following import drive, follow_obstacle
from bridge.coverage.recovery.behaviours.perimeter import QUARTER, follow_perimeter, turn
from bridge.motion.geometry import wrap_angle
from bridge.motion.legs import Drive, StopReason

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.geometry import Pose2
    from bridge.motion.legs import Leg, LegResult

_CONTACT = frozenset({StopReason.RANGE, StopReason.BUMPER, StopReason.STALLED})


def course(pose: Pose2, x_m: float, y_m: float) -> tuple[float, float]:
    """Return the heading (rad) and the distance (m) from a pose to a point."""
    dx, dy = x_m - pose.x_m, y_m - pose.y_m
    return math.atan2(dy, dx), math.hypot(dx, dy)


def end_speed(options: RecoveryOptions, choice: Choice, k: int, heading_rad: float) -> float:
    """Return the speed at the end of segment ``k`` of the path to a choice, m/s."""
    if k + 1 < len(choice.path):
        (x, y), (x1, y1) = choice.path[k : k + 2]
        bend = math.atan2(y1 - y, x1 - x) - heading_rad
    elif choice.kind == "lane":
        bend = choice.heading_rad - heading_rad
    else:  # the robot chooses the direction when it is at the wall
        return options.corner_m_s
    return options.bend_m_s if abs(wrap_angle(bend)) < options.slight_rad else options.corner_m_s


def transit(context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
    """Drive to the start of a choice.

    Returns:
        True if the robot arrived. If it is blocked, it follows the obstacle or seeks a passage.

    """
    context.enter("transit", choice.path[-1])
    context.stuck.begin_transit()
    for k, (x, y) in enumerate(choice.path):
        heading, distance = course(context.pose, x, y)
        if distance < context.options.min_leg_m:
            continue
        yield from turn(context, heading, context.options.bend_rad)
        heading, distance = course(context.pose, x, y)  # the robot may have moved in the turn
        if distance < context.options.min_leg_m:
            continue
        leg = straight(context, heading, distance, end_speed(context.options, choice, k, heading))
        result = yield from drive(context, leg)
        if result.reason.blocked and distance - result.distance_m > context.options.blocked_m:
            return (yield from take_block(context, choice, result, heading))
    return True


def straight(
    context: RecoveryContext, heading_rad: float, distance_m: float, end_m_s: float
) -> Drive:
    """Return the leg for a straight part of a path to a choice."""
    return Drive(
        heading_rad,
        distance_m,
        speed_m_s=context.geometry.lane_speed_m_s,
        stop_range_m=context.geometry.stop_range_m,
        end_m_s=end_m_s,
        wary=True,
        purpose="transit",
    )


def take_block(
    context: RecoveryContext, choice: Choice, result: LegResult, heading_rad: float
) -> Generator[Leg, Step, bool]:
    """Follow the obstacle that ended the path to a choice early, or seek a passage.

    Returns:
        True if the obstacle is the wall to which a heading fix drives.

    """
    reason = f"the path to the {choice.kind} ended early: {result.reason}"
    context.record.decide("blocked", reason)
    if choice.kind == "heading-fix":
        near = math.dist(context.pose[:2], choice.path[-1]) < context.geometry.same_place_m
        return near and result.reason in _CONTACT
    if not (yield from follow_obstacle(context, result)):
        context.stuck.blocked(result, heading_rad)
        yield from _seek_passage(context, result, choice.new_m2)
    return False


def _seek_passage(
    context: RecoveryContext, result: LegResult, new_m2: float
) -> Generator[Leg, Step]:
    """Follow the obstacle that blocked the robot, if the stuck policy allows it."""
    if not context.stuck.seeks_passage(result, new_m2):
        return
    left = result.bumper_left
    away = context.evidence_map.bearing_rad(result) + (-QUARTER if left else QUARTER)
    if (yield from turn(context, result.pose.theta_rad + away)):
        return
    yield from follow_perimeter(
        context, left=left, touching=True, min_m=context.options.passage_m * context.geometry.scale
    )
