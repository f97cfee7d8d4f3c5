"""The robot's dimensions, limits and sensor mounts.

Defaults are the paper's values; where the paper is silent they are common parts of a
robot of this size. A robot file (TOML) may override any of them, see ``bridge.config``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any


def _in(default: float, low: float, high: float) -> Any:  # noqa: ANN401 - a dataclass field
    """A number with the range that a robot file may give it."""
    return field(default=default, metadata={"range": (low, high)})


def _limited(low: float, high: float) -> Any:  # noqa: ANN401 - a dataclass field
    """The same without a default."""
    return field(metadata={"range": (low, high)})


@dataclass(frozen=True, slots=True)
class RangerMount:
    """Where a range sensor sits and what it can see.

    Mount in the body frame (x forward, y left, from the axle's centre).
    """

    x_m: float = _limited(-1.0, 1.0)
    y_m: float = _limited(-1.0, 1.0)
    yaw_rad: float = _limited(-2 * math.pi, 2 * math.pi)
    min_range_m: float = _limited(0.0, 10.0)
    max_range_m: float = _limited(0.01, 20.0)
    cone_rad: float = _in(0.0, 0.0, math.pi)
    """Full opening angle; 0 for a beam."""
    scale: float = _in(1.0, 0.5, 2.0)
    offset_m: float = _in(0.0, -0.2, 0.2)
    """What the device makes of its raw range: scale · raw + offset, by ``calibrate range``."""

    @property
    def center_distance_m(self) -> float:
        """Distance of the sensor from the axle's centre."""
        return math.hypot(self.x_m, self.y_m)

    def hull_distance_m(self, radius_m: float) -> float:
        """Return the distance along the beam from the sensor to the rim, m.

        A wall in contact reads this. The mount must be inside the disc.
        """
        ahead_x, ahead_y = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        along = self.x_m * ahead_x + self.y_m * ahead_y
        across = self.x_m * ahead_y - self.y_m * ahead_x
        return math.sqrt(max(0.0, radius_m**2 - across**2)) - along


def _ultrasonic() -> RangerMount:
    return RangerMount(0.12, 0.0, 0.0, 0.02, 4.0, math.radians(15.0))


def _infrared_left() -> RangerMount:
    return RangerMount(0.05, 0.10, math.pi / 2, 0.04, 0.30)


def _infrared_right() -> RangerMount:
    return RangerMount(0.05, -0.10, -math.pi / 2, 0.04, 0.30)


@dataclass(frozen=True, slots=True)
class RobotModel:
    """Everything about the robot that the host and the virtual device must agree on."""

    name: str = "sweeper"
    robot_diameter_m: float = _in(0.32, 0.05, 2.0)
    """Φ of the paper's Table 1."""
    cleaning_width_m: float = _in(0.16, 0.02, 2.0)
    """W of the paper's Table 1."""
    mouth_offset_m: float = _in(0.0, -1.0, 1.0)
    """How far ahead of the axle the mouth sits."""
    cruise_speed_m_s: float = _in(0.20, 0.01, 2.0)
    max_speed_m_s: float = _in(0.30, 0.01, 2.0)
    max_accel_m_s2: float = _in(0.40, 0.01, 10.0)
    max_yaw_rate_rad_s: float = _in(2.0, 0.05, 20.0)
    max_yaw_accel_rad_s2: float = _in(8.0, 0.05, 100.0)
    wheel_diameter_m: float = _in(0.065, 0.01, 1.0)
    """D of eq. 3, which is not the D of the algorithm."""
    counts_per_turn: int = _in(1560, 4, 1_000_000)
    """n of eq. 3: encoder counts per wheel turn, after ×4."""
    wheel_base_m: float = _in(0.23, 0.02, 2.0)
    """B of eq. 4."""
    ultrasonic: RangerMount = field(default_factory=_ultrasonic)
    infrared_left: RangerMount = field(default_factory=_infrared_left)
    infrared_right: RangerMount = field(default_factory=_infrared_right)
    battery_v: float = _in(16.0, 3.0, 60.0)
    battery_ah: float = _in(9.0, 0.1, 200.0)
    driver_drop_v: float = _in(1.9, 0.0, 5.0)
    """L298N saturation voltage, both legs together."""
    wheel_ratio: float = _in(1.0, 0.8, 1.25)
    """Right wheel's diameter over the left's (Borenstein's E_d); their mean is the diameter."""
    gyro_bias_rad_s: float = _in(0.0, -0.4, 0.4)
    """Yaw rate of the gyro at rest by ``calibrate gyro``, rad/s; each run measures it again."""

    @property
    def radius_m(self) -> float:
        """Radius of the body's disc."""
        return self.robot_diameter_m / 2.0

    @property
    def mouth_reach_m(self) -> float:
        """Distance from the axle's centre to the ends of the mouth."""
        return math.hypot(self.mouth_offset_m, 0.5 * self.cleaning_width_m)

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
        """Wheel travel of one encoder count (eq. 3 with N = 1)."""
        return math.pi * self.wheel_diameter_m / self.counts_per_turn

    @property
    def left_metres_per_count(self) -> float:
        """The same of the left wheel (Borenstein's c_l = 2/(E_d + 1))."""
        return self.metres_per_count * 2.0 / (1.0 + self.wheel_ratio)

    @property
    def right_metres_per_count(self) -> float:
        """The same of the right wheel (c_r = 2/(1/E_d + 1))."""
        return self.metres_per_count * 2.0 * self.wheel_ratio / (1.0 + self.wheel_ratio)

    def wheel_speeds_m_s(self, v_m_s: float, yaw_rate_rad_s: float) -> tuple[float, float]:
        """Left and right wheel speed for a body velocity (inverse of eq. 4)."""
        half = 0.5 * self.wheel_base_m * yaw_rate_rad_s
        return v_m_s - half, v_m_s + half
