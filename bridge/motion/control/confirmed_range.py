"""Free distance ahead from ultrasonic ranges, and whether a short range is reliable."""

from __future__ import annotations

import math


class ConfirmedRange:
    """Free distance ahead of a robot that turns while it drives, so ranges cannot be extrapolated.

    A short range counts immediately if the reading before it was nearly as short. An unexpected
    short range may be an echo of another pulse. It counts if the next reading confirms it. It also
    counts if it occurs again soon, because a chair leg returns only some of the pulses.
    """

    __slots__ = (
        "_age_s",
        "_held_s",
        "_leap_m",
        "_range_m",
        "_silent_s",
        "_stop_m",
        "_strange_s",
        "is_blocked",
    )

    def __init__(self, stop_m: float, *, held_s: float, silent_s: float, leap_m: float) -> None:
        """Create the filter.

        ``stop_m`` is the range at which there is no free distance. ``FollowTuning`` explains the
        other values.
        """
        self._stop_m = stop_m
        self._held_s, self._silent_s, self._leap_m = held_s, silent_s, leap_m
        self._range_m: float | None = None
        self._age_s = 0.0
        self._strange_s = math.inf
        self.is_blocked = False
        """True if the free distance was smaller than required in the last update, and the reading
        is reliable."""

    def update(self, range_m: float | None, min_m: float, dt_s: float) -> float:
        """Return the free distance from the newest reading, m; infinite without an echo.

        ``min_m`` is the required distance. The first reading counts immediately.
        """
        self._age_s += dt_s
        self._strange_s += dt_s
        if range_m is None:
            if self._age_s > self._silent_s:
                self._range_m = math.inf
            self.is_blocked = False
            return math.inf
        room_m = range_m - self._stop_m
        if range_m != self._range_m or self._age_s > self._held_s:
            leapt = self._range_m is not None and range_m < self._range_m - self._leap_m
            near = room_m <= min_m
            self.is_blocked = near and (not leapt or self._strange_s < self._silent_s)
            if near and leapt:
                self._strange_s = 0.0
            self._range_m, self._age_s = range_m, 0.0
        return room_m
