"""Noise of this robot, measured during the drive. The filter scales its noise with it.

- Vibration shifts the bias of a MEMS gyro and adds noise (vibration rectification). The effect
  grows with the square of the vibration, which the accelerometer measures.
- Slip of one wheel causes a difference between wheels and gyro. Slip that is equal for both wheels
  causes no difference. The model assumes that this common slip equals the visible slip if slip is
  low, and that the total is up to 2.2 times the visible slip if slip is high. With more slip, the
  lateral slip and the uncertainty of the wheel scale grow too.
- A noisy infrared sensor makes the robot press against the followed wall and slip. The innovations
  of the wall's filter measure this noise. It determines the gap to the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NoiseTuning:
    """How the filter scales its noise with this robot's vibration, slip and innovations."""

    nominal_m_s2: float = 0.15
    """Vibration per axis at which the gyro values of the drift model are valid, m/s²: 15 mg."""
    min_gyro_share: float = 0.25
    """Minimum factor on the gyro's noise."""
    max_gyro_share: float = 10.0
    """Maximum factor on the gyro's noise."""
    bias_power: float = 0.6
    """Exponent of the vibration share (:func:`gyro_share`) in the growth of the bias in motion and
    of the scale error. From ``typical`` to ``harsh`` noise (2.7 times the vibration) they grow
    threefold."""
    walk_power: float = 1.5
    """Exponent of the vibration share in the growth of the angle random walk by vibration. From
    ``typical`` to ``harsh`` noise this part grows by a factor of 19."""
    window_m: float = 0.10
    """Path of one slip measurement, m. It is longer than the correlation of slip (a third of a
    second)."""
    common_m_sqrt_m: float = 0.0017
    """Visible slip from which the common slip grows faster, m/√m. Measured: 0.0013 at ``typical``
    and 0.0038 at ``harsh`` noise."""
    max_common: float = 2.2
    """Maximum ratio of total to visible slip."""
    min_slippery: float = 0.5
    """Minimum factor on the wheels' noise. Every floor has some slip."""
    max_slippery: float = 3.0
    """Maximum factor on the uncertainty of the wheel scale. Above it, other measurements show the
    error."""
    straight_share: float = 0.2
    """Maximum share of turning in a measurement, at the rim. A measurement with more turning is
    ignored."""
    slip_share: float = 0.05
    """Weight of the newest measurement in the variance of slip."""
    mean_share: float = 0.02
    """Weight of the newest measurement in the mean difference of the wheels."""
    scale_rate: float = 0.15
    """Change of the logarithm of a noise scale per excess of an innovation over 1."""
    scale_cap: float = 4.0
    """Maximum excess of an innovation over 1 that counts. The innovation may be of another wall."""
    max_scale: float = 25.0
    """Maximum factor on the variances of gyro and wheels, estimated from innovations."""


@dataclass(frozen=True, slots=True)
class RangingTuning:
    """How the noise of the infrared readings determines the gap to a followed wall."""

    quiet_m: float = 0.0015
    """Standard deviation of the infrared innovations up to which no gap to the wall is needed, m.
    It is 1.0 mm at ``typical`` and 2.2 mm at ``harsh`` noise."""
    learn_share: float = 0.01
    """Weight of the newest innovation in the variance of the infrared."""
    stand_off: float = 2.0
    """Gap per standard deviation above ``quiet_m`` (m/m): 1.4 mm at ``harsh`` noise. A smaller gap
    causes slip, and a larger gap leaves floor unswept."""


def gyro_share(vibration_m_s2: float, tuning: NoiseTuning) -> float:
    """Return the factor on the gyro's standard deviations for a vibration, m/s²."""
    square = (vibration_m_s2 / tuning.nominal_m_s2) ** 2
    return min(max(square, tuning.min_gyro_share), tuning.max_gyro_share)


class SlipMonitor:
    """Measures the position noise along the path from wheels and gyro."""

    __slots__ = (
        "_excess_m",
        "_mean",
        "_nominal_m",
        "_path_m",
        "_tuning",
        "_turn_m",
        "_windows",
        "variance_per_m",
    )

    def __init__(self, along_m_sqrt_m: float, tuning: NoiseTuning | None = None) -> None:
        """Begin with a standard deviation, m/√m. It has the weight of about 2 m of path."""
        self._tuning = tuning or NoiseTuning()
        self._path_m = self._excess_m = self._turn_m = 0.0
        self._mean = 0.0
        self._windows = 0
        self._nominal_m = along_m_sqrt_m
        self.variance_per_m = along_m_sqrt_m**2

    @property
    def along_m_sqrt_m(self) -> float:
        """Standard deviation of the visible slip along the path, m/√m."""
        return math.sqrt(self.variance_per_m)

    @property
    def slippery(self) -> float:
        """Ratio of total slip to nominal slip."""
        tuning, shown_m = self._tuning, self.along_m_sqrt_m
        common = min(max(shown_m / tuning.common_m_sqrt_m, 1.0), tuning.max_common)
        return max(common * shown_m / self._nominal_m, tuning.min_slippery)

    @property
    def mean_slippery(self) -> float:
        """Slip ratio for the wheel scale. It is averaged over a longer path."""
        return min(self.along_m_sqrt_m / self._nominal_m, self._tuning.max_slippery)

    def update(self, left_m: float, right_m: float, turn_m: float) -> None:
        """Use the wheels' paths, and the gyro's turn times the wheel base; all in m."""
        tuning = self._tuning
        self._path_m += 0.5 * abs(left_m + right_m)
        self._excess_m += right_m - left_m - turn_m
        self._turn_m += abs(turn_m)
        if self._path_m < tuning.window_m:
            if self._turn_m > tuning.window_m:
                self._path_m = self._excess_m = self._turn_m = 0.0
            return
        if self._turn_m < tuning.straight_share * self._path_m:
            rate = self._excess_m / self._path_m  # constant if the wheels differ in size
            self._windows += 1
            self._mean += max(1.0 / self._windows, tuning.mean_share) * (rate - self._mean)
            if self._windows > 1:
                # The mean of both wheels has half the standard deviation of their difference.
                off = 0.5 * (rate - self._mean) * self._path_m
                excess = off * off / self._path_m - self.variance_per_m
                self.variance_per_m += tuning.slip_share * excess
        self._path_m = self._excess_m = self._turn_m = 0.0


class RangingNoise:
    """Measures the noise of the infrared readings of a followed wall."""

    __slots__ = ("_tuning", "sigma_m")

    def __init__(self, tuning: RangingTuning | None = None) -> None:
        """Begin as with a sensor that is not noisy."""
        self._tuning = tuning or RangingTuning()
        self.sigma_m = self._tuning.quiet_m

    def learn(self, innovation_m: float) -> None:
        """Use an innovation, m. Its weight is small, because it may be of another surface."""
        variance = self.sigma_m * self.sigma_m
        square = min(innovation_m * innovation_m, 16.0 * variance)
        self.sigma_m = math.sqrt(variance + self._tuning.learn_share * (square - variance))

    @property
    def stand_off_m(self) -> float:
        """Additional gap to a followed wall, m."""
        return self._tuning.stand_off * max(self.sigma_m - self._tuning.quiet_m, 0.0)
