"""Measurements of flat walls: lines from the side infrared, distances from the ultrasonic sensor.

A measurement is in the robot's frame at the time when it is complete. Its hits are collected in the
frame of the odometry, so that updates of the estimate do not bend the line.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.estimation.wall_track import infrared_sigma_m
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from bridge.motion.robot_model import RangerMount

WANDER_BOW = 1.5 * 5.0 / math.sqrt(210.0)
"""Ratio of two standard deviations: the apparent bow of a flat wall, and the lateral slip that
causes this bow. Its value is 0.52, from the second Legendre coefficient of a Brownian path."""
_RANGE_SHARE = 0.43
"""Mean ratio of the standard deviation to the range (maximum minus minimum) of five normally
distributed values."""


@dataclass(frozen=True, slots=True)
class MeasurementTuning:
    """Limits and uncertainty of the measurements of walls."""

    min_span_m: float = 0.09
    """Minimum length of a fitted line, m. When the robot moves by one cleaning width to the next
    lane, it measures 0.12 m of the wall."""
    max_span_m: float = 0.40
    """Length at which a line is complete, m."""
    min_hits: int = 7
    """Minimum number of hits of a line."""
    max_chi2: float = 11.0
    """Maximum mean squared residual of a flat wall per degree of freedom, after subtraction of the
    estimated sensor noise. If the sensor is noisier than assumed, the measurement has less
    weight."""
    noise_hits: float = 60.0
    """Number of hits after which the measured noise of a sensor has half the weight."""
    max_bow_m: float = 0.003
    """Maximum bow of a flat wall, m. The surface of a column of 0.7 m diameter bows by 5 mm over
    0.12 m."""
    jump_m: float = 0.012
    """Minimum difference between two readings that means another surface, in addition to the
    sensor's noise, m."""
    gap_m: float = 0.08
    """Maximum distance between two hits of a line, m. Beyond it the sensor may measure another
    wall."""
    gap_rad: float = math.radians(15.0)
    """Maximum turn between two hits of a line, rad. Beyond it the sensor may measure another
    wall."""
    steady_rad_s: float = 0.30
    """Yaw rate from which readings do not count, rad/s."""
    moving_m_s: float = 0.02
    """Minimum speed at which readings of the side infrared belong to a line, m/s."""
    flat_m: float = 0.0008
    """Standard deviation of the distance that averaging does not reduce, m. Walls are not perfectly
    flat."""
    flat_rad: float = math.radians(0.07)
    """Standard deviation of the direction that averaging does not reduce, rad. Walls are not
    perfectly flat, and sensors are not perfectly aligned."""
    front_hits: int = 5
    """Number of ultrasonic readings for one measurement: 0.25 s at 20 Hz."""
    front_spread_m: float = 0.025
    """Maximum spread of the wall's position within one measurement, m. A larger spread means a
    corner or two surfaces."""
    front_sigma_m: float = 0.003
    """Minimum standard deviation of an ultrasonic reading, m."""
    cone_share: float = 0.005
    """Standard deviation of the measured range, as a share of the range. The range is up to 0.9 %
    too long if a corner at the edge of the cone returns the echo."""
    front_max_m: float = 1.2
    """Maximum ultrasonic range that is used, m."""
    front_step_m: float = 0.03
    """Minimum motion between two measurements, m. At standstill the errors repeat."""
    echo_age_s: float = 0.03
    """Assumed age of a new ultrasonic range if the device does not send the age, s. The sensor
    pings every 60 ms, and the stream samples its result. A repeated range is older and is not
    used."""
    echo_age_sigma_s: float = 0.02
    """Standard deviation of the age, s. At cruise speed this is an error of 4 mm. An age that the
    device sends is exact to a few ms. But a value of 3 ms gave the same coverage and pose error in
    60 paired runs."""


class LineMeasurement(NamedTuple):
    """A straight piece of a wall, in the robot's frame."""

    normal_rad: float
    """Direction of the normal, which points from the robot into the wall, rad."""
    distance_m: float
    """Distance from the axle's centre along the normal, m."""
    var_normal: float
    """Variance of the normal's direction, rad²."""
    covar: float
    """Covariance of direction and distance, rad·m."""
    var_distance: float
    """Variance of the distance, m²."""
    low_m: float
    """Start of the piece, m. Positions along the wall are measured from the foot of the normal.
    They increase counter-clockwise, as seen from the robot."""
    high_m: float
    """End of the piece, m."""

    @property
    def span_m(self) -> float:
        """Length of the piece, m."""
        return self.high_m - self.low_m

    def with_sigma(self, sigma_rad: float) -> LineMeasurement:
        """Return the line with a larger standard deviation of its direction, rad."""
        more = sigma_rad * sigma_rad
        ahead = 0.5 * (self.low_m + self.high_m)
        return self._replace(
            var_normal=self.var_normal + more,
            covar=self.covar + ahead * more,
            var_distance=self.var_distance + ahead * ahead * more,
        )


