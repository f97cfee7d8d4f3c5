"""Zero-velocity update: when the robot stands still, and the gyro bias that this measures.

Two conditions hold at a standstill: the wheels do not turn, and the gyro does not disprove it. Five
samples at standstill are one measurement of the gyro bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

BATCH = 5
"""Number of samples at standstill that are averaged for one update, to save processor time."""


@dataclass(frozen=True, slots=True)
class StandstillTuning:
    """Limits of a standstill."""

    first_bias_samples: int = 25
    """Number of samples at standstill before the gyro is used. Before that the wheels measure the
    heading."""
    max_bias_rad_s: float = 0.4
    """Maximum bias, rad/s: the data sheet's ±20 °/s. A larger first sample means that the robot is
    moving."""
    rate_veto_rad_s: float = 0.05
    """Maximum yaw rate minus the bias at standstill, rad/s (3 °/s). A higher rate means that a
    person turns the robot while its wheels stand still."""
    stale_s: float = 0.2
    """Time without encoder samples after which the robot no longer counts as standing still, s."""
    settling_s: float = 0.3
    """Time without counts after which the wheels stand still, s. In this time the gearbox play and
    the run-out end."""


class Standstill:
    """Detects standstill by encoders and gyro, and averages the gyro samples in it.

    The wheels stand still from the start until the first count. After a motion, they stand still
    when the counts have not changed for ``settling_s``.
    """

    def __init__(self, tuning: StandstillTuning | None = None) -> None:
        """Create a detector for wheels that have not turned yet."""
        self._tuning = tuning or StandstillTuning()
        self.at_rest = True
        """True if the last gyro sample was a sample at standstill."""
        self._last_count_s = -math.inf
        self._last_encoder_s: float | None = None
        self._samples = 0
        self._batch_sum, self._batch_count = 0.0, 0
        self._previous_mean: float | None = None

    @property
    def bias_known(self) -> bool:
        """True after the first 25 samples of one standstill. Then the gyro can be used."""
        return self._samples >= self._tuning.first_bias_samples

    def on_encoders(self, t_s: float, *, moved: bool) -> None:
        """Process the time of an encoder sample, s. ``moved``: a count has changed."""
        self._last_encoder_s = t_s
        if moved:
            self._last_count_s = t_s

    def on_gyro(self, t_s: float, rate_rad_s: float, bias_rad_s: float) -> float | None:
        """Process a gyro sample at a time, s, and update :attr:`at_rest`.

        Args:
            t_s: time of the sample, s.
            rate_rad_s: measured yaw rate, rad/s.
            bias_rad_s: estimated bias, rad/s.

        Returns:
            The mean of a batch of samples at standstill, rad/s, which measures the bias; None if no
            batch is complete. Each batch waits until the next one is complete, because a start may
            affect the last batch: counts arrive up to 20 ms late.

        """
        if self.bias_known:
            quiet = abs(rate_rad_s - bias_rad_s) < self._tuning.rate_veto_rad_s
        else:
            quiet = abs(rate_rad_s) < self._tuning.max_bias_rad_s
        self.at_rest = self.wheels_stand(t_s) and quiet
        if not self.at_rest:
            if not self.bias_known:
                self._samples = 0
            self._batch_sum, self._batch_count, self._previous_mean = 0.0, 0, None
            return None
        self._samples += 1
        self._batch_sum += rate_rad_s
        self._batch_count += 1
        if self._batch_count < BATCH:
            return None
        ripe, self._previous_mean = self._previous_mean, self._batch_sum / self._batch_count
        self._batch_sum, self._batch_count = 0.0, 0
        return ripe

    def wheels_stand(self, t_s: float) -> bool:
        """Return True if the wheels stand still at a time, s."""
        if self._last_encoder_s is None:
            return True
        return (
            t_s - self._last_count_s >= self._tuning.settling_s
            and t_s - self._last_encoder_s < self._tuning.stale_s
        )
