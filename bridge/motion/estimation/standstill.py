"""Detection of standstill by wheels that do not turn."""

from __future__ import annotations

import math


class Standstill:
    """Detects standstill from the encoders. The gyro can disprove it.

    The robot stands still from the start until the first count. After a motion, it stands still
    when the counts have not changed for ``settling_s``. In this time the gearbox play and the
    run-out end.
    """

    __slots__ = ("_last_count_s", "_last_sample_s", "_settling_s")

    RATE_VETO_RAD_S = 0.05
    """Maximum yaw rate minus the bias at standstill, rad/s (3 °/s). A higher rate means that a
    person turns the robot while its wheels stand still."""
    STALE_S = 0.2
    """Time without encoder samples after which the robot no longer counts as standing still, s."""

    def __init__(self, settling_s: float = 0.3) -> None:
        """Create a detector that waits ``settling_s`` after the last count."""
        self._settling_s = settling_s
        self._last_count_s = -math.inf
        self._last_sample_s: float | None = None

    def on_encoders(self, t_s: float, *, moved: bool) -> None:
        """Process the time of an encoder sample, s. ``moved``: a count has changed."""
        self._last_sample_s = t_s
        if moved:
            self._last_count_s = t_s

    def at_rest(self, t_s: float) -> bool:
        """Return True if the wheels stand still at a time, s."""
        if self._last_sample_s is None:
            return True
        return (
            t_s - self._last_count_s >= self._settling_s
            and t_s - self._last_sample_s < self.STALE_S
        )
