"""Occluded regions: parts of lanes that an obstacle hid.

The list is used for events only. The search finds unswept floor in the map, not in this list. The
list replaces the paper's single memory slot T.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.geometry import Pose2

_STEP_M = 0.04
"""Step size of the overlap computation, m."""
_MAX_OPEN = 64
"""Maximum number of stored regions."""


@dataclass(slots=True)
class OccludedRegion:
    """A strip of a lane that an obstacle occluded."""

    number: int
    """Number of the region. Regions are numbered in the order of their detection."""
    x_m: float
    """Start of the strip, m."""
    y_m: float
    """Start of the strip, m."""
    heading_rad: float
    """Direction of the strip, rad."""
    length_m: float
    """Length of the strip, m."""
    left_m: float
    """Unswept length, m."""

    def overlap_m(self, begin: Pose2, length_m: float, within_m: float) -> float:
        """Return the length of a lane from ``begin`` within ``within_m`` of this region, m."""
        bow_c, bow_s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        c, s = math.cos(begin.theta_rad), math.sin(begin.theta_rad)
        count = max(round(self.length_m / _STEP_M), 1)
        covered = 0
        for k in range(count):
            path_m = (k + 0.5) * self.length_m / count
            dx, dy = self.x_m + path_m * bow_c - begin.x_m, self.y_m + path_m * bow_s - begin.y_m
            ahead, aside = dx * c + dy * s, dy * c - dx * s
            covered += abs(aside) <= within_m and -within_m <= ahead <= length_m + within_m
        return covered * self.length_m / count


class OccludedRegions:
    """The open occluded regions."""

    def __init__(self, options: RecoveryOptions, width_m: float) -> None:
        """Begin without a region. ``width_m`` is the mouth's width."""
        self._options = options
        self._within_m = 0.5 * width_m
        self.open: list[OccludedRegion] = []
        self._found = 0

    def found(
        self, end: Pose2, heading_rad: float, planned_m: float, done_m: float
    ) -> OccludedRegion:
        """Add the region beyond ``end``. The lane of ``planned_m`` ended there after ``done_m``."""
        self._found += 1
        rest_m = planned_m - done_m
        occlusion = OccludedRegion(self._found, end.x_m, end.y_m, heading_rad, rest_m, rest_m)
        self.open.append(occlusion)
        del self.open[:-_MAX_OPEN]
        return occlusion

    def overlapping(self, begin: Pose2, length_m: float) -> OccludedRegion | None:
        """Return the open region with the largest overlap with a lane; None: no overlap."""
        best, max_m = None, self._options.occlusion_min_m
        for occlusion in self.open:
            over_m = occlusion.overlap_m(begin, length_m, self._within_m)
            if over_m >= max_m:
                best, max_m = occlusion, over_m
        return best

    def swept(self, occlusion: OccludedRegion, begin: Pose2, length_m: float) -> bool:
        """Subtract a lane from a region. Return True if the region is now closed."""
        occlusion.left_m -= occlusion.overlap_m(begin, length_m, self._within_m)
        left_share = 1.0 - self._options.occlusion_closed_share
        closed = occlusion.left_m <= left_share * occlusion.length_m
        if closed and occlusion in self.open:
            self.open.remove(occlusion)
        return closed
