"""Noise of this robot, measured while it drives; it scales the filter's noise.

- Vibration shifts a MEMS gyro and adds noise (vibration rectification), with the square of the
  vibration, which the accelerometer measures.
- Wheel slip shows as a difference between wheels and gyro. The part common to both wheels does not
  show: it is assumed to be as large as the visible part for little slip, and up to 2.2 times as
  large for much slip. More slip also means more lateral slip and a less certain wheel scale.
- A noisy infrared makes the robot press against the followed wall, where it slips. The innovations
  of the wall's filter measure that noise, and so the gap to keep.
"""

from __future__ import annotations

import math

NOMINAL_M_S2 = 0.15
"""Vibration per axis at which the drift model's gyro figures hold, m/s²: 15 mg."""
MIN_SHARE, MAX_SHARE = 0.25, 10.0
"""Bounds of the factor on the gyro's noise."""
_WINDOW_M = 0.10
"""Path of one measurement of slip, m: longer than the correlation of slip (a third of a second)."""
_COMMON_M_SQRT_M = 0.0017
"""Slip from which the common part grows, m/√m (measured: 0.0013 at ``typical``, 0.0038 at
``harsh``)."""
_MAX_COMMON = 2.2
"""Maximum ratio of total to visible slip."""
_MIN_SLIPPERY, _MAX_SLIPPERY = 0.5, 3.0
"""Bounds of the factor on the wheels' noise: every floor has slip, and larger errors show by other
means."""
_STRAIGHT_SHARE = 0.2
"""Share of turning in the path, at the rim, above which a measurement is skipped."""
_QUIET_M = 0.0015
"""Standard deviation of the infrared's innovations beside a wall that needs no gap, m: it is 1.0
mm at ``typical`` and 2.2 mm at ``harsh``."""
_LEARN = 0.01
"""Share of the newest innovation in that variance."""
_STAND_OFF = 2.0
"""Gap for each unit beyond it: 1.4 mm at ``harsh``. A smaller gap causes slip, a larger one leaves
floor unswept."""
_SHARE = 0.05
"""Share of the newest measurement in the variance of slip."""
_MEAN_SHARE = 0.02
"""Share of the newest measurement in the mean difference of the wheels."""


def gyro_share(vibration_m_s2: float) -> float:
    """Return the factor on the gyro's standard deviations at a vibration, m/s²."""
    square = (vibration_m_s2 / NOMINAL_M_S2) ** 2
    return min(max(square, MIN_SHARE), MAX_SHARE)


class SlipMonitor:
    """Measures the position noise along the path by wheels and gyro."""

    __slots__ = (
        "_excess_m",
        "_mean",
        "_nominal_m",
        "_turn_m",
        "_way_m",
        "_windows",
        "variance_per_m",
    )

    def __init__(self, along_m_sqrt_m: float) -> None:
        """Begin with a standard deviation in m/√m, which holds for about 2 m."""
        self._way_m = self._excess_m = self._turn_m = 0.0
        self._mean = 0.0
        self._windows = 0
        self._nominal_m = along_m_sqrt_m
        self.variance_per_m = along_m_sqrt_m**2

    @property
    def along_m_sqrt_m(self) -> float:
        """Visible standard deviation of the path, m/√m."""
        return math.sqrt(self.variance_per_m)

    @property
    def slippery(self) -> float:
        """Total slip over nominal slip."""
        shown_m = self.along_m_sqrt_m
        common = min(max(shown_m / _COMMON_M_SQRT_M, 1.0), _MAX_COMMON)
        return max(common * shown_m / self._nominal_m, _MIN_SLIPPERY)

    @property
    def mean_slippery(self) -> float:
        """The same for the wheel scale, which lasts from metre to metre."""
        return min(self.along_m_sqrt_m / self._nominal_m, _MAX_SLIPPERY)

    def update(self, left_m: float, right_m: float, turn_m: float) -> None:
        """Take the wheels' paths and the gyro's turn times the wheel base, all m."""
        self._way_m += 0.5 * abs(left_m + right_m)
        self._excess_m += right_m - left_m - turn_m
        self._turn_m += abs(turn_m)
        if self._way_m < _WINDOW_M:
            if self._turn_m > _WINDOW_M:
                self._way_m = self._excess_m = self._turn_m = 0.0
            return
        if self._turn_m < _STRAIGHT_SHARE * self._way_m:
            rate = self._excess_m / self._way_m  # wheels that differ in size give a steady rate
            self._windows += 1
            self._mean += max(1.0 / self._windows, _MEAN_SHARE) * (rate - self._mean)
            if self._windows > 1:
                # The mean of both wheels has half the difference's standard deviation.
                off = 0.5 * (rate - self._mean) * self._way_m
                self.variance_per_m += _SHARE * (off * off / self._way_m - self.variance_per_m)
        self._way_m = self._excess_m = self._turn_m = 0.0


class RangingNoise:
    """Measures the noise of the infrared beside a wall."""

    __slots__ = ("sigma_m",)

    def __init__(self) -> None:
        """Begin with a quiet sensor."""
        self.sigma_m = _QUIET_M

    def learn(self, innovation_m: float) -> None:
        """Take an innovation, m; a single one counts little, since it may be of another surface."""
        variance = self.sigma_m * self.sigma_m
        square = min(innovation_m * innovation_m, 16.0 * variance)
        self.sigma_m = math.sqrt(variance + _LEARN * (square - variance))

    @property
    def stand_off_m(self) -> float:
        """Added to the gap at which a wall is followed."""
        return _STAND_OFF * max(self.sigma_m - _QUIET_M, 0.0)
