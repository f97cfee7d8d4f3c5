"""Frames of orthogonal walls: the walls of a frame share their direction.

Rooms are mostly rectilinear, but boxes in them may be oblique. So orthogonality needs evidence: the
angle between two walls must be known better than ``SQUARE_SURE_RAD`` and agree with a multiple of
90°. The walls of an oblique box form their own frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

NEW_SPAN_M = 0.15
"""Length below which a wall's direction counts as unknown, m."""
SQUARE_SURE_RAD = math.radians(0.9)
SQUARE_RAD = math.radians(0.15)
"""Standard deviation of right angles in a well-built room, rad."""
SQUARE_SIGMAS = 2.5
SQUARE_GATE_RAD = math.radians(1.6)
LONG_M = 0.5
"""Minimum length at which the weaker limits ``LONG_SURE_RAD`` and ``LONG_GATE_RAD`` apply, m."""
LONG_SURE_RAD, LONG_GATE_RAD = math.radians(2.0), math.radians(3.5)
"""Limits for long walls, rad: of the angle's standard deviation, and of its difference from a
multiple of 90°. They are weaker than for short walls, because a slightly oblique box rarely has
long walls."""
_QUARTER = 0.5 * math.pi


@dataclass(slots=True)
class Wall:
    """Data of a wall, without its states in the filter: direction and distance."""

    anchor_x_m: float
    anchor_y_m: float
    low_m: float
    """Start of the measured part of the wall, along (-sin α, cos α) from the anchor, m."""
    high_m: float
    """End of the measured part, m."""
    seen_m: float = 0.0
    measurements: int = 0
    frame: int = -1
    """Number of the frame; walls of one frame are orthogonal. -1: none."""
    number: int = 0
    """Number of the wall: walls are numbered in the order in which they are first measured."""


class Frames:
    """Groups walls into frames."""

    def __init__(self, walls: list[Wall]) -> None:
        """Group the walls of this list, which the map owns."""
        self._walls = walls
        self._newest = -1
        self.widest = -1
        """Index of a wall in the frame with the greatest measured length; -1: no frame."""

    def partner(
        self, i: int, alphas: Sequence[float], p: NDArray[np.float64]
    ) -> tuple[int, float] | None:
        """Return the longest wall that is orthogonal or parallel to a wall, but not in its frame.

        The second value is the difference of their angle from a multiple of 90°, rad. The result is
        None if there is no such wall.

        Args:
            i: the wall.
            alphas: direction of each wall's normal, rad.
            p: their covariance, ``(walls, walls)``, rad².

        """
        wall = self._walls[i]
        found, longest = None, -1.0
        for j, other in enumerate(self._walls):
            if j == i or other.seen_m <= longest or other.seen_m < NEW_SPAN_M:
                continue
            if wall.frame == other.frame >= 0:
                continue
            variance = float(p[i, i] + p[j, j] - 2.0 * p[i, j])
            is_long = min(wall.seen_m, other.seen_m) >= LONG_M
            if variance > (LONG_SURE_RAD if is_long else SQUARE_SURE_RAD) ** 2:
                continue
            off = math.remainder(alphas[i] - alphas[j], _QUARTER)
            sigma = math.sqrt(max(variance, 0.0) + SQUARE_RAD**2)
            gate = LONG_GATE_RAD if is_long else SQUARE_GATE_RAD
            if abs(off) < min(SQUARE_SIGMAS * sigma, gate):
                found, longest = (j, off), other.seen_m
        return found

    def join(self, wall: Wall, other: Wall) -> None:
        """Join the frames of two walls."""
        if other.frame < 0:
            other.frame = self._newest = self._newest + 1
        before = wall.frame
        wall.frame = other.frame
        for each in self._walls:
            if each.frame == before >= 0:
                each.frame = other.frame
        self.count()

    def count(self) -> None:
        """Determine the frame with the greatest length after walls were joined or marginalised."""
        seen_m: dict[int, float] = {}
        for wall in self._walls:
            if wall.frame >= 0:
                seen_m[wall.frame] = seen_m.get(wall.frame, 0.0) + wall.seen_m
        most = max(seen_m, key=lambda frame: seen_m[frame], default=-1)
        self.widest = next((i for i, w in enumerate(self._walls) if w.frame == most >= 0), -1)
