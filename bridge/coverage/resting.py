"""Standing still between legs, now and then, for the gyro's sake.

A gyro's bias follows the chip's temperature, which rises for minutes after power-up, and what
motion adds to it can only be learnt once the rest is known. Who stands still measures it: a
hundredth of a degree a second, which a minute of lanes makes half a degree, is gone after a
second. How much the bias is doubted, the filter knows; with a chip that keeps it, that is little.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

_UNCERTAIN_RAD_S = math.radians(0.012)
"""A rest is due: the heading would stray by 0.7° in a minute."""
_SURE_RAD_S = math.radians(0.005)
_MAX_S = 2.5
_APART_S = 20.0


class GyroRest:
    """Says when to hold, and for how long."""

    __slots__ = ("_begun_s", "_ended_s")

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._ended_s = -math.inf

    @property
    def held(self) -> bool:
        """Whether a rest is under way."""
        return self._begun_s is not None

    def holds(self, obs: Observation) -> bool:
        """Whether to stand still in this step; asked only where the robot may."""
        if self._begun_s is None:
            due = (
                obs.gyro_bias_sigma_rad_s > _UNCERTAIN_RAD_S
                and obs.time_s > self._ended_s + _APART_S
            )
            self._begun_s = obs.time_s if due else None
        elif obs.gyro_bias_sigma_rad_s < _SURE_RAD_S or obs.time_s > self._begun_s + _MAX_S:
            self._begun_s, self._ended_s = None, obs.time_s
        return self._begun_s is not None