class FrontMeasurement(NamedTuple):
    """A flat surface ahead of the ultrasonic sensor."""

    range_m: float
    """Distance from the sensor along the surface's normal, m. The normal is within the cone."""
    variance: float
    """Variance of the distance, m²."""


class _Hit(NamedTuple):
    x_m: float
    y_m: float
    weight: float


class _Fit(NamedTuple):
    measurement: LineMeasurement | None
    noise_chi2: float
    """Variance of the sensor, relative to ``infrared_sigma_m``."""


class SideMeasurement:
    """Collects the hits of one infrared sensor.

    It fits a line to the hits when the wall ends or the line is long enough.
    """

    def __init__(self, mount: RangerMount, tuning: MeasurementTuning | None = None) -> None:
        """Collect the hits of a sensor with this mount."""
        self._mount = mount
        self._tuning = tuning or MeasurementTuning()
        self._hits: list[_Hit] = []
        self._newest_m: deque[float] = deque(maxlen=3)
        """Newest readings of the line, m."""
        self._jumped = False
        """True if the newest reading was dropped. A single distant reading is noise; two in a row
        are another surface."""
        self._last = Pose2(0.0, 0.0, 0.0)
        """Odometry at the last hit."""
        self._noise_share = 1.0
        """Measured variance of the readings, relative to ``infrared_sigma_m``."""

    def add(
        self,
        odometry: Pose2,
        range_m: float | None,
        *,
        moving: bool,
        steady: bool,
        wander_m_sqrt_m: float = 0.0,
    ) -> LineMeasurement | None:
        """Use a reading. Return the measurement that it completes; None: not complete.

        Readings during a fast turn are ignored. A short turn does not end the line, because with a
        noisy infrared sensor the robot often turns a little along a wall. At a corner the robot
        turns farther in one direction. A turn of more than ``gap_rad`` between two hits ends the
        line.

        ``wander_m_sqrt_m`` is the standard deviation of lateral slip, m per square root of the path
        in metres.
        """
        if range_m is None or not moving:
            return self._end(odometry, wander_m_sqrt_m)
        if not steady:
            return None
        tuning, sigma = self._tuning, infrared_sigma_m(range_m)
        measurement = None
        last = self._last
        last_m = sorted(self._newest_m)[len(self._newest_m) // 2] if self._hits else range_m
        noise_m = sigma * math.sqrt(max(self._noise_share, 1.0))
        jumped = abs(range_m - last_m) > tuning.jump_m + 3.0 * noise_m
        if jumped and not self._jumped:
            self._jumped = True
            return None
        self._jumped = False
        if self._hits and (
            jumped
            or odometry.distance_m(last) > tuning.gap_m
            or abs(math.remainder(odometry.theta_rad - last.theta_rad, math.tau)) > tuning.gap_rad
        ):
            measurement = self._end(odometry, wander_m_sqrt_m)
        mount = self._mount
        reach = max(mount.min_range_m, range_m)
        x, y = odometry.transform(
            mount.x_m + reach * math.cos(mount.yaw_rad),
            mount.y_m + reach * math.sin(mount.yaw_rad),
        )
        self._hits.append(_Hit(x, y, 1.0 / sigma**2))
        self._newest_m.append(range_m)
        self._last = odometry
        first = self._hits[0]
        if math.hypot(x - first.x_m, y - first.y_m) >= tuning.max_span_m:
            return self._end(odometry, wander_m_sqrt_m)
        return measurement

    def _end(self, odometry: Pose2, wander_m_sqrt_m: float) -> LineMeasurement | None:
        hits, self._hits, self._jumped = self._hits, [], False
        self._newest_m.clear()
        if len(hits) < self._tuning.min_hits:
            return None
        fit = fit_line(hits, odometry, wander_m_sqrt_m, self._noise_share, self._tuning)
        weight = len(hits) / (len(hits) + self._tuning.noise_hits)
        self._noise_share += weight * (fit.noise_chi2 - self._noise_share)
        return fit.measurement


def fit_line(
    hits: list[_Hit],
    odometry: Pose2,
    wander_m_sqrt_m: float,
    noise_share: float,
    tuning: MeasurementTuning,
) -> _Fit:
    """Fit a line by weighted total least squares.

    The measurement is None if the hits are not a flat wall. ``noise_share`` is the variance of the
    sensor so far, relative to ``infrared_sigma_m``. The residuals of a few hits may be small by
    chance, so the variance of the line is never based on less.
    """
    total = sum(h.weight for h in hits)
    mean_x = sum(h.weight * h.x_m for h in hits) / total
    mean_y = sum(h.weight * h.y_m for h in hits) / total
    sxx = sum(h.weight * (h.x_m - mean_x) ** 2 for h in hits)
    syy = sum(h.weight * (h.y_m - mean_y) ** 2 for h in hits)
    sxy = sum(h.weight * (h.x_m - mean_x) * (h.y_m - mean_y) for h in hits)
    angle = 0.5 * math.atan2(2.0 * sxy, sxx - syy)
    to_x, to_y = mean_x - odometry.x_m, mean_y - odometry.y_m
    if to_y * math.cos(angle) - to_x * math.sin(angle) < 0.0:  # the normal points to the robot
        angle += math.pi
    c, s = math.cos(angle), math.sin(angle)
    along = [(h.x_m - mean_x) * c + (h.y_m - mean_y) * s for h in hits]
    across = [(h.y_m - mean_y) * c - (h.x_m - mean_x) * s for h in hits]
    low, high = min(along), max(along)
    moment = sum(h.weight * a * a for h, a in zip(hits, along, strict=True))
    chi2 = sum(h.weight * e * e for h, e in zip(hits, across, strict=True)) / (len(hits) - 2)
    noise_chi2 = _noise_chi2(hits, across)
    if high - low < tuning.min_span_m or chi2 - noise_chi2 > tuning.max_chi2:
        return _Fit(None, noise_chi2)
    chi2 = max(chi2, noise_share, 1.0)
    bow, bow_sigma = _bow(hits, along, across)
    noise = math.sqrt(chi2) * bow_sigma
    wander = WANDER_BOW * wander_m_sqrt_m * math.sqrt(high - low)
    if abs(bow) > max(tuning.max_bow_m, 3.0 * math.hypot(noise, wander)):
        return _Fit(None, noise_chi2)
    # Position along the wall: a rotation about the mean of the hits moves the foot of the normal.
    ahead = to_x * c + to_y * s
    var_angle = chi2 / moment + tuning.flat_rad**2
    line = LineMeasurement(
        math.remainder(angle + 0.5 * math.pi - odometry.theta_rad, math.tau),
        to_y * c - to_x * s,
        var_angle,
        -ahead * var_angle,
        chi2 / total + tuning.flat_m**2 + ahead * ahead * var_angle,
        -ahead - high,
        -ahead - low,
    )
    return _Fit(line, noise_chi2)


def _noise_chi2(hits: list[_Hit], across: list[float]) -> float:
    """Return the mean squared residual due to sensor noise, from successive differences.

    The noise of successive readings is independent. The shape of the surface is not (J. von
    Neumann, 1941).
    """
    squares = [
        hit.weight * (there - here) ** 2
        for hit, here, there in zip(hits[1:], across, across[1:], strict=False)
    ]
    return sum(squares) / (2.0 * len(squares))


def _bow(hits: list[_Hit], along: list[float], across: list[float]) -> tuple[float, float]:
    """Return the bow of the hits and its standard deviation, m."""
    squares = [h.weight * a * a for h, a in zip(hits, along, strict=True)]
    mean_square = sum(squares) / sum(h.weight for h in hits)
    shape = [a * a - mean_square for a in along]
    power = sum(h.weight * q * q for h, q in zip(hits, shape, strict=True))
    if power <= 0.0:
        return 0.0, 0.0
    share = sum(h.weight * q * e for h, q, e in zip(hits, shape, across, strict=True)) / power
    quarter = (max(along) - min(along)) ** 2 / 4.0
    return share * quarter, quarter / math.sqrt(power)


class FrontMeasurements:
    """Combines ultrasonic readings into one measurement if they agree with the driven path."""

    def __init__(self, mount: RangerMount, tuning: MeasurementTuning | None = None) -> None:
        """Combine the readings of a sensor with this mount, which faces ahead."""
        self._mount = mount
        self._tuning = tuning or MeasurementTuning()
        self._places: list[float] = []
        self._from = Pose2(0.0, 0.0, 0.0)
        self._last: Pose2 | None = None

    def add(
        self, odometry: Pose2, range_m: float | None, *, steady: bool
    ) -> FrontMeasurement | None:
        """Use a reading at this odometry pose.

        Return the measurement that it completes; None: none.
        """
        tuning, min_m = self._tuning, self._mount.min_range_m
        if range_m is None or not steady or not min_m < range_m < tuning.front_max_m:
            self._places.clear()
            return None
        if self._last is not None and odometry.distance_m(self._last) < tuning.front_step_m:
            return None
        if not self._places:
            self._from = odometry
        base = self._from
        c, s = math.cos(base.theta_rad), math.sin(base.theta_rad)
        gone = (odometry.x_m - base.x_m) * c + (odometry.y_m - base.y_m) * s
        places = self._places
        places.append(gone + range_m)
        if max(places) - min(places) > tuning.front_spread_m:
            places.clear()
            return None
        if len(places) < tuning.front_hits:
            return None
        mean = sum(places) / len(places) - gone
        spread = max(places) - min(places)
        noise = max(tuning.front_sigma_m, _RANGE_SHARE * spread)
        variance = noise**2 / len(places) + tuning.flat_m**2 + (tuning.cone_share * mean) ** 2
        places.clear()
        self._last = odometry
        return FrontMeasurement(mean, variance)
