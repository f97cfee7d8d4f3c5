"""Cliffs: places where the cliff sensor detected no floor, and the resulting limits.

The sensor has three light barriers under the front rim but reports only one bit. So the planner
does not know which barrier detected the cliff, or the direction of the edge. No range sensor
detects a cliff, so the robot does not follow the edge. Lanes may lead to a cliff; near a known
cliff the robot drives slowly. Perimeter passes do not begin near a cliff.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.recovery.geometry import PlannerGeometry
    from bridge.coverage.recovery.options import RecoveryOptions

SPAN_RAD = math.radians(55.0)
"""Angle between the heading and each outer barrier, rad."""
_INSIDE_M = 0.01
"""Distance from the rim to the barriers, m."""


class Cliffs:
    """Poses at which there was no floor ahead, and the positions of the barriers at these poses."""

    def __init__(self, options: RecoveryOptions, geometry: PlannerGeometry) -> None:
        """Begin without a cliff."""
        self._options = options
        self._radius_m = geometry.radius_m
        self._near_m = geometry.cliff_slow_m
        self.poses: list[Pose2] = []
        self.rims: list[tuple[float, float]] = []
        """Position of the middle of the front rim at each pose, m."""
        self.marks: list[Pose2] = []
        """Positions of the barriers that may have detected the cliff, each with the robot's
        heading."""

    def __bool__(self) -> bool:
        """Return True if any cliff was detected."""
        return bool(self.poses)

    def add(self, pose: Pose2, floor: Callable[[float, float], bool]) -> None:
        """Add a pose, unless an almost equal pose is stored.

        ``floor`` returns True for a point next to the driven path. There must be floor at that
        point.
        """
        same_m, same_rad = self._options.cliff_same_m, self._options.cliff_same_rad
        for known in self.poses:
            turned = math.remainder(known.theta_rad - pose.theta_rad, math.tau)
            if known.distance_m(pose) < same_m and abs(turned) < same_rad:
                return
        self.poses.append(pose)
        self.rims.append(pose.transform(self._radius_m, 0.0))
        spots = self._spots(pose)
        missing = [spot for spot in spots if not floor(*spot)] or spots
        self.marks += [Pose2(x, y, pose.theta_rad) for x, y in missing]

    def see_floor(self, pose: Pose2) -> None:
        """Remove the marks that are disproved because all barriers detect floor at a pose."""
        if not self.marks or not self.beside(pose.x_m, pose.y_m, self._near_m):
            return
        spots = self._spots(pose)
        self.marks = [
            mark for mark in self.marks if not any(self._beyond(mark, *spot) for spot in spots)
        ]

    def clear(self, pose: Pose2, radius_m: float) -> None:
        """Remove the marks within a radius of a pose."""
        self.poses = [known for known in self.poses if known.distance_m(pose) > radius_m]
        self.rims = [known.transform(self._radius_m, 0.0) for known in self.poses]
        self.marks = [mark for mark in self.marks if mark.distance_m(pose) > radius_m]

    def beside(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Return True if a point is within ``radius_m`` of a rim position with missing floor."""
        limit = radius_m * radius_m
        return any((x - x_m) ** 2 + (y - y_m) ** 2 < limit for x, y in self.rims)

    def speed_limit_m_s(self, pose: Pose2) -> float:
        """Return the maximum forward speed, m/s; infinite if no cliff is near."""
        near = self.beside(pose.x_m, pose.y_m, self._near_m)
        return self._options.cliff_m_s if near else math.inf

    def _spots(self, pose: Pose2) -> list[tuple[float, float]]:
        reach_m = self._radius_m - _INSIDE_M
        return [
            pose.transform(reach_m * math.cos(bearing), reach_m * math.sin(bearing))
            for bearing in (-SPAN_RAD, 0.0, SPAN_RAD)
        ]

    def _beyond(self, mark: Pose2, x_m: float, y_m: float) -> bool:
        """Return True if a point is just beyond a mark, in the direction of the mark's heading."""
        options = self._options
        c, s = math.cos(mark.theta_rad), math.sin(mark.theta_rad)
        dx, dy = x_m - mark.x_m, y_m - mark.y_m
        return (
            options.cliff_floor_min_m < dx * c + dy * s < options.cliff_floor_max_m
            and abs(dy * c - dx * s) < options.cliff_floor_aside_m
        )
