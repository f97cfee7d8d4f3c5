"""Distance, direction and curvature of a wall beside the robot, from readings of one sensor.

One reading gives only a distance. Several readings along a path also give the direction, and along
a longer path the curvature. A Kalman filter estimates three states:

    d: distance from the axle's centre to the wall, along the wall's normal (m)
    ψ: heading minus the wall's direction (rad); positive: the robot points into the wall
    b: bend, the turn of the wall's direction per path of the robot (rad/m); positive: towards the
       wall, as around a column

The side is u (+1 left, -1 right). A motion (ds ahead, dθ) gives ψ' = ψ + u·dθ - b·ds and
d' = d - ds·sin ψ. The beam starts sideways at (mx, my), with the range r. Its hit is on the wall if

    mx·sin ψ + (|my| + r)·cos ψ = d + κ·s²/2,

where κ = b/(1 - b·d) is the wall's curvature, and s the distance of the hit along the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RangerMount

_NEAR_SIGMA_M = 0.0012
"""Standard deviation of every reading, m: calibration error, and the protocol's resolution of 1.25
mm."""
_SIGMA_M = 0.0015
"""Additional standard deviation of a reading at 10 cm, m. It grows with the square of the range,
because the sensor triangulates."""
_SIGMA_AT_M = 0.10
_MIN_M = 0.01
"""Minimum distance in the limit of the bend, m."""
MAX_YAW_RAD = math.radians(60.0)
"""Maximum angle between beam and normal, rad. A beam at a larger angle measures almost nothing."""


@dataclass(frozen=True, slots=True)
class TrackTuning:
    """Process noise and initial uncertainty of the filter."""

    path_share: float = 0.02
    """Standard deviation of d, as a share of the path. It covers wheel errors and walls that are
    not flat."""
    turn_rad_sqrt_m: float = 0.25
    """Standard deviation of ψ per √m, rad. It covers the beginning of a curve, and edges."""
    bend_rad_m_sqrt_m: float = 1.0
    """Standard deviation of the bend per √m, rad/m. Relative to the noise of ψ it determines the
    path after which a change of the bend is known: a quarter of a metre."""
    first_bend_rad_m: float = 1.0
    """Standard deviation of the bend of a new wall, rad/m. Larger values let the robot swing at the
    beginning of a straight wall."""
    max_bend: float = 0.65
    """Maximum absolute value of the bend, as a share of that around a point, 1/d. A thinner column
    is an end of the wall."""
    first_yaw_rad: float = 0.3
    """Standard deviation of ψ for a new wall, rad."""


def infrared_sigma_m(range_m: float) -> float:
    """Return the standard deviation of a reading of a triangulating infrared sensor, m."""
    return math.hypot(_NEAR_SIGMA_M, _SIGMA_M * (range_m / _SIGMA_AT_M) ** 2)


class WallTrack:
    """The filter. Before the first reading the distance is None, and the other states are 0."""

    __slots__ = (
        "_arm_m",
        "_pbb",
        "_pdb",
        "_pdd",
        "_pdy",
        "_pyb",
        "_pyy",
        "_reach_m",
        "_tuning",
        "bend_rad_m",
        "distance_m",
        "yaw_rad",
    )

    def __init__(self, mount: RangerMount, tuning: TrackTuning | None = None) -> None:
        """Create a filter for a range sensor that faces sideways."""
        self._tuning = tuning or TrackTuning()
        self._reach_m = mount.x_m
        self._arm_m = abs(mount.y_m)
        self.clear()

    def clear(self) -> None:
        """Remove the wall from the filter."""
        self.distance_m: float | None = None
        self.yaw_rad = self.bend_rad_m = 0.0
        self._pdd = self._pdy = self._pyy = self._pdb = self._pyb = self._pbb = 0.0

    @property
    def yaw_sigma_rad(self) -> float:
        """Standard deviation of ψ, rad."""
        return math.sqrt(self._pyy)

    @property
    def distance_sigma_m(self) -> float:
        """Standard deviation of d, m."""
        return math.sqrt(self._pdd)

    def begin(self, range_m: float, yaw_rad: float = 0.0, sigma_rad: float | None = None) -> None:
        """Begin with a reading of a wall. The wall's direction is only roughly known."""
        if sigma_rad is None:
            sigma_rad = self._tuning.first_yaw_rad
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        self.yaw_rad, self.bend_rad_m = yaw_rad, 0.0
        self.distance_m = self._reach_m * s + (self._arm_m + range_m) * c
        slope = self._reach_m * c - (self._arm_m + range_m) * s
        self._pyy = sigma_rad**2
        self._pdy = slope * self._pyy
        self._pdd = slope * self._pdy + infrared_sigma_m(range_m) ** 2
        self._pdb = self._pyb = 0.0
        self._pbb = self._tuning.first_bend_rad_m**2

    def move(self, ahead_m: float, into_rad: float, min_m: float = 0.0) -> None:
        """Predict a motion of ``ahead_m``, m, and a turn of ``into_rad`` towards the wall, rad.

        In contact, at the distance ``min_m``, the robot moves along the wall. A constant distance
        then gives no information about the direction. At a corner the robot may be closer than
        ``min_m`` to the line of a wall that begins beyond the corner. The limit does not apply
        then, because the robot cannot reach that line.
        """
        if self.distance_m is None:
            return
        tuning = self._tuning
        turn = into_rad - self.bend_rad_m * ahead_m
        mid = self.yaw_rad + 0.5 * turn
        distance = self.distance_m
        self.distance_m = max(distance - ahead_m * math.sin(mid), min(distance, min_m))
        self.yaw_rad += turn
        slope = -ahead_m * math.cos(mid)
        path_m = abs(ahead_m)
        # P' = F·P·Fᵀ + Q with d' = d + slope·ψ and ψ' = ψ - ahead·b
        self._pdd += (
            slope * (2.0 * self._pdy + slope * self._pyy) + (tuning.path_share * path_m) ** 2
        )
        pdb = self._pdb + slope * self._pyb
        self._pdy += slope * self._pyy - ahead_m * pdb
        turn_noise = tuning.turn_rad_sqrt_m**2 * path_m
        self._pyy += ahead_m * (ahead_m * self._pbb - 2.0 * self._pyb) + turn_noise
        self._pdb = pdb
        self._pyb -= ahead_m * self._pbb
        self._pbb += tuning.bend_rad_m_sqrt_m**2 * path_m

    def expected_m(self) -> float | None:
        """Expected reading, m; None: no wall, or the angle of the beam is too large."""
        if self.distance_m is None or abs(self.yaw_rad) > MAX_YAW_RAD:
            return None
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        along = (self._reach_m - self.distance_m * s) / c
        share = min(self.bend_rad_m * self.distance_m, self._tuning.max_bend)
        curvature = self.bend_rad_m / (1.0 - share)
        sag = 0.5 * curvature * along * along
        return (self.distance_m + sag - self._reach_m * s) / c - self._arm_m

    def take(self, range_m: float, gate_sigmas: float, min_gate_m: float) -> bool:
        """Update with a reading.

        If the reading is of another surface, return False and do not update.
        """
        expected = self.expected_m()
        if expected is None or self.distance_m is None:
            return False
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        by_d = 1.0 / c
        by_yaw = (self.distance_m * s - self._reach_m) / (c * c)
        to_d = self._pdd * by_d + self._pdy * by_yaw
        to_yaw = self._pdy * by_d + self._pyy * by_yaw
        to_bend = self._pdb * by_d + self._pyb * by_yaw
        variance = by_d * to_d + by_yaw * to_yaw + infrared_sigma_m(range_m) ** 2
        innovation = range_m - expected
        if abs(innovation) > max(min_gate_m, gate_sigmas * math.sqrt(variance)):
            return False
        gain = 1.0 / variance
        self.distance_m += to_d * gain * innovation
        self.yaw_rad += to_yaw * gain * innovation
        bend = self.bend_rad_m + to_bend * gain * innovation
        max_bend = self._tuning.max_bend / max(self.distance_m, _MIN_M)
        self.bend_rad_m = max(min(bend, max_bend), -max_bend)
        self._pdd -= to_d * to_d * gain
        self._pdy -= to_d * to_yaw * gain
        self._pyy -= to_yaw * to_yaw * gain
        self._pdb -= to_d * to_bend * gain
        self._pyb -= to_yaw * to_bend * gain
        self._pbb -= to_bend * to_bend * gain
        return True
