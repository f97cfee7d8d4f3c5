"""Standstills between legs in which the gyro bias is measured.

The bias follows the temperature of the gyro chip, which rises for minutes after power-up. A
standstill of one second measures the bias. This removes an error of 0.01 °/s, which would turn the
heading by 0.6° per minute. A standstill is due when the filter's standard deviation of the bias is
too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.observation import Observation


@dataclass(frozen=True, slots=True)
class GyroStandstillOptions:
    """Limits of the standstills. Chosen for a heading error below 1° per minute."""

    uncertain_rad_s: float = math.radians(0.012)
    """Bias standard deviation from which a standstill is due, rad/s: 0.7° of heading per minute."""
    sure_rad_s: float = math.radians(0.005)
    """Bias standard deviation at which a standstill ends, rad/s."""
    max_s: float = 2.5
    """Maximum duration of a standstill, s."""
    apart_s: float = 20.0
    """Minimum time between two standstills, s."""


class GyroStandstill:
    """Decides when the robot stands still to measure the bias, and for how long."""

    __slots__ = ("_begun_s", "_ended_s", "_options")

    def __init__(self, options: GyroStandstillOptions | None = None) -> None:
        """Begin without a standstill."""
        self._options = options or GyroStandstillOptions()
        self._begun_s: float | None = None
        self._ended_s = -math.inf

    @property
    def held(self) -> bool:
        """True during a standstill."""
        return self._begun_s is not None

    def holds(self, obs: Observation) -> bool:
        """Return True if the robot must stand still in this control step.

        Call it only between legs.
        """
        options = self._options
        if self._begun_s is None:
            due = (
                obs.gyro_bias_sigma_rad_s > options.uncertain_rad_s
                and obs.time_s > self._ended_s + options.apart_s
            )
            self._begun_s = obs.time_s if due else None
        elif (
            obs.gyro_bias_sigma_rad_s < options.sure_rad_s
            or obs.time_s > self._begun_s + options.max_s
        ):
            self._begun_s, self._ended_s = None, obs.time_s
        return self._begun_s is not None
