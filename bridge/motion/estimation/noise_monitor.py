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

NOMINAL_M_S2 = 0.15
"""Vibration per axis at which the gyro values of the drift model are valid, m/s²: 15 mg."""
MIN_SHARE, MAX_SHARE = 0.25, 10.0
"""Limits of the factor on the gyro's noise."""
_WINDOW_M = 0.10
"""Path of one slip measurement, m. It is longer than the correlation of slip (a third of a
second)."""
_COMMON_M_SQRT_M = 0.0017
"""Visible slip from which the common slip grows faster, m/√m. Measured: 0.0013 at ``typical`` and
0.0038 at ``harsh`` noise."""
_MAX_COMMON = 2.2
"""Maximum ratio of total to visible slip."""
_MIN_SLIPPERY, _MAX_SLIPPERY = 0.5, 3.0
"""Limits of the factor on the wheels' noise. The lower limit exists because every floor has some
slip. Above the upper limit, other measurements show the error."""
_STRAIGHT_SHARE = 0.2
"""Maximum share of turning in a measurement, at the rim. A measurement with more turning is
ignored."""
_SHARE = 0.05
"""Weight of the newest measurement in the variance of slip."""
_MEAN_SHARE = 0.02
"""Weight of the newest measurement in the mean difference of the wheels."""


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


def gyro_share(vibration_m_s2: float) -> float:
    """Return the factor on the gyro's standard deviations for a vibration, m/s²."""
    square = (vibration_m_s2 / NOMINAL_M_S2) ** 2
    return min(max(square, MIN_SHARE), MAX_SHARE)


class SlipMonitor:
    """Measures the position noise along the path from wheels and gyro."""

    __slots__ = (
        "_excess_m",
        "_mean",
        "_nominal_m",
        "_path_m",
        "_turn_m",
        "_windows",
        "variance_per_m",
    )

    def __init__(self, along_m_sqrt_m: float) -> None:
        """Begin with a standard deviation, m/√m. It has the weight of about 2 m of path."""
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
        shown_m = self.along_m_sqrt_m
        common = min(max(shown_m / _COMMON_M_SQRT_M, 1.0), _MAX_COMMON)
        return max(common * shown_m / self._nominal_m, _MIN_SLIPPERY)

    @property
    def mean_slippery(self) -> float:
        """Slip ratio for the wheel scale. It is averaged over a longer path."""
        return min(self.along_m_sqrt_m / self._nominal_m, _MAX_SLIPPERY)

    def update(self, left_m: float, right_m: float, turn_m: float) -> None:
        """Use the wheels' paths, and the gyro's turn times the wheel base; all in m."""
        self._path_m += 0.5 * abs(left_m + right_m)
        self._excess_m += right_m - left_m - turn_m
        self._turn_m += abs(turn_m)
        if self._path_m < _WINDOW_M:
            if self._turn_m > _WINDOW_M:
                self._path_m = self._excess_m = self._turn_m = 0.0
            return
        if self._turn_m < _STRAIGHT_SHARE * self._path_m:
            rate = self._excess_m / self._path_m  # constant if the wheels differ in size
            self._windows += 1
            self._mean += max(1.0 / self._windows, _MEAN_SHARE) * (rate - self._mean)
            if self._windows > 1:
                # The mean of both wheels has half the standard deviation of their difference.
                off = 0.5 * (rate - self._mean) * self._path_m
                self.variance_per_m += _SHARE * (off * off / self._path_m - self.variance_per_m)
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
