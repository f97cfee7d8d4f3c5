"""Wheel angles and speeds from the device's wrapping counts."""

from __future__ import annotations

import math

_COUNT_WRAP = 1 << 16
_US_WRAP = 1 << 32
_GAP_S = 10.0
"""At full speed half the counter's range passes in 14 s: beyond this the count is unknown."""


class WheelAngles:
    """One robot's two wheels; remembers the last message."""

    def __init__(self, rad_per_count: float) -> None:
        self._rad_per_count = rad_per_count
        self._counts: tuple[int, int] | None = None
        self._t_us = 0
        self._angles = (0.0, 0.0)

    def advance(self, counts: tuple[int, int], t_us: int) -> tuple[float, float, float, float]:
        """Angles (rad) since the first message and speeds (rad/s; NaN where unknown)."""
        speeds = (math.nan, math.nan)
        if self._counts is not None:
            dt_s = (t_us - self._t_us) % _US_WRAP * 1e-6
            if 0.0 < dt_s <= _GAP_S:
                half = _COUNT_WRAP // 2
                steps = [
                    ((now - then + half) % _COUNT_WRAP - half) * self._rad_per_count
                    for now, then in zip(counts, self._counts, strict=True)
                ]
                self._angles = (self._angles[0] + steps[0], self._angles[1] + steps[1])
                speeds = (steps[0] / dt_s, steps[1] / dt_s)
        self._counts, self._t_us = counts, t_us
        return (*self._angles, *speeds)
