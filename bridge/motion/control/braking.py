"""Braking distances that respect the acceleration limit.

A robot that is commanded to stop continues for a latency τ (link, control period, motor) and then
brakes with a constant deceleration a. It needs d = v·τ + v²/2a. Solved for v, this gives the
fastest speed from which it stops within d.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Braking:
    """Limits with which a motion stops; in m, or in rad for a turn.

    Raises:
        ValueError: the deceleration is not positive, or another value is negative.

    """

    decel: float
    """Deceleration, m/s² (rad/s²)."""
    latency_s: float = 0.0
    creep: float = 0.0
    """Lowest approach speed, m/s (rad/s). At a lower speed the wheels stick."""

    def __post_init__(self) -> None:
        """Reject meaningless figures."""
        if not (self.decel > 0.0 and self.latency_s >= 0.0 and self.creep >= 0.0):
            raise ValueError(f"braking needs decel > 0, latency_s >= 0, creep >= 0, not {self}")

    def distance(self, speed: float) -> float:
        """Return the distance from now to rest: |v|·τ + v²/2a; ``speed`` may have either sign."""
        return abs(speed) * self.latency_s + speed * speed / (2.0 * self.decel)

    def speed(self, distance: float) -> float:
        """Return the highest speed that stops within ``distance``, but at least the creep speed.

        From d = v·τ + v²/2a: v = sqrt((aτ)² + 2ad) - aτ.
        """
        push = self.decel * self.latency_s
        fastest = math.sqrt(push * push + 2.0 * self.decel * max(distance, 0.0)) - push
        return max(fastest, self.creep)

    def run_out(self, speed: float) -> float:
        """Return the distance driven after a stop command at a creeping speed: |v|·τ/2.

        At such a speed the lag of the velocity control dominates, not the deceleration limit.
        """
        return 0.5 * self.latency_s * abs(speed)
