"""Standstill, told by wheels that do not turn."""

from __future__ import annotations

import math


class Standstill:
    """Tells rest from motion by the encoders, with a veto by the gyro.

    At rest from the start (a robot boots standing), until the first count. After a motion,
    rest is believed once the counts have not changed for ``settling_s``: gearbox play and the
    last of the run-out are over by then.
    """

    __slots__ = ("_last_count_s", "_last_sample_s", "_settling_s")

    RATE_VETO_RAD_S = 0.05
    """A robot turned by hand has still wheels: no rest above 3 °/s off the bias."""
    STALE_S = 0.2
    """Without encoder samples for this long, nothing is known about rest."""

    def __init__(self, settling_s: float = 0.3) -> None:
        """``settling_s``: see the class."""
        self._settling_s = settling_s
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
            t_s - self._last_count_s >= self._settling_s
            and t_s - self._last_sample_s < self.STALE_S
        )
