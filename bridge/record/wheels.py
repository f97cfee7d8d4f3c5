"""Wheel angles and speeds from the device's encoder counts, which wrap around."""

from __future__ import annotations

import math

from bridge.motion.estimation.odometry import encoder_delta
from protocol.clock import DeviceUs, extend_us

_GAP_S = 10.0
"""Maximum time between two messages, s. At full speed, half the count range passes in 14 s. After a
longer gap the count is ambiguous."""


class WheelAngles:
    """Angles of one robot's two wheels."""

    def __init__(self, rad_per_count: float) -> None:
        self._rad_per_count = rad_per_count
        self._counts: tuple[int, int] | None = None
        self._t_us = DeviceUs(0)
        self._angles = (0.0, 0.0)

    def advance(self, counts: tuple[int, int], t_us: int) -> tuple[float, float, float, float]:
        """Return angles (rad) since the first message and speeds (rad/s; NaN if unknown)."""
        left_speed = right_speed = math.nan
        if self._counts is not None:
            dt_s = (extend_us(self._t_us, t_us) - self._t_us) * 1e-6
            if 0.0 < dt_s <= _GAP_S:
                then_left, then_right = self._counts
                left = encoder_delta(then_left, counts[0]) * self._rad_per_count
                right = encoder_delta(then_right, counts[1]) * self._rad_per_count
                self._angles = (self._angles[0] + left, self._angles[1] + right)
                left_speed, right_speed = left / dt_s, right / dt_s
        self._counts, self._t_us = counts, DeviceUs(t_us)
        return (*self._angles, left_speed, right_speed)
