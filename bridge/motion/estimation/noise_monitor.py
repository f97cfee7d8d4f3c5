"""How noisy this robot is, measured while it drives: what the filter's noise is scaled by.

- Vibration shifts and shakes a MEMS gyro (vibration rectification), and that grows with the
  square of the vibration: the accelerometer tells how strong it is.
- Slip of the wheels shows as disagreement between their difference and the gyro. Of its part
  common to both wheels nothing shows: where they slip little it is taken as large as the part
  that differs, where they slip much as up to 2.2 times that. Who slips also slides aside more, and
  his wheels' mean way is less known.
- A noisy infrared presses the robot to the wall that it follows, where it slides. What
  surprises the wall's filter tells how noisy it is, and so how far to stand off.
"""

from __future__ import annotations

import math

NOMINAL_M_S2 = 0.15
"""Vibration per axis for which the drift model's figures of the gyro hold: 15 mg."""
MIN_SHARE, MAX_SHARE = 0.25, 10.0
_WINDOW_M = 0.10
"""Longer than the memory of slip (a third of a second)."""
_COMMON_M_SQRT_M, _MAX_COMMON = 0.0017, 2.2
"""From this slip on (measured: 0.0013 at ``typical``, 0.0038 at ``harsh``) more of it is common."""
_MIN_SLIPPERY, _MAX_SLIPPERY = 0.5, 3.0
"""Bounds: no floor is quite without slip, and wheels that far off show it soon enough."""
_STRAIGHT_SHARE = 0.2
"""A window that turned by more than this share of its way, at the rims, is passed over."""
_QUIET_M = 0.0015
"""Standard deviation of an infrared's surprises beside a wall: at ``typical`` they are 1.0 mm,
at ``harsh`` 2.2 mm."""
_LEARN = 0.01
_STAND_OFF = 2.0
"""Gap for each millimetre beyond: at ``harsh`` 1.4 mm. Less lets it slide, more leaves floor."""
_SHARE = 0.05
_MEAN_SHARE = 0.02


def gyro_share(vibration_m_s2: float) -> float:
    """Factor on the standard deviations of the gyro's errors in motion."""
    square = (vibration_m_s2 / NOMINAL_M_S2) ** 2
    return min(max(square, MIN_SHARE), MAX_SHARE)


class SlipMonitor:
    """Position noise along the way, from wheels against gyro."""

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
        """Believe ``along_m_sqrt_m`` at first, for some 2 m."""
        self._way_m = self._excess_m = self._turn_m = 0.0
        self._mean = 0.0
        self._windows = 0
        self._nominal_m = along_m_sqrt_m
        self.variance_per_m = along_m_sqrt_m**2

    @property
    def along_m_sqrt_m(self) -> float:
        """Standard deviation of the way per √m, as far as it shows."""
        return math.sqrt(self.variance_per_m)

    @property
    def slippery(self) -> float:
        """How much more than nominal these wheels slip, what does not show included."""
        shown_m = self.along_m_sqrt_m
        common = min(max(shown_m / _COMMON_M_SQRT_M, 1.0), _MAX_COMMON)
        return max(common * shown_m / self._nominal_m, _MIN_SLIPPERY)

    @property
    def mean_slippery(self) -> float:
        """The same for what stays from metre to metre: the way that a count stands for."""
        return min(self.along_m_sqrt_m / self._nominal_m, _MAX_SLIPPERY)

    def update(self, left_m: float, right_m: float, turn_m: float) -> None:
        """Take an interval: the wheels' ways, and the rotation by the gyro times the base."""
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
    """How noisy this robot's infrared is beside a wall."""

    __slots__ = ("sigma_m",)

    def __init__(self) -> None:
        """Begin as a good sensor's."""
        self.sigma_m = _QUIET_M

    def learn(self, innovation_m: float) -> None:
        """Take one reading's surprise; one alone counts for little, it may be another surface."""
        variance = self.sigma_m * self.sigma_m
        square = min(innovation_m * innovation_m, 16.0 * variance)
        self.sigma_m = math.sqrt(variance + _LEARN * (square - variance))

    @property
    def stand_off_m(self) -> float:
        """Added to the gap at which a wall is followed."""
        return _STAND_OFF * max(self.sigma_m - _QUIET_M, 0.0)
