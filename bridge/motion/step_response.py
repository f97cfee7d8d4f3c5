"""A step response and its characteristic values."""

from __future__ import annotations

import math
from typing import NamedTuple

STEP_S = 0.02
"""Time between two samples, s."""


class StepResponse(NamedTuple):
    """One closed-loop step response, with a sample every 20 ms."""

    time_s: list[float]
    value: list[float]
    """Controlled quantity: yaw (rad) or distance (m)."""
    command: list[float]
    """Velocity command: rad/s or m/s."""
    target: float

    @property
    def overshoot(self) -> float:
        """Maximum overshoot, relative to the target."""
        return max(max(v / self.target for v in self.value) - 1.0, 0.0)

    @property
    def rise_s(self) -> float:
        """Rise time from 10 to 90 % of the target, s; infinite if 90 % is never reached."""
        late = self._first_s(0.9)
        return late - self._first_s(0.1) if math.isfinite(late) else math.inf

    def settled_s(self, band: float) -> float:
        """Return the time after which the value stays within ``band``, s; infinite: never."""
        outside = [
            t for t, v in zip(self.time_s, self.value, strict=True) if abs(v - self.target) > band
        ]
        if not outside:
            return 0.0
        return math.inf if outside[-1] == self.time_s[-1] else outside[-1] + STEP_S

    def _first_s(self, share: float) -> float:
        pairs = zip(self.time_s, self.value, strict=True)
        return next((t for t, v in pairs if v / self.target >= share), math.inf)
