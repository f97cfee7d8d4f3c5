"""Position across flat walls seen again, by every ranger.

Once a wall has given the room's directions (see ``wall_yaw``), a ranger that looks square at
a flat surface measures one coordinate of it. The first sight of a surface is kept as a
reference; when a surface stands at the same coordinate again, the difference is the drift of
the position along that direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount

HITS = 6
"""Readings of one surface that make one sight of it: 0.3 s at 20 Hz."""
MAX_SPREAD_M = 0.012
"""Of the coordinates within one sight: more is an edge, or two surfaces."""
HIT_SIGMA_M = 0.004
"""Of a sight: range noise shared by its readings, lag between ranger and encoders."""
SQUARE_RAD = math.radians(3.0)
GATE_SIGMAS = 3.0
GATE_M = 0.05
APART_M = 0.10
"""Between the gate and this a surface is neither seen again nor new: passed over."""
MAX_REFERENCES = 64
_QUARTER = math.pi / 2


class PositionFix(NamedTuple):
    """A measurement of the position's error along a direction."""

    direction_x: float
    direction_y: float
    error_m: float
    """Estimate less truth, along the direction."""
    variance: float


@dataclass(slots=True)
class _Surface:
    quarter: int
    """Which of the four outward directions it is seen in."""
    coordinate_m: float
    variance: float


class SurfaceTracker:
    """One ranger's sights of surfaces that it looks square at."""

    def __init__(self, mount: RangerMount) -> None:
        self._mount = mount
        self._quarter = -1
        self._hits: list[float] = []

    def add(
        self, pose: Pose2, range_m: float | None, grid_rad: float
    ) -> tuple[int, float, float] | None:
        """Take one reading; give (quarter, direction, coordinate) when a sight is complete."""
        mount = self._mount
        facing = pose.theta_rad + mount.yaw_rad
        turn = (facing - grid_rad) / _QUARTER
        quarter = round(turn)
        if range_m is None or abs(turn - quarter) * _QUARTER > SQUARE_RAD:
            self._hits.clear()
            return None
        direction = grid_rad + quarter * _QUARTER
        x, y = pose.transform(mount.x_m, mount.y_m)
        coordinate = x * math.cos(direction) + y * math.sin(direction) + range_m
        hits = self._hits
        if quarter % 4 != self._quarter:
            hits.clear()
            self._quarter = quarter % 4
        hits.append(coordinate)
        if max(hits) - min(hits) > MAX_SPREAD_M:
            del hits[:-1]
            return None
        if len(hits) < HITS:
            return None
        mean = sum(hits) / len(hits)
        hits.clear()
        return self._quarter, direction, mean


class WallPosition:
    """All rangers' sights, the surfaces known, and the position errors that follow."""

    def __init__(self, mounts: tuple[RangerMount, ...]) -> None:
        self._rangers = tuple(SurfaceTracker(mount) for mount in mounts)
        self._surfaces: list[_Surface] = []

    def update(
        self,
        pose: Pose2,
        grid_rad: float,
        ranges_m: tuple[float | None, ...],
        covariance: tuple[float, float, float],
    ) -> list[PositionFix]:
        """Take one reading of each ranger.

        Args:
            pose: the estimate at the readings' time.
            grid_rad: the walls' direction, any of the four.
            ranges_m: one per mount, None where nothing was seen.
            covariance: of the position: xx, xy, yy in m².

        """
        fixes: list[PositionFix] = []
        for ranger, range_m in zip(self._rangers, ranges_m, strict=True):
            sight = ranger.add(pose, range_m, grid_rad)
            if sight is not None:
                fix = self._compare(*sight, covariance)
                if fix is not None:
                    fixes.append(fix)
        return fixes

    def _compare(
        self,
        quarter: int,
        direction_rad: float,
        coordinate_m: float,
        covariance: tuple[float, float, float],
    ) -> PositionFix | None:
        c, s = math.cos(direction_rad), math.sin(direction_rad)
        xx, xy, yy = covariance
        own = c * c * xx + 2.0 * c * s * xy + s * s * yy
        known = [surface for surface in self._surfaces if surface.quarter == quarter]
        nearest = min(known, key=lambda n: abs(n.coordinate_m - coordinate_m), default=None)
        variance = HIT_SIGMA_M**2
        error = 0.0 if nearest is None else coordinate_m - nearest.coordinate_m
        if nearest is None or abs(error) > APART_M:
            if len(self._surfaces) < MAX_REFERENCES:
                self._surfaces.append(_Surface(quarter, coordinate_m, variance + own))
            return None
        total = variance + nearest.variance + own
        if abs(error) > min(GATE_M, GATE_SIGMAS * math.sqrt(total)):
            return None
        # Only the part of the surprise that is neither noise nor the surface's own doubt is
        # drift; the surface is not moved, or slow drift would carry it along.
        return PositionFix(c, s, error, variance + nearest.variance)
