"""Range ahead: ultrasonic readings, combined with the driven path."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RangeAheadTuning:
    """Gain and limits of the filter."""

    gain: float = 0.4
    """Weight of a new reading. At constant speed the estimate has half the σ of a reading."""
    gate_m: float = 0.05
    """Innovation above which a reading is an outlier or of a new obstacle, m."""
    dropout_s: float = 0.3
    """Time without an echo after which the path ahead counts as free, s: six readings at 20 Hz."""


class RangeAhead:
    """Present range to an obstacle ahead.

    Readings arrive at 20 Hz, but control steps run at 50 Hz. So a reading is up to 50 ms old and 1
    cm wrong. Between readings the estimate decreases by the driven path. A reading that differs
    from the last one is new. It corrects the estimate by a share of the difference. A single
    outlier is ignored; two similar outliers in a row are used.
    """

    __slots__ = ("_last_raw_m", "_pending_m", "_silent_s", "_tuning", "range_m")

    def __init__(self, tuning: RangeAheadTuning | None = None) -> None:
        """Begin with no obstacle ahead."""
        self._tuning = tuning or RangeAheadTuning()
        self.range_m: float | None = None
        """Present estimate, m; None: no obstacle ahead."""
        self._last_raw_m: float | None = None
        self._pending_m: float | None = None
        self._silent_s = 0.0

    def reset(self) -> None:
        """Reset to the initial state."""
        self.range_m = None
        self._last_raw_m = None
        self._pending_m = None
        self._silent_s = 0.0

    def update(self, raw_m: float | None, travel_m: float, dt_s: float) -> float | None:
        """Return the range, m, after a path of ``travel_m`` in ``dt_s``.

        ``raw_m`` is the last reading.
        """
        estimate = self.range_m
        if estimate is not None:
            estimate = max(estimate - travel_m, 0.0)
        if self._pending_m is not None:
            self._pending_m -= travel_m
        if raw_m is None:
            self._silent_s += dt_s
            if self._silent_s > self._tuning.dropout_s:
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
        error, gate_m = raw_m - estimate, self._tuning.gate_m
        if -gate_m < error < gate_m:
            self._pending_m = None
            return estimate + self._tuning.gain * error
        if self._pending_m is not None and abs(raw_m - self._pending_m) < gate_m:
            self._pending_m = None
            return raw_m
        self._pending_m = raw_m
        return estimate
