"""Dead reckoning: one encoder interval applied to a pose (paper eq. 5-7)."""

from __future__ import annotations

import math

from bridge.motion.geometry import Pose2, wrap_angle

_SERIES_BELOW_RAD = 1e-3
"""Half angle below which sin(x)/x is 1 - x²/6 with an error below x⁴/120 < 1e-14, rad."""


def sinc(x_rad: float) -> float:
    """sin(x)/x, continuous through zero: the bracket of eq. 5."""
    if -_SERIES_BELOW_RAD < x_rad < _SERIES_BELOW_RAD:
        return 1.0 - x_rad * x_rad / 6.0
    return math.sin(x_rad) / x_rad


def advance_arc(pose: Pose2, travel_m: float, rotation_rad: float) -> Pose2:
    """Move along a circular arc (eq. 5), exact for a constant ratio of the wheel speeds.

    ``travel_m`` is the arc's length, ``rotation_rad`` the change of heading over it.
    """
    half = 0.5 * rotation_rad
    chord_m = travel_m * sinc(half)
    mid = pose.theta_rad + half
    return Pose2(
        pose.x_m + chord_m * math.cos(mid),
        pose.y_m + chord_m * math.sin(mid),
        wrap_angle(pose.theta_rad + rotation_rad),
    )


def advance_midpoint(pose: Pose2, travel_m: float, rotation_rad: float) -> Pose2:
    """Move by the paper's second-order form (eq. 7): eq. 5 with sinc taken as 1.

    Its heading is exact. Its position lies in the right direction but too far, by at most
    :func:`midpoint_error_bound_m`.
    """
    mid = pose.theta_rad + 0.5 * rotation_rad
    return Pose2(
        pose.x_m + travel_m * math.cos(mid),
        pose.y_m + travel_m * math.sin(mid),
        wrap_angle(pose.theta_rad + rotation_rad),
    )


def midpoint_error_bound_m(travel_m: float, rotation_rad: float) -> float:
    """Bound on the distance between eq. 7 and eq. 5: |ΔS| · dθ² / 24.

    From 1 - sinc(x) ≤ x²/6 with x = dθ/2. At 0.2 m/s, 2 rad/s and 50 Hz: 0.27 µm a step.
    """
    return abs(travel_m) * rotation_rad * rotation_rad / 24.0
