"""Straight stretches of walls that were followed: where the heading can be taken again.

A few dozen numbers, as a microcontroller would keep them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

HEADING_RUN_M = 0.48
"""One sight of 40 cm, which tells the direction to a third of a degree by a noisy infrared, and
what it takes to come onto the line."""
OFF_M = 0.035
"""Farther off the wall than its outline: the place may be as wrong, and who rubs against a wall
takes it for his heading."""
_MIN_M = 0.5
_MOST = 24
_BENT_RAD = math.radians(10.0)
_TRIES = 2


class Start(NamedTuple):
    """Where the axle begins along a wall, a little off it."""

    x_m: float
    y_m: float
    heading_rad: float


class _Segment(NamedTuple):
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    side: int
    """The wall is on the left (1) or right (-1)."""

    def starts(self) -> tuple[Start, Start]:
        """From either end."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = self.x_m + self.side * OFF_M * s, self.y_m - self.side * OFF_M * c
        back = wrap_angle(self.heading_rad + math.pi)
        return (
            Start(x, y, self.heading_rad),
            Start(x + self.length_m * c, y + self.length_m * s, back),
        )


class WallSegments:
    """Keeps the longest ones."""

    def __init__(self) -> None:
        """None yet."""
        self._begun: Pose2 | None = None
        self._kept: list[_Segment] = []
        self._fails: dict[_Segment, int] = {}

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
        if length < _MIN_M:
            return
        heading = math.atan2(pose.y_m - begun.y_m, pose.x_m - begun.x_m)
        self._kept.append(_Segment(length, begun.x_m, begun.y_m, heading, side))
        if len(self._kept) > _MOST:
            self._kept.remove(min(self._kept))

    def starts(self) -> list[Start]:
        """Where one could begin: of every stretch both ends."""
        return [start for segment in self._kept for start in segment.starts()]

    def tried(self, start: Start, *, helped: bool) -> None:
        """Take what going along a stretch gave: nothing twice in a row, and it is forgotten."""
        for segment in [segment for segment in self._kept if start in segment.starts()]:
            if helped:
                self._fails.pop(segment, None)
                continue
            self._fails[segment] = self._fails.get(segment, 0) + 1
            if self._fails[segment] >= _TRIES:
                self._kept.remove(segment)
