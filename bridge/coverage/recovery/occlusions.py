"""What obstacles hid from lanes: told when found, when gone back for, and when that has ended.

Only for telling: the map knows what is left, and the search finds it. The paper's one slot T
becomes this list.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

MIN_M = 0.15
"""A lane cut short by less hides nothing."""
_STEP_M = 0.04
_CLOSED_SHARE = 0.5
"""A shadow is closed when the lanes gone back for it swept this share of its length."""
_MOST = 64


@dataclass(slots=True)
class OccludedRegion:
    """A strip of a lane that an obstacle hid."""

    number: int
    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    left_m: float
    """Of the length, not swept yet."""

    def overlap_m(self, begin: Pose2, length_m: float, within_m: float) -> float:
        """How much of the strip a lane from a pose passes at no more than ``within_m`` aside."""
        bow_c, bow_s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        c, s = math.cos(begin.theta_rad), math.sin(begin.theta_rad)
        count = max(round(self.length_m / _STEP_M), 1)
        met = 0
        for k in range(count):
            way_m = (k + 0.5) * self.length_m / count
            dx, dy = self.x_m + way_m * bow_c - begin.x_m, self.y_m + way_m * bow_s - begin.y_m
            ahead, aside = dx * c + dy * s, dy * c - dx * s
            met += abs(aside) <= within_m and -within_m <= ahead <= length_m + within_m
        return met * self.length_m / count


class OccludedRegions:
    """The shadows that are open."""

    def __init__(self, width_m: float) -> None:
        """``width_m``: of the mouth."""
        self._within_m = 0.5 * width_m
        self.open: list[OccludedRegion] = []
        self._found = 0

    def found(
        self, end: Pose2, heading_rad: float, planned_m: float, done_m: float
    ) -> OccludedRegion:
        """A lane of ``planned_m`` ended at ``end`` after ``done_m``: what lies beyond is hidden."""
        self._found += 1
        rest_m = planned_m - done_m
        occlusion = OccludedRegion(self._found, end.x_m, end.y_m, heading_rad, rest_m, rest_m)
        self.open.append(occlusion)
        del self.open[:-_MOST]
        return occlusion

    def met(self, begin: Pose2, length_m: float) -> OccludedRegion | None:
        """The open shadow of which a lane passes most; ``None``: it passes none."""
        best, max_m = None, MIN_M
        for occlusion in self.open:
            over_m = occlusion.overlap_m(begin, length_m, self._within_m)
            if over_m >= max_m:
                best, max_m = occlusion, over_m
        return best

    def swept(self, occlusion: OccludedRegion, begin: Pose2, length_m: float) -> bool:
        """Take note of a lane driven for a shadow; true: the shadow is closed by it."""
        occlusion.left_m -= occlusion.overlap_m(begin, length_m, self._within_m)
        closed = occlusion.left_m <= (1.0 - _CLOSED_SHARE) * occlusion.length_m
        if closed and occlusion in self.open:
            self.open.remove(occlusion)
        return closed
