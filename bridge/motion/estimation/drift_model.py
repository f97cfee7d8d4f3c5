"""Noise model of the filter's prediction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.estimation.noise_monitor import NoiseTuning


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Standard deviations of the filter's process noise and of its initial states.

    Gyro values are from the MPU6050 data sheet (PS-MPU-6000A-00, section 6.1) except where noted.
    Wheel values are typical for a calibrated robot of this size.
    """

    gyro_sample_rad_s: float = math.radians(0.05)
    """Noise of one sample at standstill, rad/s (total RMS noise with the 92 Hz filter)."""
    gyro_walk_rad_sqrt_s: float = math.radians(0.005)
    """Angle random walk, rad/√s, from the noise density of 0.005 °/s/√Hz."""
    gyro_shaken_rad_sqrt_s: float = math.radians(0.0035)
    """Additional angle random walk at nominal vibration, rad/√s (our choice)."""
    bias_prior_rad_s: float = math.radians(20.0)
    """Bias at power-up before the first standstill, rad/s."""
    bias_walk_rad_s_sqrt_s: float = 1e-5
    """Random walk of the bias, rad/s/√s (our choice): 0.006 °/s in 100 s."""
    bias_slope_rad_s_c: float = math.radians(0.01)
    """Slope of the bias with the chip's temperature, rad/s per °C, after compensation (our choice).
    The data sheet's ±20 °/s over -40..85 °C would be 0.16 °/s per °C if the bias were linear."""
    motion_bias_rad_s: float = math.radians(0.0095)
    """Shift of the bias by vibration, rad/s (our choice). A standstill cannot measure it."""
    motion_bias_walk_rad_s_sqrt_s: float = 2e-6
    """Random walk of this shift, rad/s/√s."""
    gyro_scale: float = 0.0006
    """Relative scale error after calibration. The data sheet's limit of ±3 % is for an
    uncalibrated gyro."""
    turn_walk_rad_sqrt_rad: float = 0.0005
    """Turn noise in addition to the scale error, rad/√rad. Causes are alignment and sampling."""
    wheel_scale: float = 0.0026
    """Relative error of the path per count that is equal for both wheels (tyres, mean slip). It is
    valid at the nominal slip of ``along_m_sqrt_m`` and grows with slip."""
    along_m_sqrt_m: float = 0.0012
    """Position noise along the path, m/√m (slip and quantisation). Used until slip is measured."""
    across_m_sqrt_m: float = 0.00036
    """Position noise across the path, m/√m. It is proportional to the noise along the path."""
    wheel_turn_rad_sqrt_rad: float = 0.03
    """Heading noise if only the wheels measure the heading, rad/√rad (wheel base, scrub)."""


class NoiseScale:
    """Factor between this robot's noise and the model. It is estimated from innovations.

    It multiplies a variance and is at least 1. Each normalised squared innovation changes it a
    little (covariance matching). If the model is right, the mean of these innovations is 1.
    """

    __slots__ = ("_tuning", "value")

    def __init__(self, tuning: NoiseTuning) -> None:
        """Begin at 1."""
        self._tuning = tuning
        self.value = 1.0

    def learn(self, innovation: float) -> None:
        """Use a normalised squared innovation."""
        tuning = self._tuning
        step = tuning.scale_rate * min(innovation - 1.0, tuning.scale_cap)
        self.value = min(max(self.value * math.exp(step), 1.0), tuning.max_scale)
