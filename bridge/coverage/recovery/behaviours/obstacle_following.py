"""Driving a leg, and following the obstacle that ended it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.contact import react
from bridge.coverage.recovery.behaviours.perimeter import QUARTER, follow_perimeter, turn
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Leg, LegResult, StopReason, Turn

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Part, Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Drive


def drive(context: RecoveryContext, leg: Drive | Turn) -> Part:
    """Drive a leg or an arc, add every obstacle to the map, and back off from a contact.

    A wall with an unswept perimeter beside a lane also ends the lane. The robot then follows that
    wall.
    """
    monitor, is_lane = context.monitor, leg.purpose == "lane"
    monitor.on_lane, monitor.beside = is_lane, 0
    before = context.evidence_map.new_cells
    step = yield leg
    monitor.on_lane = False
    result = step.result
    if is_lane:
        new_m2 = context.geometry.area_m2(context.evidence_map.new_cells - before)
        context.record.emit(events.lane_ended(result, new_m2))
    if result.reason is StopReason.CANCELLED:
        context.record.decide("obstacle", "unknown wall beside the lane")
        yield from follow_perimeter(context, left=monitor.beside > 0)
        return result
    heading_rad = result.pose.theta_rad if isinstance(leg, Turn) else leg.heading_rad
    yield from react(context, result, heading_rad)
    return result


def follow_obstacle(context: RecoveryContext, result: LegResult) -> Generator[Leg, Step, bool]:
    """Follow the obstacle that ended a drive early. Do nothing if the floor at it is swept.

    Returns:
        True if the perimeter was followed. A cliff is never followed, because no sensor measures
        its edge.

    """
    if not result.reason.blocked or result.reason is StopReason.CLIFF:
        return False
    pose = result.pose
    bearing = context.evidence_map.bearing_rad(result)
    left = bearing > 0.0
    towards = Pose2(pose.x_m, pose.y_m, pose.theta_rad + bearing)
    ahead_m, beside_m = context.geometry.contact_ahead_m, context.geometry.contact_beside_m
    if (
        context.evidence_map.fresh(towards, ahead_m, (-beside_m, beside_m))
        < context.options.obstacle_unswept
    ):
        return False
    away = bearing + (-QUARTER if left else QUARTER)
    if (yield from turn(context, pose.theta_rad + away)):
        return False
    yield from follow_perimeter(context, left=left, touching=True)
    return True
