"""Frames of walls: the walls of a frame are parallel or orthogonal.

Most rooms have right angles, but boxes in them may be oblique. So orthogonality needs evidence: the
standard deviation of the angle between two walls must be less than ``sure_rad``, and the angle
must agree with a multiple of 90°. The walls of an oblique box have their own frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

_QUARTER = 0.5 * math.pi


@dataclass(frozen=True, slots=True)
class FrameTuning:
    """Evidence that two walls are orthogonal or parallel."""

    new_span_m: float = 0.15
    """Length below which a wall's direction counts as unknown, m."""
    sure_rad: float = math.radians(0.9)
    """Maximum standard deviation of the angle between two walls, rad."""
    orthogonal_rad: float = math.radians(0.15)
    """Standard deviation of the right angles in a well-built room, rad."""
    gate_sigmas: float = 2.5
    """Maximum difference of the angle from a multiple of 90°, in standard deviations."""
    gate_rad: float = math.radians(1.6)
    """Maximum difference of the angle from a multiple of 90°, rad."""
    long_m: float = 0.5
    """Minimum wall length for the weaker limits ``long_sure_rad`` and ``long_gate_rad``, m."""
    long_sure_rad: float = math.radians(2.0)
    """Maximum standard deviation of the angle between long walls, rad. It is larger than for short
    walls, because a slightly oblique box rarely has long walls."""
    long_gate_rad: float = math.radians(3.5)
    """Maximum difference of the angle between long walls from a multiple of 90°, rad."""


@dataclass(slots=True)
class Wall:
    """Data of a wall. Its direction and distance are states of the filter."""

    anchor_x_m: float
    """Anchor point in the frame of the estimate, m."""
    anchor_y_m: float
    """Anchor point in the frame of the estimate, m."""
    low_m: float
    """Start of the measured part of the wall, m, along (-sin α, cos α) from the anchor point."""
    high_m: float
    """End of the measured part of the wall, m."""
    seen_m: float = 0.0
    """Sum of the lengths of the measured pieces, m."""
    measurements: int = 0
    """Number of measurements."""
    frame: int = -1
    """Number of the wall's frame; -1: no frame."""
    number: int = 0
    """Number of the wall. Walls are numbered in the order of their first measurement."""


class Frames:
    """Groups walls into frames."""

    def __init__(self, walls: list[Wall], tuning: FrameTuning) -> None:
        """Group the walls of this list. The list belongs to the map."""
        self._tuning = tuning
        self._walls = walls
        self._newest = -1
        self.longest = -1
        """Index of a wall in the frame with the largest measured length; -1: no frame."""

    def partner(
        self, i: int, alphas: Sequence[float], p: NDArray[np.float64]
    ) -> tuple[int, float] | None:
        """Return the longest wall that is orthogonal or parallel to a wall but not in its frame.

        The second value is the difference of their angle from a multiple of 90°, rad. Return None
        if there is no such wall.

        Args:
            i: index of the wall.
            alphas: direction of each wall's normal, rad.
            p: covariance of these directions, ``(walls, walls)``, rad².

        """
        tuning, wall = self._tuning, self._walls[i]
        found, longest = None, -1.0
        for j, other in enumerate(self._walls):
            if j == i or other.seen_m <= longest or other.seen_m < tuning.new_span_m:
                continue
            if wall.frame == other.frame >= 0:
                continue
            variance = float(p[i, i] + p[j, j] - 2.0 * p[i, j])
            is_long = min(wall.seen_m, other.seen_m) >= tuning.long_m
            if variance > (tuning.long_sure_rad if is_long else tuning.sure_rad) ** 2:
                continue
            off = math.remainder(alphas[i] - alphas[j], _QUARTER)
            sigma = math.sqrt(max(variance, 0.0) + tuning.orthogonal_rad**2)
            gate = tuning.long_gate_rad if is_long else tuning.gate_rad
            if abs(off) < min(tuning.gate_sigmas * sigma, gate):
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
        self.find_longest()

    def find_longest(self) -> None:
        """Find the frame with the largest length, after walls were joined or marginalised."""
        seen_m: dict[int, float] = {}
        for wall in self._walls:
            if wall.frame >= 0:
                seen_m[wall.frame] = seen_m.get(wall.frame, 0.0) + wall.seen_m
        frame = max(seen_m, key=lambda each: seen_m[each], default=-1)
        self.longest = next((i for i, w in enumerate(self._walls) if w.frame == frame >= 0), -1)
