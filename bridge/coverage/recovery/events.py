"""What the recovery planner tells of its decisions: events with a reason and the figures behind it.

Lengths in metres, areas in cm²: for people and for the log, rounded to what can be known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.coverage.planner import PlannerEvent, Scalar
from bridge.motion.legs import StopReason

if TYPE_CHECKING:
    from bridge.coverage.recovery.occlusions import OccludedRegion
    from bridge.coverage.recovery.search import Choice
    from bridge.motion.legs import LegResult

_LANE_ENDS = {
    StopReason.DISTANCE: "driven to its end",
    StopReason.CANCELLED: "left for what came into view beside it",
}
_PERIMETER_ENDS = {
    StopReason.CANCELLED: "closed: what lies ahead is swept",
    StopReason.LOST: "the wall is lost",
}


def chosen(choice: Choice) -> PlannerEvent:
    """A lane or an outline is taken."""
    x_m, y_m = choice.way[-1]
    reason = (
        "the lane that sweeps most per time"
        if choice.kind == "lane"
        else "a wall whose outline was not followed"
    )
    figures: dict[str, Scalar] = {
        "x_m": round(x_m, 3),
        "y_m": round(y_m, 3),
        "length_m": round(choice.length_m, 2),
        "new_cm2": _cm2(choice.new_m2),
        "rate_cm2_s": round(choice.rate_m2_s * 1e4, 1),
    }
    return PlannerEvent(choice.kind, reason, figures)


def lane_ended(result: LegResult, new_m2: float) -> PlannerEvent:
    """A lane was driven, or a part of it."""
    reason = _LANE_ENDS.get(result.reason, f"ended early: {result.reason}")
    figures: dict[str, Scalar] = {"length_m": round(result.distance_m, 2), "new_cm2": _cm2(new_m2)}
    return PlannerEvent("lane-end", reason, figures)


def perimeter_ended(reason: StopReason, length_m: float) -> PlannerEvent:
    """A wall was followed for so long."""
    why = _PERIMETER_ENDS.get(reason, f"no way along the wall: {reason}")
    return PlannerEvent("perimeter-end", why, {"length_m": round(length_m, 2)})


def obstacle_met(result: LegResult) -> PlannerEvent:
    """Something in the world ended a leg."""
    x_m, y_m = round(result.pose.x_m, 3), round(result.pose.y_m, 3)
    reason = f"{result.leg.purpose} ended: {result.reason}"
    return PlannerEvent("obstacle", reason, {"x_m": x_m, "y_m": y_m})


def occlusion_found(occlusion: OccludedRegion) -> PlannerEvent:
    """An obstacle hides a strip."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "x_m": round(occlusion.x_m, 3),
        "y_m": round(occlusion.y_m, 3),
        "length_m": round(occlusion.length_m, 2),
    }
    reason = "an obstacle hides the rest of the lane: kept, to go back for"
    return PlannerEvent("occlusion", reason, figures)


def recovery_begun(occlusion: OccludedRegion) -> PlannerEvent:
    """A lane goes back for a shadow."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "left_m": round(occlusion.left_m, 2),
    }
    return PlannerEvent("recovery-begin", "back for what an obstacle hid", figures)


def recovery_ended(
    occlusion: OccludedRegion, new_m2: float, *, arrived: bool, closed: bool
) -> PlannerEvent:
    """What going back for it gave. ``left_m`` is what no lane has passed, not what the map says."""
    if not arrived:
        reason = "no way to it was found"
    elif closed:
        reason = "closed: half of what was hidden was driven over, or more"
    else:
        reason = "a part of it was driven over"
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "left_m": round(max(occlusion.left_m, 0.0), 2),
        "new_cm2": _cm2(new_m2),
    }
    return PlannerEvent("recovery-end", reason, figures)


def _cm2(area_m2: float) -> int:
    return round(area_m2 * 1e4)
