"""Straight wall segments that the robot has followed. They are places for a heading fix.

The list needs only a few dozen numbers, so it fits into a microcontroller.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

HEADING_RUN_M = 0.48
"""Length of a drive along a wall, m: 40 cm for the measurement, and 8 cm for the approach. It
measures the direction with an error of a third of a degree, with a noisy infrared sensor."""
OFF_M = 0.035
"""Additional gap to the wall compared with a perimeter pass, m. It allows for the position error. A
robot that grazes the wall turns parallel to it and would take this as its own heading."""
_MIN_M = 0.5
"""Minimum length of a stored segment, m."""
_MAX_KEPT = 24
"""Maximum number of stored segments."""
_BENT_RAD = math.radians(10.0)
"""Turn of the heading that ends a segment, rad."""
_TRIES = 2
"""Number of drives in a row without effect after which a segment is removed."""


class Start(NamedTuple):
    """Pose of the axle at the start of a drive along a wall."""

    x_m: float
    y_m: float
    heading_rad: float


class _Segment(NamedTuple):
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    side: int
    """Side of the wall: left (1) or right (-1)."""

    def starts(self) -> tuple[Start, Start]:
        """Return the start poses at both ends of the segment."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = self.x_m + self.side * OFF_M * s, self.y_m - self.side * OFF_M * c
        back = wrap_angle(self.heading_rad + math.pi)
        return (
            Start(x, y, self.heading_rad),
            Start(x + self.length_m * c, y + self.length_m * s, back),
        )


class WallSegments:
    """Stores the longest wall segments."""

    def __init__(self) -> None:
        """Begin without a segment."""
        self._begun: Pose2 | None = None
        self._kept: list[_Segment] = []
        self._fails: dict[_Segment, int] = {}

    def follow(self, pose: Pose2, side: int, *, straight: bool) -> None:
        """Add a step along a wall on the left (1) or right (-1)."""
        begun = self._begun
        if begun is not None and (
            not straight or abs(wrap_angle(pose.theta_rad - begun.theta_rad)) > _BENT_RAD
        ):
            self.end(pose, side)
        if self._begun is None and straight:
            self._begun = pose

    def end(self, pose: Pose2, side: int) -> None:
        """End the segment. Called at the end of the wall, or of its straight part."""
        begun, self._begun = self._begun, None
        if begun is None:
            return
        length = begun.distance_m(pose)
        if length < _MIN_M:
            return
        heading = math.atan2(pose.y_m - begun.y_m, pose.x_m - begun.x_m)
        self._kept.append(_Segment(length, begun.x_m, begun.y_m, heading, side))
        if len(self._kept) > _MAX_KEPT:
            self._kept.remove(min(self._kept))

    def starts(self) -> list[Start]:
        """Return the start poses at both ends of every segment."""
        return [start for segment in self._kept for start in segment.starts()]

    def tried(self, start: Start, *, helped: bool) -> None:
        """Store the result of a drive. Two drives in a row without effect remove the segment."""
        for segment in [segment for segment in self._kept if start in segment.starts()]:
            if helped:
                self._fails.pop(segment, None)
                continue
            self._fails[segment] = self._fails.get(segment, 0) + 1
            if self._fails[segment] >= _TRIES:
                self._kept.remove(segment)
