"""Planar poses and angles."""

from __future__ import annotations

import math
from typing import NamedTuple

_TAU = 2.0 * math.pi


def wrap_angle(angle_rad: float) -> float:
    """Wrap an angle to [-π, π)."""
    return (angle_rad + math.pi) % _TAU - math.pi


class Pose2(NamedTuple):
    """A pose in the plane: position of the axle's centre, and heading.

    Units are m and rad. ``theta_rad`` is counter-clockwise from +x.
    """

    x_m: float
    """Position, m."""
    y_m: float
    """Position, m; y is to the left of x."""
    theta_rad: float
    """Heading, rad; 0: along x, positive: counter-clockwise."""

    def transform(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Transform a point of the body frame to the frame of this pose (paper eq. 1)."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return self.x_m + c * x_m - s * y_m, self.y_m + s * x_m + c * y_m

    def distance_m(self, other: Pose2) -> float:
        """Return the straight-line distance between the two positions, m."""
        return math.hypot(other.x_m - self.x_m, other.y_m - self.y_m)

    def along_m(self, other: Pose2) -> float:
        """Return the distance to another position along this pose's heading, m."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return (other.x_m - self.x_m) * c + (other.y_m - self.y_m) * s
