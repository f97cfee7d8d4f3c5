"""Rests between legs that measure the gyro bias.

The bias follows the chip's temperature, which rises for minutes after power-up. A standstill of one
second measures the bias. It removes an error of 0.01 °/s, which would turn the heading by 0.6° per
minute. The standard deviation of the bias in the filter decides when a rest is due.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

_UNCERTAIN_RAD_S = math.radians(0.012)
"""Bias standard deviation from which a rest is due, rad/s: 0.7° of heading per minute."""
_SURE_RAD_S = math.radians(0.005)
"""Bias standard deviation at which a rest ends, rad/s."""
_MAX_S = 2.5
"""Maximum duration of a rest, s."""
_APART_S = 20.0
"""Minimum time between two rests, s."""


class GyroRest:
    """Decides when to rest, and for how long."""

    __slots__ = ("_begun_s", "_ended_s")

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._ended_s = -math.inf

    @property
    def held(self) -> bool:
        """True during a rest."""
        return self._begun_s is not None

    def holds(self, obs: Observation) -> bool:
        """Return True if the robot must stand still in this step; called only between legs."""
        if self._begun_s is None:
            due = (
                obs.gyro_bias_sigma_rad_s > _UNCERTAIN_RAD_S
                and obs.time_s > self._ended_s + _APART_S
            )
            self._begun_s = obs.time_s if due else None
        elif obs.gyro_bias_sigma_rad_s < _SURE_RAD_S or obs.time_s > self._begun_s + _MAX_S:
            self._begun_s, self._ended_s = None, obs.time_s
        return self._begun_s is not None
