"""Free distance ahead from ultrasonic ranges, and whether a short range is reliable."""

from __future__ import annotations

import math

_HELD_S = 0.12
"""Age from which an equal reading counts as new, s. The sensor holds a reading for less time."""
_SILENT_S = 0.3
"""Time without an echo after which the path ahead counts as free, s."""
_LEAP_M = 0.1
"""Minimum decrease between two readings that means another object, m. No robot drives this far
between two readings."""


class ConfirmedRange:
    """Free distance for a robot that turns while it drives, so that ranges cannot be extrapolated.

    A short range counts at once if the reading before it was nearly as short. An unexpected short
    range may be the echo of another pulse. It counts when the next reading agrees, or when it
    repeats soon, because a chair leg returns only some of the pulses.
    """

    __slots__ = ("_age_s", "_range_m", "_stop_m", "_strange_s", "is_blocked")

    def __init__(self, stop_m: float) -> None:
        """``stop_m`` is the range at which no free distance is left."""
        self._stop_m = stop_m
        self._range_m: float | None = None
        self._age_s = 0.0
        self._strange_s = math.inf
        self.is_blocked = False
        """True if the last update found less free distance than required, and the reading is
        reliable."""

    def update(self, range_m: float | None, min_m: float, dt_s: float) -> float:
        """Return the free distance from the newest reading, m; infinite without an echo.

        ``min_m`` is the required distance. The first reading counts at once.
        """
        self._age_s += dt_s
        self._strange_s += dt_s
        if range_m is None:
            if self._age_s > _SILENT_S:
                self._range_m = math.inf
            self.is_blocked = False
            return math.inf
        room_m = range_m - self._stop_m
        if range_m != self._range_m or self._age_s > _HELD_S:
            leapt = self._range_m is not None and range_m < self._range_m - _LEAP_M
            near = room_m <= min_m
            self.is_blocked = near and (not leapt or self._strange_s < _SILENT_S)
            if near and leapt:
                self._strange_s = 0.0
            self._range_m, self._age_s = range_m, 0.0
        return room_m
