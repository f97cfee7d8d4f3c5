"""Noise model of the filter between updates."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Standard deviations of the filter's noise and of its initial states.

    Gyro values are from the MPU6050 data sheet (PS-MPU-6000A-00, section 6.1) unless noted. Wheel
    values are typical of a calibrated robot of this size.
    """

    gyro_sample_rad_s: float = math.radians(0.05)
    """Noise of one sample at rest (total RMS noise, 92 Hz filter)."""
    gyro_walk_rad_sqrt_s: float = math.radians(0.005)
    """Angle random walk, from the density of 0.005 °/s/√Hz."""
    gyro_shaken_rad_sqrt_s: float = math.radians(0.0035)
    """Angle random walk that nominal vibration adds (our choice)."""
    bias_prior_rad_s: float = math.radians(20.0)
    """Zero-rate output at power-up, before the first rest."""
    bias_walk_rad_s_sqrt_s: float = 1e-5
    """Random walk of the bias: 0.006 °/s in 100 s (our choice)."""
    bias_slope_rad_s_c: float = math.radians(0.01)
    """Slope of the bias with the chip's temperature that remains after compensation (our choice).
    The data sheet's ±20 °/s over -40..85 °C would be 0.16 °/s per °C if it were linear."""
    motion_bias_rad_s: float = math.radians(0.0095)
    """Shift of the bias by vibration (our choice). A standstill cannot measure it."""
    motion_bias_walk_rad_s_sqrt_s: float = 2e-6
    gyro_scale: float = 0.0006
    """Scale error after calibration. The data sheet's ±3 % apply before it."""
    turn_walk_rad_sqrt_rad: float = 0.0005
    """Turn noise in addition to the scale error: alignment, sampling."""
    wheel_scale: float = 0.0026
    """Relative error of the path per count, equal for both wheels (tyres, mean slip). It holds at
    the nominal slip of ``along_m_sqrt_m`` and grows with slip."""
    along_m_sqrt_m: float = 0.0012
    """Position noise along the path until slip is measured: slip and quantisation."""
    across_m_sqrt_m: float = 0.00036
    """Position noise across the path; it scales with the noise along the path."""
    wheel_turn_rad_sqrt_rad: float = 0.03
    """Heading noise if only the wheels measure it (wheel base, scrub)."""


class NoiseScale:
    """Factor by which this robot's noise exceeds the model, learned from innovations.

    It multiplies a variance and is at least 1. Each normalised squared innovation changes it a
    little (covariance matching). Their mean is 1 if the model is right.
    """

    __slots__ = ("_most", "value")

    _RATE = 0.15
    _CAP = 4.0
    """Maximum effect of one innovation, because it may be of another wall."""

    def __init__(self, most: float) -> None:
        """Begin at 1, with an upper limit."""
        self._most = most
        self.value = 1.0

    def learn(self, innovation: float) -> None:
        """Take a normalised squared innovation."""
        step = self._RATE * min(innovation - 1.0, self._CAP)
        self.value = min(max(self.value * math.exp(step), 1.0), self._most)
