"""Braking distances that respect the acceleration limit.

After a stop command, the robot continues at its speed for a latency τ (link, control period,
motor). It then brakes with a constant deceleration a. It needs the distance d = v·τ + v²/2a. Solved
for v, this equation gives the maximum speed from which the robot stops within d.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Braking:
    """Limits with which a motion stops; units are in m, or in rad for a turn.

    Raises:
        ValueError: the deceleration is not positive, or another value is negative.

    """

    decel: float
    """Deceleration, m/s² (rad/s²)."""
    latency_s: float = 0.0
    """Time from a stop command to the deceleration, s: τ."""
    creep: float = 0.0
    """Minimum approach speed, m/s (rad/s). At a lower speed, static friction stops the wheels."""

    def __post_init__(self) -> None:
        """Reject invalid values."""
        if not (self.decel > 0.0 and self.latency_s >= 0.0 and self.creep >= 0.0):
            raise ValueError(f"braking needs decel > 0, latency_s >= 0, creep >= 0, not {self}")

    def distance(self, speed: float) -> float:
        """Return the path from now to standstill: |v|·τ + v²/2a. ``speed`` may be negative."""
        return abs(speed) * self.latency_s + speed * speed / (2.0 * self.decel)

    def speed(self, distance: float) -> float:
        """Return the maximum speed that stops within ``distance``, but at least the creep speed.

        The equation d = v·τ + v²/2a gives v = sqrt((aτ)² + 2ad) - aτ.
        """
        lag_speed = self.decel * self.latency_s
        fastest = (
            math.sqrt(lag_speed * lag_speed + 2.0 * self.decel * max(distance, 0.0)) - lag_speed
        )
        return max(fastest, self.creep)

    def run_out(self, speed: float) -> float:
        """Return the path after a stop command at creep speed: |v|·τ/2.

        At creep speed the lag of the velocity control determines the path, not the deceleration
        limit.
        """
        return 0.5 * self.latency_s * abs(speed)


@dataclass(frozen=True, slots=True)
class BrakingTuning:
    """How a robot brakes ahead of an obstacle or the end of a leg."""

    share: float = 0.75
    """Share of the acceleration limit in braking distances. The rest is a reserve for control."""
    lag_s: float = 0.10
    """Time from a command to the wheels' response, s: link, smoothing, motor."""
    creep_m_s: float = 0.025
    """Minimum approach speed, m/s. A contact at this speed is no collision (< 0.03 m/s)."""

    def of(self, max_accel_m_s2: float) -> Braking:
        """Return the limits of a robot with this acceleration limit."""
        return Braking(self.share * max_accel_m_s2, self.lag_s, self.creep_m_s)
