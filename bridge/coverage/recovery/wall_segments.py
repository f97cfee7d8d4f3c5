"""Straight wall segments that the robot has followed. They are places for a heading fix.

The list needs only a few dozen numbers, so it fits into a microcontroller.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.geometry import Pose2

_MAX_KEPT = 24
"""Maximum number of stored segments."""


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

    def starts(self, off_m: float) -> tuple[Start, Start]:
        """Return the start poses at both ends of the segment, ``off_m`` farther from the wall."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        x, y = self.x_m + self.side * off_m * s, self.y_m - self.side * off_m * c
        back = wrap_angle(self.heading_rad + math.pi)
        return (
            Start(x, y, self.heading_rad),
            Start(x + self.length_m * c, y + self.length_m * s, back),
        )


class WallSegments:
    """Stores the longest wall segments."""

    def __init__(self, options: RecoveryOptions) -> None:
        """Begin without a segment."""
        self._options = options
        self._begun: Pose2 | None = None
        self._kept: list[_Segment] = []
        self._fails: dict[_Segment, int] = {}

    def follow(self, pose: Pose2, side: int, *, straight: bool) -> None:
        """Add a step along a wall on the left (1) or right (-1)."""
        begun = self._begun
        if begun is not None and (
            not straight
            or abs(wrap_angle(pose.theta_rad - begun.theta_rad)) > self._options.fix_bent_rad
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
        if length < self._options.fix_wall_m:
            return
        heading = math.atan2(pose.y_m - begun.y_m, pose.x_m - begun.x_m)
        self._kept.append(_Segment(length, begun.x_m, begun.y_m, heading, side))
        if len(self._kept) > _MAX_KEPT:
            self._kept.remove(min(self._kept))

    def starts(self) -> list[Start]:
        """Return the start poses at both ends of every segment."""
        off_m = self._options.fix_off_m
        return [start for segment in self._kept for start in segment.starts(off_m)]

    def tried(self, start: Start, *, helped: bool) -> None:
        """Store the result of a drive. Some drives in a row without effect remove the segment."""
        off_m = self._options.fix_off_m
        for segment in [segment for segment in self._kept if start in segment.starts(off_m)]:
            if helped:
                self._fails.pop(segment, None)
                continue
            self._fails[segment] = self._fails.get(segment, 0) + 1
            if self._fails[segment] >= self._options.fix_tries:
                self._kept.remove(segment)
