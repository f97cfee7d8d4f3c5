"""The range ahead, smoothed by dead reckoning between and across ultrasonic readings."""

from __future__ import annotations

_GAIN = 0.4
"""Share of a fresh reading: σ of the output is half that of a reading at constant speed."""
_GATE_M = 0.05
"""A reading further off than this is an outlier or a new thing in view."""
_DROPOUT_S = 0.3
"""Without an echo for this long (six readings at 20 Hz) there is nothing ahead."""


class RangeAhead:
    """Range to what is ahead at the present moment.

    Ranges come at 20 Hz and the control step at 50 Hz, so a raw reading is up to 50 ms old and
    1 cm of travel wrong. Between readings the range is reduced by the way driven; a fresh
    reading (one that differs from the last) corrects it by a share. One reading that
    disagrees is not believed, two in a row that agree with each other are.
    """

    __slots__ = ("_last_raw_m", "_pending_m", "_silent_s", "range_m")

    def __init__(self) -> None:
        """Nothing seen yet."""
        self.range_m: float | None = None
        """Present estimate in metres; ``None``: nothing ahead."""
        self._last_raw_m: float | None = None
        self._pending_m: float | None = None
        self._silent_s = 0.0

    def reset(self) -> None:
        """Forget everything, as after a turn."""
        self.range_m = None
        self._last_raw_m = None
        self._pending_m = None
        self._silent_s = 0.0

    def update(self, raw_m: float | None, travel_m: float, dt_s: float) -> float | None:
        """Estimate after driving ``travel_m`` forward in ``dt_s``, with the newest reading."""
        estimate = self.range_m
        if estimate is not None:
            estimate = max(estimate - travel_m, 0.0)
        if self._pending_m is not None:
            self._pending_m -= travel_m
        if raw_m is None:
            self._silent_s += dt_s
            if self._silent_s > _DROPOUT_S:
                estimate = None
        else:
            self._silent_s = 0.0
            if raw_m != self._last_raw_m:
                estimate = self._fresh(estimate, raw_m)
        self._last_raw_m = raw_m
        self.range_m = estimate
        return estimate

    def _fresh(self, estimate: float | None, raw_m: float) -> float:
        if estimate is None:
            self._pending_m = None
            return raw_m
        error = raw_m - estimate
        if -_GATE_M < error < _GATE_M:
            self._pending_m = None
            return estimate + _GAIN * error
        if self._pending_m is not None and abs(raw_m - self._pending_m) < _GATE_M:
            self._pending_m = None
            return raw_m
        self._pending_m = raw_m
        return estimate
