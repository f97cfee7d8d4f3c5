"""Sweeping: the first wall, a lane, and a perimeter pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.coverage.recovery import events
from bridge.coverage.recovery.behaviours.obstacle_following import drive, follow_obstacle
from bridge.coverage.recovery.behaviours.perimeter import QUARTER, follow_perimeter, turn
from bridge.coverage.recovery.behaviours.transit import transit
from bridge.coverage.recovery.behaviours.u_turn import UTurn, offset
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, StopReason

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.legs import Leg, LegResult


def approach_wall(context: RecoveryContext) -> Generator[Leg, Step]:
    """Find the first wall and follow it."""
    obs = context.obs
    left, right = obs.infrared_left_m, obs.infrared_right_m
    near_m = context.geometry.approach_range_m
    if right is not None and right < near_m and (left is None or right <= left):
        yield from follow_perimeter(context, left=False)
        return
    if left is not None and left < near_m:
        yield from follow_perimeter(context, left=True)
        return
    stop_m = context.geometry.stop_range_m
    leg = Drive(obs.pose.theta_rad, stop_range_m=stop_m, wary=True, purpose="lane")
    result = yield from drive(context, leg)
    yield from follow_obstacle(context, result)


def sweep_lane(context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
    """Drive to a lane and sweep it. Return True if the robot reached the lane's beginning."""
    u_turn = UTurn.into(context, choice)
    if not (yield from u_turn.drive(context) if u_turn else transit(context, choice)):
        return False
    yield from turn(context, choice.heading_rad, context.options.bend_rad)
    context.enter("lane", choice.path[-1])
    before_m, across_m = offset(context.pose, choice.begin)
    length_m = before_m + choice.length_m
    leg = Drive(
        choice.heading_rad,
        length_m + 0.5 * context.geometry.cell_m,
        speed_m_s=context.geometry.lane_speed_m_s,
        stop_range_m=context.geometry.stop_range_m,
        wary=True,
        purpose="lane",
        across_m=across_m,
    )
    result = yield from drive(context, leg)
    _record_lane(context, result, length_m)
    yield from follow_obstacle(context, result)
    return True


def sweep_perimeter(context: RecoveryContext, choice: Choice) -> Generator[Leg, Step, bool]:
    """Drive to a wall and follow it. Return True if the robot reached the wall."""
    if not (yield from transit(context, choice)):
        return False
    wall_rad, pose = choice.heading_rad - QUARTER, context.pose
    fresh = context.monitor.fresh_along
    ahead_left = fresh(Pose2(pose.x_m, pose.y_m, wall_rad + QUARTER), -1)
    ahead_right = fresh(Pose2(pose.x_m, pose.y_m, wall_rad - QUARTER), 1)
    left = ahead_right > ahead_left
    yield from turn(context, wall_rad - QUARTER if left else wall_rad + QUARTER)
    yield from follow_perimeter(context, left=left, touching=True)
    return True


def choose(context: RecoveryContext) -> Generator[Leg, Step, Choice | None]:
    """Search for the lane or perimeter with the largest area per time; None: none is worth it."""
    search = context.chooser.search(context.evidence_map, context.pose, context.monitor.grid_rad)
    return (yield from context.in_slices(search))


def _record_lane(context: RecoveryContext, result: LegResult, planned_m: float) -> None:
    """Update the paper's variables, and record the region that an obstacle has occluded."""
    context.lane_m = max(result.distance_m, 0.0)
    context.record.change(
        previous_lane_distance_m=context.record.state.lane_distance_m,
        lane_distance_m=context.lane_m,
    )
    cut = result.reason.blocked or result.reason is StopReason.CANCELLED
    if cut and planned_m - context.lane_m > context.options.occlusion_min_m:
        heading = result.pose.theta_rad
        region = context.occlusions.found(result.pose, heading, planned_m, context.lane_m)
        context.record.emit(events.occlusion_found(region))
