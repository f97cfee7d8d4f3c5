"""Reaction to a contact, an obstacle or a cliff: add it to the map, and back off."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bridge.coverage.recovery import events
from bridge.motion.legs import Drive, StopReason

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Step
    from bridge.coverage.recovery.context import RecoveryContext
    from bridge.motion.legs import Leg, LegResult


def react(
    context: RecoveryContext, result: LegResult, heading_rad: float, *, abeam: int = 0
) -> Generator[Leg, Step]:
    """Add the obstacle that stopped a leg to the map, and back off against the leg's heading.

    ``abeam`` is the side of a wall that the robot follows in contact: left (1) or right (-1).
    """
    if result.reason is StopReason.RANGE:
        point = result.pose.transform(context.geometry.range_point_m, 0.0)
        context.evidence_map.add_point(*point)
        context.record.emit(events.obstacle_found(result))
    elif result.reason is StopReason.CLIFF:
        context.evidence_map.add_cliff(context.monitor.cliff_at or result.pose)
        context.record.emit(events.obstacle_found(result))
        yield from _leave_cliff(context, heading_rad)
    elif result.reason in {StopReason.BUMPER, StopReason.STALLED}:
        no_switch = not (result.bumper_left or result.bumper_right)
        context.evidence_map.add_bump(
            result.pose,
            left=result.bumper_left or no_switch,
            right=result.bumper_right or no_switch,
            abeam=abeam,
        )
        context.record.emit(events.obstacle_found(result))
        back_m = context.options.back_off_m
        yield Drive(
            heading_rad, -back_m, speed_m_s=context.options.back_off_m_s, purpose="back-off"
        )


def _leave_cliff(context: RecoveryContext, heading_rad: float) -> Generator[Leg, Step]:
    """Back off until the sensor detects floor ahead, then a few centimetres more."""
    back_m = context.options.cliff_back_off_m
    back = Drive(heading_rad, -back_m, speed_m_s=context.options.back_off_m_s, purpose="back-off")
    for _ in range(context.options.max_backs):
        yield back
        if not context.obs.cliff:
            yield replace(back, distance_m=-context.options.cliff_clear_m)
            return
