"""Dead reckoning: encoder counts, and the motion in one encoder interval (paper eq. 5)."""

from __future__ import annotations

import math

from bridge.motion.geometry import Pose2, wrap_angle

ENCODER_MODULUS = 1 << 16
_HALF = ENCODER_MODULUS >> 1
_SERIES_BELOW_RAD = 1e-3
"""Half angle below which sin(x)/x is computed as 1 - x²/6, rad. The error is < x⁴/120 < 1e-14."""


def encoder_delta(previous: int, current: int) -> int:
    """Return the counts from ``previous`` to ``current`` of a 16-bit counter that wraps around.

    The result is the shorter difference, in [-32768, 32767]. It is right if the wheel has turned by
    less than half the counter's range: 4.3 m with the default wheel.
    """
    return ((current - previous + _HALF) % ENCODER_MODULUS) - _HALF


def sinc(x_rad: float) -> float:
    """Return sin(x)/x, continuous at zero: the bracket of the paper's eq. 5."""
    if -_SERIES_BELOW_RAD < x_rad < _SERIES_BELOW_RAD:
        return 1.0 - x_rad * x_rad / 6.0
    return math.sin(x_rad) / x_rad


def advance_arc(pose: Pose2, travel_m: float, rotation_rad: float) -> Pose2:
    """Move along a circular arc (paper eq. 5).

    This is exact if the wheel speeds have a fixed ratio.

    ``travel_m`` is the length of the arc, ``rotation_rad`` the change of heading.
    """
    half = 0.5 * rotation_rad
    chord_m = travel_m * sinc(half)
    mid = pose.theta_rad + half
    return Pose2(
        pose.x_m + chord_m * math.cos(mid),
        pose.y_m + chord_m * math.sin(mid),
        wrap_angle(pose.theta_rad + rotation_rad),
    )
