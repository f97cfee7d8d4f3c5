"""Events of the recovery planner: each decision with its reason and figures.

Lengths in m, areas in cm², rounded for people and for the log.
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
    """A lane or a perimeter pass is chosen."""
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
    """A lane has ended."""
    reason = _LANE_ENDS.get(result.reason, f"lane ended early: {result.reason}")
    figures: dict[str, Scalar] = {"length_m": round(result.distance_m, 2), "new_cm2": _cm2(new_m2)}
    return PlannerEvent("lane-end", reason, figures)


def perimeter_ended(reason: StopReason, length_m: float) -> PlannerEvent:
    """A perimeter pass has ended."""
    why = _PERIMETER_ENDS.get(reason, f"perimeter pass blocked: {reason}")
    return PlannerEvent("perimeter-end", why, {"length_m": round(length_m, 2)})


def obstacle_met(result: LegResult) -> PlannerEvent:
    """An obstacle ended a leg."""
    x_m, y_m = round(result.pose.x_m, 3), round(result.pose.y_m, 3)
    reason = f"{result.leg.purpose} ended: {result.reason}"
    return PlannerEvent("obstacle", reason, {"x_m": x_m, "y_m": y_m})


def occlusion_found(occlusion: OccludedRegion) -> PlannerEvent:
    """An obstacle occludes a region."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "x_m": round(occlusion.x_m, 3),
        "y_m": round(occlusion.y_m, 3),
        "length_m": round(occlusion.length_m, 2),
    }
    reason = "an obstacle occludes the rest of the lane"
    return PlannerEvent("occlusion", reason, figures)


def recovery_begun(occlusion: OccludedRegion) -> PlannerEvent:
    """A lane revisits an occluded region."""
    figures: dict[str, Scalar] = {
        "occlusion": occlusion.number,
        "left_m": round(occlusion.left_m, 2),
    }
    return PlannerEvent("recovery-begin", "return to an occluded region", figures)


def recovery_ended(
    occlusion: OccludedRegion, new_m2: float, *, arrived: bool, closed: bool
) -> PlannerEvent:
    """A revisit has ended; ``left_m`` is the remaining unswept length."""
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
