"""A robot picked up and put down again, as its inertial sensor feels it.

A hand lifts it 10 cm within 0.4 s: upward acceleration for half of that time and as much
downward for the rest, which is 0.1 m / (0.2 s)² = 0.25 g; meanwhile the nose goes up by 8°,
where it stays. Putting it down is the same backwards. Between the two it is held still: where
it is carried to is the plant's affair.
"""

from __future__ import annotations

import math

HEIGHT_M = 0.10
HALF_S = 0.2
TILT_DEG = 8.0
_GRAVITY_M_S2 = 9.80665
PUSH_G = HEIGHT_M / HALF_S**2 / _GRAVITY_M_S2
_WHOLE_MS = 2000.0 * HALF_S


class Lift:
    """When it was picked up or put down, and what that feels like."""

    __slots__ = ("_since_ms", "_up", "active")

    def __init__(self) -> None:
        """On the floor."""
        self._up = False
        self._since_ms = 0
        self.active = False
        """True from picking up until it stands again."""

    def felt(
        self, tick_ms: int, interval_ms: int, *, lifted: bool
    ) -> tuple[float, float, float, float, float, float]:
        """Mean over the interval that ends at ``tick_ms``.

        Returns:
            Acceleration x, y, z beside gravity at rest (g) and rate x, y, z (°/s).

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
        # Nose up is a turn about y (left) that is negative, and tips gravity's reaction ahead.
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
    """Integral over time (ms) of +1 while it speeds up and -1 while it slows down."""
    half_ms = 0.5 * _WHOLE_MS
    ms = min(_WHOLE_MS, max(0.0, ms))
    return ms if ms < half_ms else _WHOLE_MS - ms
