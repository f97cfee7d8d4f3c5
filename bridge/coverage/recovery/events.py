"""Events of the recovery planner: each decision with its reason and values.

Lengths are in m, areas in cm². All values are rounded for display and for the log.
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
    StopReason.DISTANCE: "lane complete",
    StopReason.CANCELLED: "lane cancelled: an unknown wall beside it",
}
_PERIMETER_ENDS = {
    StopReason.CANCELLED: "perimeter pass complete: the floor ahead is swept",
    StopReason.LOST: "perimeter pass ended: wall lost",
}


def chosen(choice: Choice) -> PlannerEvent:
    """Return the event for a chosen lane or perimeter pass."""
    x_m, y_m = choice.path[-1]
    reason = (
        "next lane: most new floor per second"
        if choice.kind == "lane"
        else "next perimeter pass: a wall not followed yet"
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
    """Return the event for the end of a lane."""
    reason = _LANE_ENDS.get(result.reason, f"lane ended early: {result.reason}")
    figures: dict[str, Scalar] = {"length_m": round(result.distance_m, 2), "new_cm2": _cm2(new_m2)}
    return PlannerEvent("lane-end", reason, figures)


def perimeter_ended(reason: StopReason, length_m: float) -> PlannerEvent:
    """Return the event for the end of a perimeter pass."""
    why = _PERIMETER_ENDS.get(reason, f"perimeter pass blocked: {reason}")
    return PlannerEvent("perimeter-end", why, {"length_m": round(length_m, 2)})


def obstacle_found(result: LegResult) -> PlannerEvent:
    """Return the event for an obstacle that ended a leg."""
    x_m, y_m = round(result.pose.x_m, 3), round(result.pose.y_m, 3)
    reason = f"{result.leg.purpose} ended: {result.reason}"
    return PlannerEvent("obstacle", reason, {"x_m": x_m, "y_m": y_m})


def occlusion_found(occlusion: OccludedRegion) -> PlannerEvent:
    """Return the event for a region that an obstacle occludes."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "x_m": round(occlusion.x_m, 3),
        "y_m": round(occlusion.y_m, 3),
        "length_m": round(occlusion.length_m, 2),
    }
    reason = "an obstacle occludes the rest of the lane"
    return PlannerEvent("occlusion", reason, figures)


def recovery_begun(occlusion: OccludedRegion) -> PlannerEvent:
    """Return the event for a lane that revisits an occluded region."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "left_m": round(occlusion.left_m, 2),
    }
    return PlannerEvent("recovery-begin", "return to an occluded region", figures)


def recovery_ended(
    occlusion: OccludedRegion, new_m2: float, *, arrived: bool, closed: bool
) -> PlannerEvent:
    """Return the event for the end of a revisit. ``left_m`` is the length that is still unswept."""
    if not arrived:
        reason = "no path to the occluded region"
    elif closed:
        reason = "occluded region closed: at least half of it swept"
    else:
        reason = "occluded region partly swept"
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "left_m": round(max(occlusion.left_m, 0.0), 2),
        "new_cm2": _cm2(new_m2),
    }
    return PlannerEvent("recovery-end", reason, figures)


def _cm2(area_m2: float) -> int:
    return round(area_m2 * 1e4)
