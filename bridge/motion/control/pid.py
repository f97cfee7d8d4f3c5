"""The paper's PID controller (section 3.3, eq. 1) with a saturated output and anti-windup."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PidGains:
    """Gains in the paper's first form: u = Kp (e + 1/Ti ∫e dt + Td de/dt)."""

    kp: float
    """Proportional gain, in the unit of the output per unit of the error."""
    ti_s: float = math.inf
    """Integral time, s; infinite: no integral part."""
    td_s: float = 0.0
    """Derivative time, s; 0: no derivative part."""

    def __post_init__(self) -> None:
        """Reject invalid gains."""
        if not (math.isfinite(self.kp) and self.ti_s > 0.0 and self.td_s >= 0.0):
            raise ValueError(f"PID gains need finite kp, ti_s > 0, td_s >= 0, not {self}")

    @property
    def ki(self) -> float:
        """Integral gain Ki of the second form, Kp/Ti."""
        return self.kp / self.ti_s

    @property
    def kd(self) -> float:
        """Derivative gain Kd of the second form, Kp·Td."""
        return self.kp * self.td_s


class Pid:
    """Discrete PID controller. The caller computes the error.

    There are three differences from the paper. The output is limited to ±``limit``. The integral
    does not grow in the direction of a saturated output (conditional integration). The derivative
    part is zero on the first sample.
    """

    __slots__ = ("_integral", "_kd", "_ki", "_kp", "_limit", "_previous")

    def __init__(self, gains: PidGains, limit: float = math.inf) -> None:
        """Create a controller. ``limit`` has the unit of the output."""
        if not limit > 0.0:
            raise ValueError(f"PID limit must be positive, not {limit!r}")
        self._kp, self._ki, self._kd = gains.kp, gains.ki, gains.kd
        self._limit = limit
        self._integral = 0.0
        self._previous: float | None = None

    @property
    def integral(self) -> float:
        """Integral part of the output, Ki ∫e dt."""
        return self._integral

    def reset(self) -> None:
        """Reset the integral and the last error."""
        self._integral = 0.0
        self._previous = None

    def update(self, error: float, dt_s: float) -> float:
        """Return the output.

        If ``dt_s`` ≤ 0, the integral is unchanged and the derivative part is 0.
        """
        output = self._kp * error + self._integral
        if dt_s > 0.0:
            if self._previous is not None:
                output += self._kd * (error - self._previous) / dt_s
            if self._ki:
                step = self._ki * error * dt_s
                if abs(output + step) <= self._limit or step * output < 0.0:
                    self._integral += step
                    output += step
        self._previous = error
        return max(min(output, self._limit), -self._limit)
