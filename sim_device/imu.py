"""MPU6050: register counts at ±2 g and ±250 °/s.

Source: InvenSense PS-MPU-6000A-00 rev. 3.4, sections 6.1-6.3, and the register map for the
temperature's formula. The chip sits at the axle's centre, its axes with the body's: x ahead,
y left, z up, yaw rate counter-clockwise positive.

A sample is the mean over the time since the last one, as the chip's low-pass filter at about
half the output rate gives it, so that nothing is lost between samples; a read within the same
millisecond returns the same registers. White noise of one-sided density n over an interval T
then has sigma n/√(2T). What the noise levels mean is told in ``noise``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_device.noise import Draws, NoiseLevel
    from sim_device.plant import Plant

ACCEL_LSB_PER_G = 16384.0
GYRO_LSB_PER_DEG_S = 131.0
TEMPERATURE_LSB_PER_C = 340.0
TEMPERATURE_OFFSET_C = 36.53
GRAVITY_M_S2 = 9.80665

_AMBIENT_C = 25.0
_WARMING_C = 6.0
"""How far the board warms above ambient ..."""
_WARMING_TIME_S = 300.0
_MOVING_RAD_S = 0.05
"""Mean wheel speed above which motion's own errors are present; 1.6 mm/s."""
_NOMINAL_MS = 10
"""The first sample, with nothing before it, is as noisy as at 100 Hz."""
_DEG = 180.0 / math.pi
_MIN, _MAX = -32768, 32767


class ImuCounts(NamedTuple):
    """The registers from ACCEL_XOUT on, in the chip's order."""

    accel_x: int
    accel_y: int
    accel_z: int
    temperature: int
    gyro_x: int
    gyro_y: int
    gyro_z: int


class Imu:
    """The chip, watching the plant."""

    def __init__(self, plant: Plant, noise: NoiseLevel, draws: Draws) -> None:
        """Draw this chip's own errors from ``draws``, which it owns."""
        self._plant = plant
        self._noise = noise
        self._draws = draws
        tolerance = draws.tolerance
        self._turn_on = tuple(tolerance(noise.gyro_turn_on_deg_s) for _ in range(3))
        self._motion_deg_s = draws.sign() * noise.gyro_motion_bias_deg_s
        self._scale = 1.0 + tolerance(noise.gyro_scale_error)
        self._accel_bias_g = tuple(tolerance(0.001 * noise.accel_bias_mg) for _ in range(3))
        self._walk_deg_s = 0.0
        self._set_interval(_NOMINAL_MS)
        self._before = plant.inertial
        self._last = self._sample(0.0, 0.0, 0.0, moving=False)

    def read(self) -> ImuCounts:
        """Read the registers as they stand at this tick."""
        now, before = self._plant.inertial, self._before
        elapsed_ms = now.tick_ms - before.tick_ms
        if elapsed_ms <= 0:
            return self._last
        if elapsed_ms != self._interval_ms:
            self._set_interval(elapsed_ms)
        rate = self._per_s
        turned_rad = abs(now.left_rad - before.left_rad) + abs(now.right_rad - before.right_rad)
        self._before = now
        self._last = self._sample(
            (now.heading_rad - before.heading_rad) * rate * _DEG,
            (now.impulse_x_m_s - before.impulse_x_m_s) * rate / GRAVITY_M_S2,
            (now.impulse_y_m_s - before.impulse_y_m_s) * rate / GRAVITY_M_S2,
            moving=turned_rad * rate > 2.0 * _MOVING_RAD_S,
        )
        return self._last

    def _set_interval(self, interval_ms: int) -> None:
        """Work out the sigmas of samples this far apart; they seldom change."""
        noise = self._noise
        interval_s = 0.001 * interval_ms
        self._interval_ms = interval_ms
        self._per_s = 1.0 / interval_s
        white = 1.0 / math.sqrt(2.0 * interval_s)
        self._gyro_sigma = noise.gyro_density_deg_s_sqrt_hz * white
        self._walk_sigma = noise.gyro_bias_walk_deg_s_sqrt_s * math.sqrt(interval_s)
        self._yaw_sigma = noise.gyro_yaw_walk_deg_sqrt_s / math.sqrt(interval_s)
        self._rest_g = 1e-6 * noise.accel_density_ug_sqrt_hz * white
        self._moving_g = math.hypot(self._rest_g, 0.001 * noise.accel_vibration_mg)

    def _sample(
        self, yaw_deg_s: float, accel_x_g: float, accel_y_g: float, *, moving: bool
    ) -> ImuCounts:
        normal, gyro_sigma = self._draws.normal, self._gyro_sigma
        self._walk_deg_s += self._walk_sigma * normal()
        # Drawn whether moving or not, so that the stream stays in step with the samples.
        yaw_walk = self._yaw_sigma * normal()
        turn_on_x, turn_on_y, turn_on_z = self._turn_on
        yaw_deg_s = yaw_deg_s * self._scale + turn_on_z + self._walk_deg_s
        accel_sigma = self._rest_g
        if moving:
            yaw_deg_s += self._motion_deg_s + yaw_walk
            accel_sigma = self._moving_g
        bias_x_g, bias_y_g, bias_z_g = self._accel_bias_g
        warm_c = _WARMING_C * (1.0 - math.exp(-0.001 * self._plant.tick_ms / _WARMING_TIME_S))
        return ImuCounts(
            _counts((accel_x_g + bias_x_g + accel_sigma * normal()) * ACCEL_LSB_PER_G),
            _counts((accel_y_g + bias_y_g + accel_sigma * normal()) * ACCEL_LSB_PER_G),
            _counts((1.0 + bias_z_g + accel_sigma * normal()) * ACCEL_LSB_PER_G),
            _counts((_AMBIENT_C + warm_c - TEMPERATURE_OFFSET_C) * TEMPERATURE_LSB_PER_C),
            _counts((turn_on_x + gyro_sigma * normal()) * GYRO_LSB_PER_DEG_S),
            _counts((turn_on_y + gyro_sigma * normal()) * GYRO_LSB_PER_DEG_S),
            _counts((yaw_deg_s + gyro_sigma * normal()) * GYRO_LSB_PER_DEG_S),
        )


def _counts(value: float) -> int:
    """Round to a register, saturating as the chip does."""
    counts = round(value)
    if counts > _MAX:
        return _MAX
    return counts if counts > _MIN else _MIN  # noqa: FURB136 - seven times a sample: no call
