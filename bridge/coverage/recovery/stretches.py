"""Straight stretches of walls that were followed: where the heading can be taken again.

A few dozen numbers, as a microcontroller would keep them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

SIGHT_M = 0.45
"""So much of a wall tells its direction to a fifth of a degree by a noisy infrared."""
OFF_M = 0.02
"""Farther off it than an outline: who rubs against it takes the wall for his heading."""
_LEAST_M = 0.5
_MOST = 24
_BENT_RAD = math.radians(10.0)


class Start(NamedTuple):
    """Where the axle begins along a wall, a little off it."""

    x_m: float
    y_m: float
    heading_rad: float
    side: int
    """The wall is on the left (1) or right (-1)."""


class _Stretch(NamedTuple):
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    side: int

    def starts(self) -> tuple[Start, Start]:
        """From either end."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = self.x_m + self.side * OFF_M * s, self.y_m - self.side * OFF_M * c
        back = wrap_angle(self.heading_rad + math.pi)
        return (
            Start(x, y, self.heading_rad, self.side),
            Start(x + self.length_m * c, y + self.length_m * s, back, -self.side),
        )


class Stretches:
    """Keeps the longest ones."""

    def __init__(self) -> None:
        """None yet."""
        self._begun: Pose2 | None = None
        self._kept: list[_Stretch] = []

    def follow(self, pose: Pose2, side: int, *, straight: bool) -> None:
        """Take a step along a wall on the left (1) or right (-1)."""
        begun = self._begun
        if begun is not None and (
            not straight or abs(wrap_angle(pose.theta_rad - begun.theta_rad)) > _BENT_RAD
        ):
            self.end(pose, side)
        if self._begun is None and straight:
            self._begun = pose

    def end(self, pose: Pose2, side: int) -> None:
        """The wall, or its straight part, ends here."""
        begun, self._begun = self._begun, None
        if begun is None:
            return
        length = begun.distance_m(pose)
        if length < _LEAST_M:
            return
        heading = math.atan2(pose.y_m - begun.y_m, pose.x_m - begun.x_m)
        self._kept.append(_Stretch(length, begun.x_m, begun.y_m, heading, side))
        if len(self._kept) > _MOST:
            self._kept.remove(min(self._kept))

    def nearest(self, pose: Pose2) -> Start | None:
        """The nearest beginning, of either end; ``None``: nothing straight is known."""
        starts = (start for stretch in self._kept for start in stretch.starts())
        return min(
            starts, key=lambda s: math.hypot(s.x_m - pose.x_m, s.y_m - pose.y_m), default=None
        )

    def drop(self, start: Start) -> None:
        """Forget the stretch that begins there: it gave nothing."""
        self._kept = [stretch for stretch in self._kept if start not in stretch.starts()]
