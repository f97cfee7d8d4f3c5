"""Contact of the wheels with the floor: wheel sizes, slip, carpets and thresholds."""

from __future__ import annotations

from math import cos, sin
from typing import TYPE_CHECKING

import numpy as np

from bridge.floor_plan.floor_plan import contains
from protocol.imu import GRAVITY_M_S2
from sim_device.body.drive_kernel import SLIP_DRAWS, SLOW_MS, TICK_S, tread
from sim_device.noise import SLIP_TIME_S, Draws
from sim_device.world.carpets import carpet_under
from sim_device.world.thresholds import Climb, Stance, climb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import Polygon
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from sim_device.body.chassis import Chassis
    from sim_device.body.drive_kernel import Body
    from sim_device.noise import NoiseLevel
    from sim_device.world.world import World

_FADE = SLOW_MS * TICK_S / SLIP_TIME_S
_FASTEST_M_TICK = 0.005
"""Maximum motion of the robot in a millisecond, m, even if a walking person pushes it."""
_PERIODS = SLIP_DRAWS // 2


class Footing:
    """Computes, for the kernels, each wheel's drag and travel per radian on the present floor."""

    def __init__(  # noqa: PLR0913, PLR0917 - the parts of a robot
        self,
        model: RobotModel,
        chassis: Chassis,
        noise: NoiseLevel,
        parts: Draws,
        slip: Draws,
        body: Body,
    ) -> None:
        """Draw wheel sizes from ``parts``; no other object may use the generator ``slip``."""
        common = 1.0 + parts.tolerance(noise.wheel_diameter_error)
        skew = 0.5 * parts.tolerance(noise.wheel_mismatch)
        nominal_m = 0.5 * model.wheel_diameter_m
        self.left_radius_m = nominal_m * common * (1.0 + skew)
        self.right_radius_m = nominal_m * common * (1.0 - skew)
        self.wheel_base_m = model.wheel_base_m * (1.0 + parts.tolerance(noise.wheel_base_error))
        self.pitch_rad = self.roll_rad = self.climb_m_s = 0.0
        self.fallen = False
        """True: a wheel hangs over a cliff, and the robot lies on its underside."""
        self.periods_left = 0
        """Number of 10 ms periods for which random slip values are left."""
        self._normals = slip.normals
        self._felt = Climb()
        self._felt_before_m = 0.0
        weight_n = chassis.mass_kg * GRAVITY_M_S2
        share = chassis.wheel_share
        self._stance = Stance(
            self.wheel_base_m,
            nominal_m,
            chassis.caster_x_m,
            chassis.caster_radius_m,
            0.5 * weight_n * share,
            weight_n * (1.0 - share),
        )
        self._b = b = body
        b.wheel_base_m = self.wheel_base_m
        b.left.radius_m, b.right.radius_m = self.left_radius_m, self.right_radius_m
        b.slip_kick = noise.slip_sigma * (2.0 * _FADE) ** 0.5
        b.slip_fade, b.unslipped = _FADE, 1.0 - noise.slip_mean
        tread(b)

    def set_extra_slip(self, left: float, right: float) -> None:
        """Set the additional share of its travel that each wheel loses."""
        self._b.left.extra_slip, self._b.right.extra_slip = left, right
        tread(self._b)

    def draw(self) -> None:
        """Draw new random slip values for the body."""
        used = self._b.draws_used()
        if used and self._b.slip_kick > 0.0:
            self._b.take_draws(np.array(self._normals(used)))
        self.periods_left = _PERIODS

    def look(self, world: World, pose: Pose2) -> bool:
        """Find the carpet and the floor under the wheels; call it after every ``SLOW_MS``.

        Returns:
            True if ``fallen`` changed: the robot fell, or its wheels have floor under them again.

        """
        x_m, y_m, theta_rad = pose
        carpets, cliffs, half_m = world.carpets, world.plan.cliffs, 0.5 * self.wheel_base_m
        if len(carpets):
            dx, dy = -half_m * sin(theta_rad), half_m * cos(theta_rad)
            left, right = self._b.left, self._b.right
            left.carpet_n, left.carpet_slip = carpet_under(x_m + dx, y_m + dy, carpets)
            right.carpet_n, right.carpet_slip = carpet_under(x_m - dx, y_m - dy, carpets)
            tread(self._b)
        was = self.fallen
        if cliffs or was:
            self.fallen = wheel_over(pose, half_m, cliffs)
        return self.fallen != was

    def on_thresholds(self, thresholds: NDArray[np.float64]) -> int:
        """Compute the effect of thresholds; return for how many milliseconds it is valid."""
        felt, b = self._felt, self._b
        climb(b.x_m, b.y_m, b.theta_rad, self._stance, thresholds, felt)
        b.left.slope_n, b.right.slope_n = felt.load_left_n, felt.load_right_n
        self._tilt(felt.pitch_rad, felt.roll_rad)
        height_m = felt.height_m
        self.climb_m_s = (height_m - self._felt_before_m) / TICK_S
        self._felt_before_m = height_m
        return 1 + int(min(felt.away_m, 1.0) / _FASTEST_M_TICK)

    def off_floor(self) -> None:
        """Remove every effect of the floor."""
        for wheel in (self._b.left, self._b.right):
            wheel.slope_n = wheel.carpet_n = wheel.carpet_slip = 0.0
        self._felt_before_m = self.climb_m_s = 0.0
        self._tilt(0.0, 0.0)

    def _tilt(self, pitch_rad: float, roll_rad: float) -> None:
        self.pitch_rad, self.roll_rad = pitch_rad, roll_rad
        self._b.tilt_x_m_s2 = GRAVITY_M_S2 * sin(pitch_rad)
        self._b.tilt_y_m_s2 = GRAVITY_M_S2 * sin(roll_rad)


def wheel_over(pose: Pose2, half_base_m: float, cliffs: tuple[Polygon, ...]) -> bool:
    """Return whether the floor is missing under either wheel of a robot at ``pose``."""
    wheels = (pose.transform(0.0, half_base_m), pose.transform(0.0, -half_base_m))
    return any(contains(cliff, *wheel) for wheel in wheels for cliff in cliffs)
