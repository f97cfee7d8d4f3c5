"""What the gyro and a robot at rest tell about heading: noise figures and standstill."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GyroNoise:
    """Error model of the yaw gyro; defaults from the MPU6050 data sheet unless said."""

    sample_rad_s: float = math.radians(0.05)
    """Standard deviation of one sample (total RMS noise, 92 Hz filter)."""
    density_rad_sqrt_s: float = math.radians(0.005)
    """Rate noise spectral density: the angle's random walk per √s."""
    bias_prior_rad_s: float = math.radians(20.0)
    """Zero-rate output at power-up: what is believed before the first rest."""
    bias_walk_rad_s_sqrt_s: float = 2e-5
    """Random walk of the bias per √s: 0.011 °/s after 100 s (our choice, temperature mostly)."""
    scale_rad_sqrt_rad: float = 0.003
    """Scale and alignment error, as a random walk per √rad turned (our choice)."""


class Standstill:
    """Tells rest from motion by the encoders, with a veto by the gyro.

    At rest from the start (a robot boots standing), until the first count. After a motion,
    rest is believed once the counts have not changed for ``settle_s``: gearbox play and the
    last of the run-out are over by then.
    """

    __slots__ = ("_last_count_s", "_last_sample_s", "_settle_s")

    RATE_VETO_RAD_S = 0.05
    """A robot turned by hand has still wheels: no rest above 3 °/s off the bias."""
    STALE_S = 0.2
    """Without encoder samples for this long, nothing is known about rest."""

    def __init__(self, settle_s: float = 0.3) -> None:
        """``settle_s``: see the class."""
        self._settle_s = settle_s
        self._last_count_s = -math.inf
        self._last_sample_s: float | None = None

    def on_encoders(self, t_s: float, *, moved: bool) -> None:
        """Tell an encoder sample and whether a count changed since the one before."""
        self._last_sample_s = t_s
        if moved:
            self._last_count_s = t_s

    def at_rest(self, t_s: float) -> bool:
        """Whether the wheels stand still at ``t_s``."""
        if self._last_sample_s is None:
            return True
        return (
            t_s - self._last_count_s >= self._settle_s and t_s - self._last_sample_s < self.STALE_S
        )
