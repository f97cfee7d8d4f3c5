"""Lifting and setting down of the robot, as the inertial sensor measures them.

A person lifts the robot 10 cm within 0.4 s. The robot accelerates upwards for 0.2 s, then downwards
for 0.2 s, each time with 0.1 m / (0.2 s)² = 0.25 g. In the same time the nose rises by 8° and stays
at this angle. Setting down is the reverse motion. The robot does not move between lifting and
setting down. The plant defines the place where the robot is set down.
"""

from __future__ import annotations

import math

from protocol.imu import GRAVITY_M_S2

HEIGHT_M = 0.10
HALF_S = 0.2
TILT_DEG = 8.0
PUSH_G = HEIGHT_M / HALF_S**2 / GRAVITY_M_S2
_WHOLE_MS = 2000.0 * HALF_S


class Lift:
    """Times of lifting and setting down, and the resulting accelerations and rates."""

    __slots__ = ("_since_ms", "_up", "active")

    def __init__(self) -> None:
        """Start on the floor."""
        self._up = False
        self._since_ms = 0
        self.active = False
        """True from lifting until the robot stands on the floor again."""

    def felt(
        self, tick_ms: int, interval_ms: int, *, lifted: bool
    ) -> tuple[float, float, float, float, float, float]:
        """Return the mean acceleration and rate over the interval that ends at ``tick_ms``.

        Returns:
            Acceleration x, y, z in addition to gravity at rest (g), and rate x, y, z (°/s).

        """
        if lifted != self._up:
            self._up, self._since_ms, self.active = lifted, tick_ms - interval_ms, True
        end_ms = float(tick_ms - self._since_ms)
        begin_ms = end_ms - interval_ms
        if not lifted and begin_ms >= _WHOLE_MS:
            self.active = False
        turned = _progress(end_ms) - _progress(begin_ms)
        tilt = 0.5 * (_progress(end_ms) + _progress(begin_ms))
        sign = 1.0 if lifted else -1.0
        tilt_rad = math.radians(TILT_DEG * (tilt if lifted else 1.0 - tilt))
        up_g = sign * PUSH_G * (_ramp(end_ms) - _ramp(begin_ms)) / interval_ms
        # A rising nose is a negative rotation about y (left). Gravity then gives a positive reading
        # along x.
        return (
            (1.0 + up_g) * math.sin(tilt_rad),
            0.0,
            (1.0 + up_g) * math.cos(tilt_rad) - 1.0,
            0.0,
            -sign * TILT_DEG * turned / (0.001 * interval_ms),
            0.0,
        )


def _progress(ms: float) -> float:
    return min(1.0, max(0.0, ms / _WHOLE_MS))


def _ramp(ms: float) -> float:
    """Return the time integral (ms) of +1 in the acceleration, and -1 in the deceleration."""
    half_ms = 0.5 * _WHOLE_MS
    ms = min(_WHOLE_MS, max(0.0, ms))
    return ms if ms < half_ms else _WHOLE_MS - ms
