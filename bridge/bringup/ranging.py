"""Calibration of a range sensor: scale and offset from readings at known distances. No I/O."""

from __future__ import annotations

import math
from statistics import fmean, median, pstdev
from typing import TYPE_CHECKING, NamedTuple

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Sequence

MIN_SPREAD_M = 0.03
"""Minimum spread of the distances for a fit of the scale, m. It is ten times the noise of the
sensors. With a smaller spread, only the offset is fitted."""
MIN_READINGS = 5
"""Minimum number of valid readings at one distance."""
SCALES = (0.8, 1.25)
"""Range of plausible scales. Other scales are caused by a wrong distance or another sensor."""
OFFSET_M = 0.1
"""Maximum plausible offset, m."""


class RangeCalibrationError(BridgeError):
    """The readings do not give a calibration."""


class Point(NamedTuple):
    """Readings of a flat wall at a measured distance from the face of the sensor."""

    true_m: float
    read_m: float
    sigma_m: float
    readings: int


class RangeFit(NamedTuple):
    """The calibration ``true = scale · raw + offset`` and its residuals."""

    scale: float
    offset_m: float
    before_m: float
    """Root mean square error with the previous calibration, m."""
    after_m: float
    """Root mean square error with this calibration, m."""


def point(true_m: float, readings: Sequence[float | None]) -> Point:
    """Return the mean of the readings near the median.

    Raises:
        RangeCalibrationError: too few readings are valid.

    """
    seen = [r for r in readings if r is not None]
    if len(seen) < max(MIN_READINGS, len(readings) // 2):
        text = f"at {true_m:g} m only {len(seen)} of {len(readings)} readings are valid"
        raise RangeCalibrationError(text)
    middle = median(seen)
    # Readings far from the median are omitted. Their cause is crosstalk from other ultrasonic
    # sensors.
    kept = [r for r in seen if abs(r - middle) <= max(0.01, 0.05 * middle)]
    return Point(true_m, fmean(kept), pstdev(kept), len(kept))


def fit(points: Sequence[Point], scale: float = 1.0, offset_m: float = 0.0) -> RangeFit:
    """Fit a calibration to the points by least squares.

    The device has already corrected the readings with ``scale`` and ``offset_m``. The result
    contains this correction and replaces it.

    Raises:
        RangeCalibrationError: there are no points, or the result is implausible.

    """
    if not points:
        raise RangeCalibrationError("no distance was measured")
    spread = max(p.true_m for p in points) - min(p.true_m for p in points)
    if len(points) > 1 and spread >= MIN_SPREAD_M:
        mean_read, mean_true = fmean(p.read_m for p in points), fmean(p.true_m for p in points)
        above = sum((p.read_m - mean_read) * (p.true_m - mean_true) for p in points)
        below = sum((p.read_m - mean_read) ** 2 for p in points)
        if below <= 0.0:
            raise RangeCalibrationError("the sensor reads the same at every distance")
        slope = above / below
        shift = mean_true - slope * mean_read
    else:
        slope, shift = 1.0, fmean(p.true_m - p.read_m for p in points)
    total_scale, total_offset = slope * scale, slope * offset_m + shift
    if not SCALES[0] <= total_scale <= SCALES[1] or abs(total_offset) > OFFSET_M:
        raise RangeCalibrationError(
            f"scale {total_scale:.3f} and offset {1000 * total_offset:+.0f} mm are implausible; "
            "measure the distances from the face of the sensor"
        )
    return RangeFit(
        total_scale,
        total_offset,
        _rms([p.read_m - p.true_m for p in points]),
        _rms([slope * p.read_m + shift - p.true_m for p in points]),
    )


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(fmean(v * v for v in values))
