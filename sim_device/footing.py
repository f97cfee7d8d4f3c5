"""How the wheels stand on the floor: their sizes, slip, carpets and thresholds."""

from __future__ import annotations

from math import cos, sin
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.geometry import Pose2
from sim_device import drive_kernel as k
from sim_device.cliff import wheel_over
from sim_device.drive_kernel import TICK_S
from sim_device.noise import SLIP_TIME_S, Draws
from sim_device.terrain import AWAY, HEIGHT, LOAD_LEFT, LOAD_RIGHT, PITCH, ROLL, carpet_under, climb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel
    from sim_device.chassis import Chassis
    from sim_device.noise import NoiseLevel
    from sim_device.world import World

    Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
SLOW_S = 0.01
"""Period of ``renew``."""
_FADE = SLOW_S / SLIP_TIME_S
_TRAVEL_L, _TRAVEL_R, _YAW_L, _YAW_R = k.TRAVEL_L, k.TRAVEL_R, k.YAW_L, k.YAW_R
_FASTEST_M_TICK = 0.005
"""Nothing moves the robot faster than this in a millisecond, a walker who pushes it included."""


class Footing:
    """Gives the kernel what a radian of each wheel is worth, and what holds it back."""

    def __init__(  # noqa: PLR0913, PLR0917 - a robot's parts
        self,
        model: RobotModel,
        chassis: Chassis,
        noise: NoiseLevel,
        parts: Draws,
        slip: Draws,
        parameters: Floats,
    ) -> None:
        """Draw this robot's wheels from ``parts`` and its slip from ``slip``, which it owns."""
        common = 1.0 + parts.tolerance(noise.wheel_diameter_error)
        skew = 0.5 * parts.tolerance(noise.wheel_mismatch)
        nominal_m = 0.5 * model.wheel_diameter_m
        self.left_radius_m = nominal_m * common * (1.0 + skew)
        self.right_radius_m = nominal_m * common * (1.0 - skew)
        self.wheel_base_m = model.wheel_base_m * (1.0 + parts.tolerance(noise.wheel_base_error))
        self.left_m = self.right_m = 0.0
        """Half of each wheel's travel over the floor per radian, slip taken off."""
        self.pitch_rad = self.roll_rad = self.climb_m_s = 0.0
        self.fallen = False
        """Whether a wheel hangs over a cliff: the body lies on its belly."""
        self._mean = noise.slip_mean
        self._normal = slip.normal
        self._kick = noise.slip_sigma * (2.0 * _FADE) ** 0.5
        self._slip_left = self._slip_right = 0.0
        self._carpet = (0.0, 0.0)
        self._extra = (0.0, 0.0)
        weight_n = chassis.mass_kg * GRAVITY_M_S2
        share = chassis.wheel_share
        self._stance = np.array(
            [
                self.wheel_base_m,
                nominal_m,
                chassis.caster_x_m,
                chassis.caster_radius_m,
                0.5 * weight_n * share,
                weight_n * (1.0 - share),
            ],
        )
        self._felt = np.zeros(6)
        self._felt_before_m = 0.0
        self._p = parameters
        parameters[k.WHEEL_BASE] = self.wheel_base_m
        self._set_step()

    def set_extra_slip(self, left: float, right: float) -> None:
        """Let each wheel lose this share more of its travel."""
        self._extra = left, right
        self._set_step()

    def renew(self, world: World, x_m: float, y_m: float, theta_rad: float) -> bool:
        """Let the slip wander, and look what the wheels stand on; once every ``SLOW_S``.

        Returns:
            Whether the robot fell, or has floor under its wheels again: ``fallen`` changed.

        """
        kick, normal, carpets = self._kick, self._normal, world.carpets
        if kick > 0.0:
            self._slip_left += kick * normal() - _FADE * self._slip_left
            self._slip_right += kick * normal() - _FADE * self._slip_right
        if len(carpets):
            half = 0.5 * self.wheel_base_m
            dx, dy = -half * sin(theta_rad), half * cos(theta_rad)
            left_n, left = carpet_under(x_m + dx, y_m + dy, carpets)
            right_n, right = carpet_under(x_m - dx, y_m - dy, carpets)
            self._carpet = left, right
            self._p[k.CARPET_N_L], self._p[k.CARPET_N_R] = left_n, right_n
            self._set_step()
        elif kick > 0.0:
            self._set_step()
        was, cliffs = self.fallen, world.plan.cliffs
        if not (cliffs or was):
            return False
        self.fallen = wheel_over(Pose2(x_m, y_m, theta_rad), 0.5 * self.wheel_base_m, cliffs)
        return self.fallen != was

    def on_thresholds(self, thresholds: Floats, state: Floats) -> int:
        """Feel the thresholds for the next millisecond; give how many it holds for."""
        felt = self._felt
        climb(state[k.X], state[k.Y], state[k.THETA], self._stance, thresholds, felt)
        p = self._p
        p[k.SLOPE_N_L], p[k.SLOPE_N_R] = felt[LOAD_LEFT], felt[LOAD_RIGHT]
        self._tilt(float(felt[PITCH]), float(felt[ROLL]))
        height_m = float(felt[HEIGHT])
        self.climb_m_s = (height_m - self._felt_before_m) / TICK_S
        self._felt_before_m = height_m
        return 1 + int(min(felt[AWAY], 1.0) / _FASTEST_M_TICK)

    def off_floor(self) -> None:
        """Feel nothing of the floor any more."""
        p = self._p
        p[k.SLOPE_N_L] = p[k.SLOPE_N_R] = p[k.CARPET_N_L] = p[k.CARPET_N_R] = 0.0
        self._felt_before_m = self.climb_m_s = 0.0
        self._carpet = (0.0, 0.0)
        self._tilt(0.0, 0.0)

    def _tilt(self, pitch_rad: float, roll_rad: float) -> None:
        self.pitch_rad, self.roll_rad = pitch_rad, roll_rad
        self._p[k.TILT_X] = GRAVITY_M_S2 * sin(pitch_rad)
        self._p[k.TILT_Y] = GRAVITY_M_S2 * sin(roll_rad)

    def _set_step(self) -> None:
        whole = 1.0 - self._mean
        (carpet_left, carpet_right), (extra_left, extra_right) = self._carpet, self._extra
        left = whole - self._slip_left - carpet_left - extra_left
        right = whole - self._slip_right - carpet_right - extra_right
        left_m = self.left_radius_m * left if left > 0.0 else 0.0
        right_m = self.right_radius_m * right if right > 0.0 else 0.0
        base, p = self.wheel_base_m, self._p
        p[_TRAVEL_L] = self.left_m = 0.5 * left_m
        p[_TRAVEL_R] = self.right_m = 0.5 * right_m
        p[_YAW_L] = left_m / base
        p[_YAW_R] = right_m / base
