"""The robot's dimensions, limits and sensor mounts.

The defaults are the paper's values. The paper does not give all values; the other defaults are for
common parts of a robot of this size. A robot file (TOML) may override all of them, see
``bridge.config``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

_DECIMALS = 9
"""Decimals of a computed length: a nanometre. Sums then equal the documented values."""


def bounded(default: float, low: float, high: float, unit: str, meaning: str) -> Any:  # noqa: ANN401 - a dataclass field
    """Declare a number with default, limits, unit and meaning, for the reference of robot files."""
    return field(default=default, metadata={"range": (low, high), "unit": unit, "meaning": meaning})


def _limited(low: float, high: float, unit: str, meaning: str) -> Any:  # noqa: ANN401 - a dataclass field
    """Declare a number with limits, unit and meaning, but without a default."""
    return field(metadata={"range": (low, high), "unit": unit, "meaning": meaning})


@dataclass(frozen=True, slots=True)
class RangerMount:
    """Mount and limits of a range sensor.

    Positions are in the body frame: x forward, y left, from the axle's centre.
    """

    x_m: float = _limited(-1.0, 1.0, "m", "position ahead of the axle's centre")
    y_m: float = _limited(-1.0, 1.0, "m", "position left of the axle's centre")
    yaw_rad: float = _limited(
        -2 * math.pi, 2 * math.pi, "rad", "direction of the beam, counter-clockwise from ahead"
    )
    min_range_m: float = _limited(0.0, 10.0, "m", "shortest distance that is measured correctly")
    max_range_m: float = _limited(0.01, 20.0, "m", "longest distance that is measured")
    cone_rad: float = bounded(0.0, 0.0, math.pi, "rad", "full opening angle; 0 for a beam")
    scale: float = bounded(
        1.0, 0.5, 2.0, "1", "range = `scale` · raw range + `offset_m`; from `calibrate range`"
    )
    offset_m: float = bounded(0.0, -0.2, 0.2, "m", "see `scale`")
    fitted: bool = field(
        default=True,
        metadata={"meaning": "whether the robot has this sensor; else it reads nothing"},
    )

    @property
    def centre_distance_m(self) -> float:
        """Distance of the sensor from the axle's centre, m."""
        return math.hypot(self.x_m, self.y_m)

    def contact_range_m(self, radius_m: float) -> float:
        """Return the range of a flat wall in contact that is orthogonal to the beam, m."""
        return radius_m - self.x_m * math.cos(self.yaw_rad) - self.y_m * math.sin(self.yaw_rad)

    def stop_range_m(self, radius_m: float, gap_m: float) -> float:
        """Return the range of such a wall with a gap to the rim, m; at least the minimum range."""
        range_m = max(self.contact_range_m(radius_m), self.min_range_m) + gap_m
        return round(range_m, _DECIMALS)


def _ultrasonic() -> RangerMount:
    return RangerMount(0.12, 0.0, 0.0, 0.02, 4.0, math.radians(15.0))


def _infrared_left() -> RangerMount:
    return RangerMount(0.05, 0.10, math.pi / 2, 0.04, 0.30)


def _infrared_right() -> RangerMount:
    return RangerMount(0.05, -0.10, -math.pi / 2, 0.04, 0.30)


MISSING_SENSOR_EFFECTS = {
    "ultrasonic": (
        "the robot detects a new obstacle only by contact, at cruise speed, and does not detect "
        "slip of both wheels"
    ),
    "infrared_left": (
        "a wall on the left is followed by repeated contacts, and no wall on the left "
        "corrects the pose"
    ),
    "infrared_right": (
        "a wall on the right is followed by repeated contacts, and no wall on the right "
        "corrects the pose"
    ),
}
"""Consequence of a missing range sensor."""


