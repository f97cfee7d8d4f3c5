"""How the estimate of pose goes wrong between corrections: the noise figures of the filter."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Standard deviations; what is constant is a state of the filter, the rest is noise.

    Figures of the gyro are from the MPU6050 data sheet (PS-MPU-6000A-00, section 6.1) unless
    said; those of the wheels are what a robot of this size shows after calibration.
    """

    gyro_sample_rad_s: float = math.radians(0.05)
    """Of one sample at rest (total RMS noise, 92 Hz filter)."""
    gyro_walk_rad_sqrt_s: float = math.radians(0.005)
    """Walk of the angle: the density of 0.005 °/s/√Hz."""
    gyro_shaken_rad_sqrt_s: float = math.radians(0.0035)
    """What motion adds to it where vibration is nominal (our choice)."""
    bias_prior_rad_s: float = math.radians(20.0)
    """Zero-rate output at power-up: what is believed before the first rest."""
    bias_walk_rad_s_sqrt_s: float = 1e-5
    """Walk of the bias: 0.006 °/s in 100 s (our choice)."""
    bias_slope_rad_s_c: float = math.radians(0.01)
    """Of the bias with the chip's temperature, what a compensation leaves (our choice): ±20 °/s
    over -40..85 °C would be 0.16 °/s per °C if it were straight."""
    motion_bias_rad_s: float = math.radians(0.0095)
    """Shift of the bias by the vibration of motion, which no rest can show (our choice)."""
    motion_bias_walk_rad_s_sqrt_s: float = 2e-6
    gyro_scale: float = 0.0006
    """Scale error once calibrated: the data sheet's ±3 % are before that."""
    turn_walk_rad_sqrt_rad: float = 0.0005
    """What scale does not tell of a turn: alignment, sampling."""
    wheel_scale: float = 0.0026
    """Tyres and mean slip: relative error of the way that a count stands for, common to both
    wheels, of a robot that slips as little as the next figure says; more with more."""
    along_m_sqrt_m: float = 0.0012
    """Position noise along the way: slip and quantisation; until it has been measured."""
    across_m_sqrt_m: float = 0.00036
    """Across it, in proportion."""
    wheel_turn_rad_sqrt_rad: float = 0.03
    """Heading noise when the wheels alone must tell it (wheel base, scrub)."""


class NoiseScale:
    """How much worse this robot is than the model, learnt from surprises.

    A factor on a variance, at least 1. Each normalised squared surprise, whose mean is 1 where
    the model is right, moves it up or down a little (covariance matching).
    """

    __slots__ = ("_most", "value")

    _RATE = 0.15
    _CAP = 4.0
    """One surprise counts at most as much: it may be of another wall."""

    def __init__(self, most: float) -> None:
        """Begin at 1, and never above ``most``."""
        self._most = most
        self.value = 1.0

    def learn(self, innovation: float) -> None:
        """Take one normalised squared surprise."""
        step = self._RATE * min(innovation - 1.0, self._CAP)
        self.value = min(max(self.value * math.exp(step), 1.0), self._most)
