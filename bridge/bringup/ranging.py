"""A range sensor against a tape: scale and offset from readings at known distances. Pure."""

from __future__ import annotations

import math
from statistics import fmean, median, pstdev
from typing import TYPE_CHECKING, NamedTuple

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Sequence

MIN_SPREAD_M = 0.03
"""Points nearer together than this tell of an offset alone: the sensors' noise is a tenth."""
MIN_READINGS = 5
SCALES = (0.8, 1.25)
OFFSET_M = 0.1
"""What is farther off is no calibration but a wrong distance, or another sensor."""


class Point(NamedTuple):
    """What was read with a flat wall at a known distance from the sensor's face."""

    true_m: float
    read_m: float
    sigma_m: float
    readings: int


class RangeFit(NamedTuple):
    """``true = scale · raw + offset``, and how well it fits."""

    scale: float
    offset_m: float
    before_m: float
    """Root mean square of the error with the calibration that there was."""
    after_m: float


def point(true_m: float, readings: Sequence[float | None]) -> Point:
    """One distance's readings in one figure: the mean of those near the median.

    Raises:
        BridgeError: the sensor saw too little.

    """
    seen = [r for r in readings if r is not None]
    if len(seen) < max(MIN_READINGS, len(readings) // 2):
        raise BridgeError(
            f"at {true_m:g} m the sensor saw something in {len(seen)} of {len(readings)} readings"
        )
    middle = median(seen)
    # An echo of somebody else's sound is far off: the mean of what agrees.
    kept = [r for r in seen if abs(r - middle) <= max(0.01, 0.05 * middle)]
    return Point(true_m, fmean(kept), pstdev(kept), len(kept))


def fit(points: Sequence[Point], scale: float = 1.0, offset_m: float = 0.0) -> RangeFit:
    """Least squares through the points; ``scale`` and ``offset_m`` are what the device has now.

    The device's readings are corrected already: what is given is to be set in their place.

    Raises:
        BridgeError: no points, or what they say cannot be.

    """
    if not points:
        raise BridgeError("no distance was measured")
    spread = max(p.true_m for p in points) - min(p.true_m for p in points)
    if len(points) > 1 and spread >= MIN_SPREAD_M:
        mean_read, mean_true = fmean(p.read_m for p in points), fmean(p.true_m for p in points)
        above = sum((p.read_m - mean_read) * (p.true_m - mean_true) for p in points)
        below = sum((p.read_m - mean_read) ** 2 for p in points)
        if below <= 0.0:
            raise BridgeError("the sensor reads the same at every distance")
        slope = above / below
        shift = mean_true - slope * mean_read
    else:
        slope, shift = 1.0, fmean(p.true_m - p.read_m for p in points)
    total_scale, total_offset = slope * scale, slope * offset_m + shift
    if not SCALES[0] <= total_scale <= SCALES[1] or abs(total_offset) > OFFSET_M:
        raise BridgeError(
            f"scale {total_scale:.3f} and offset {1000 * total_offset:+.0f} mm cannot be: "
            "are the distances from the sensor's own face?"
        )
    return RangeFit(
        total_scale,
        total_offset,
        _rms([p.read_m - p.true_m for p in points]),
        _rms([slope * p.read_m + shift - p.true_m for p in points]),
    )


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(fmean(v * v for v in values))