@dataclass(frozen=True, slots=True)
class RobotModel:
    """Robot parameters. Host and virtual device must use the same values."""

    name: str = field(default="sweeper", metadata={"meaning": "name for people"})
    robot_diameter_m: float = bounded(
        0.32, 0.05, 2.0, "m", "diameter of the footprint: Φ of the paper's Table 1"
    )
    cleaning_width_m: float = bounded(
        0.16, 0.02, 2.0, "m", "width of the mouth: W of the paper's Table 1"
    )
    mouth_offset_m: float = bounded(0.0, -1.0, 1.0, "m", "distance of the mouth ahead of the axle")
    cruise_speed_m_s: float = bounded(0.20, 0.01, 2.0, "m/s", "usual speed on a lane")
    max_speed_m_s: float = bounded(0.30, 0.01, 2.0, "m/s", "highest speed that is commanded")
    max_accel_m_s2: float = bounded(0.40, 0.01, 10.0, "m/s²", "limit of acceleration and braking")
    max_yaw_rate_rad_s: float = bounded(2.0, 0.05, 20.0, "rad/s", "highest yaw rate")
    max_yaw_accel_rad_s2: float = bounded(
        8.0, 0.05, 100.0, "rad/s²", "limit of the yaw acceleration"
    )
    wheel_diameter_m: float = bounded(
        0.065, 0.01, 1.0, "m", "mean of both wheels; D of the paper's eq. 3"
    )
    counts_per_turn: int = bounded(
        1560, 4, 1_000_000, "count", "encoder counts per wheel turn, after ×4: n of eq. 3"
    )
    wheel_base_m: float = bounded(
        0.23, 0.02, 2.0, "m", "distance between the wheels' contact points: B of eq. 4"
    )
    ultrasonic: RangerMount = field(
        default_factory=_ultrasonic, metadata={"meaning": "range sensor that faces forward"}
    )
    infrared_left: RangerMount = field(
        default_factory=_infrared_left, metadata={"meaning": "range sensor that faces left"}
    )
    infrared_right: RangerMount = field(
        default_factory=_infrared_right, metadata={"meaning": "range sensor that faces right"}
    )
    battery_v: float = bounded(16.0, 3.0, 60.0, "V", "voltage of the full battery")
    battery_ah: float = bounded(9.0, 0.1, 200.0, "Ah", "capacity of the battery")
    driver_drop_v: float = bounded(
        1.9, 0.0, 5.0, "V", "voltage drop of the motor driver, both legs together (L298N)"
    )
    wheel_ratio: float = bounded(
        1.0, 0.8, 1.25, "1", "right wheel's diameter over the left's (Borenstein's E_d)"
    )
    gyro_bias_rad_s: float = bounded(
        0.0, -0.4, 0.4, "rad/s", "yaw rate of the gyro at rest, from `calibrate gyro`"
    )

    @property
    def radius_m(self) -> float:
        """Radius of the footprint, m."""
        return self.robot_diameter_m / 2.0

    @property
    def mouth_reach_m(self) -> float:
        """Distance from the axle's centre to the ends of the mouth, m."""
        return math.hypot(self.mouth_offset_m, 0.5 * self.cleaning_width_m)

    @property
    def fitted_rangers(self) -> dict[str, RangerMount]:
        """Every range sensor that the robot has, by its name in the robot file."""
        return {name: mount for name, mount in self.rangers.items() if mount.fitted}

    @property
    def rangers(self) -> dict[str, RangerMount]:
        """Every range sensor by its name in the robot file."""
        return {
            "ultrasonic": self.ultrasonic,
            "infrared_left": self.infrared_left,
            "infrared_right": self.infrared_right,
        }

    @property
    def metres_per_count(self) -> float:
        """Path of a wheel per encoder count, m (paper eq. 3 with N = 1)."""
        return math.pi * self.wheel_diameter_m / self.counts_per_turn

    @property
    def left_metres_per_count(self) -> float:
        """Path of the left wheel per encoder count, m (Borenstein's c_l = 2/(E_d + 1))."""
        return self.metres_per_count * 2.0 / (1.0 + self.wheel_ratio)

    @property
    def right_metres_per_count(self) -> float:
        """Path of the right wheel per encoder count, m (Borenstein's c_r = 2/(1/E_d + 1))."""
        return self.metres_per_count * 2.0 * self.wheel_ratio / (1.0 + self.wheel_ratio)
