"""Table of all imperfections of the virtual sweeper, by noise level.

A *tolerance* ``x`` is the spread of a part: its error is drawn once per device, uniform in ±x. A
*sigma* is a standard deviation; the error is drawn again for each reading. The description of each
other number defines its distribution.

A calibration at rest does not remove the whole gyro bias. The host measures the bias while the
robot stands, so a constant bias (``gyro_turn_on_deg_s``) has no effect. But vibration of gears and
brushes shifts the mean of a MEMS gyro (vibration rectification), and there is no vibration at rest.
``gyro_motion_bias_deg_s`` is this shift. It is present while the wheels turn, and its sign is drawn
once.

Later calibrations can measure three more errors: a slow random walk of the bias
(``gyro_bias_walk``), white noise as in the datasheet, and a change of the bias with temperature
(``gyro_tempco``). The board warms up by 6 °C (see the module ``imu``), at most by 0.02 °C/s. At the
level ``typical``, this changes the bias by at most 0.0016 °/s over a lane of 20 s in the first
minute. This is a sixth of the motion bias. After ten minutes the change is seven times smaller. The
level ``harsh`` also adds a random walk of the measured angle, only in motion.

Sources: MPU6050: InvenSense PS-MPU-6000A-00 rev. 3.4; ultrasonic: HC-SR04 user's manual
(ElecFreaks); infrared: Sharp GP2Y0A41SK0F, sheet OP13008EN. A limit in a datasheet describes the
worst part that is sold. A noise level with smaller values describes an average part.

The level ``none`` has no noise except quantisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

_BLOCK = 256


class UnknownNoiseLevelError(ValueError):
    """A noise level that is not in the table."""

    def __init__(self, name: str) -> None:
        """Store the requested name."""
        self.name = name
        super().__init__(f"noise level {name!r} is not one of {', '.join(NOISE_LEVELS)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseLevel:
    """One noise level; the defaults are the level ``none``."""

    name: str

    # Gyroscope (MPU6050, PS-MPU-6000A-00 section 6.1).
    gyro_density_deg_s_sqrt_hz: float = 0.0
    """One-sided white noise density of the gyro, °/s/√Hz; the datasheet gives 0.005 at 10 Hz."""
    gyro_turn_on_deg_s: float = 0.0
    """Tolerance of the gyro's bias at power-on per axis, °/s; the datasheet allows ±20."""
    gyro_motion_bias_deg_s: float = 0.0
    """Magnitude of the bias shift while the wheels turn, °/s; its sign is drawn once."""
    gyro_bias_walk_deg_s_sqrt_s: float = 0.0
    gyro_yaw_walk_deg_sqrt_s: float = 0.0
    """Random walk of the measured angle while the wheels turn, °/√s."""
    gyro_scale_error: float = 0.0
    """Relative tolerance of the gyro's scale per axis; ±3 % in the datasheet, less after
    calibration.
    """
    gyro_tempco_deg_s_c: float = 0.0
    """Tolerance per axis of the gyro bias' change with temperature, °/s per °C. The datasheet gives
    ±20 °/s over -40..85 °C, which is 0.16 °/s per °C if linear. The noise levels have the smaller
    values that remain after compensation in the firmware."""
    gyro_cross_axis: float = 0.0
    """Tolerance of the gyro's cross-axis sensitivity, for each of the six pairs of axes; ±2 % in
    the datasheet.
    """

    # Accelerometer (section 6.2).
    accel_density_ug_sqrt_hz: float = 0.0
    """White noise density of the accelerometer, µg/√Hz; 400 in the datasheet."""
    accel_bias_mg: float = 0.0
    """Tolerance of the accelerometer's bias per axis, mg; ±50 (x, y) and ±80 (z) in the datasheet.
    """
    accel_tempco_mg_c: float = 0.0
    """Tolerance per axis of the accelerometer bias' change with temperature, mg per °C. The
    datasheet gives ±35 mg (x, y) over 0..70 °C, which is 0.5 mg per °C."""
    accel_cross_axis: float = 0.0
    """Tolerance of the accelerometer's cross-axis sensitivity, for each pair of axes; ±2 % in the
    datasheet."""
    accel_vibration_mg: float = 0.0
    """Additional sigma of the accelerometer per axis while the wheels turn, mg."""
    imu_temperature_error_c: float = 0.0
    """Tolerance of the temperature register, °C. The datasheet gives ±1 °C from a straight line
    (section 6.3); the offset is not trimmed."""

    # Rangers.
    ultrasonic_sigma_m: float = 0.0
    ultrasonic_dropout: float = 0.0
    """Probability per ping (ultrasonic pulse) that an echo is missed."""
    ultrasonic_crosstalk: float = 0.0
    """Probability per ping that the sensor detects another sound as the echo; see the module
    ``ultrasonic``.
    """
    infrared_sigma_m: float = 0.0
    """Sigma of the infrared range at 10 cm from white paper, m. The output voltage is proportional
    to 1/d (d: distance) and its noise is constant, so the sigma in distance grows as d²."""
    infrared_reflectance_spread: float = 0.0
    """Maximum reduction of a surface's reflectance, compared with 0.9 for white paper. The
    reflectance of each wall and obstacle side is drawn once, uniformly. A grey card has a
    reflectance of 0.18."""

    # Wheels.
    wheel_diameter_error: float = 0.0
    """Relative tolerance of the wheel diameter, common to both wheels."""
    wheel_mismatch: float = 0.0
    """Relative tolerance of the difference between the wheel diameters. The left wheel is larger by
    half of the drawn difference, the right wheel smaller by half."""
    wheel_base_error: float = 0.0
    """Relative tolerance of the wheel base."""
    slip_mean: float = 0.0
    """Mean share of a wheel's travel that slip loses on the floor."""
    slip_sigma: float = 0.0
    """Sigma of the lost share per wheel, a random process with the correlation time
    ``SLIP_TIME_S``."""

    # Power.
    voltage_sigma_v: float = 0.0
    current_sigma_a: float = 0.0


SLIP_TIME_S = 0.3
"""Correlation time of the slip, s: about one turn of a wheel at cruise speed."""

WHITE_PAPER = 0.9
"""Reflectance of white paper, to which the infrared sensor's datasheet curve refers."""

NOISE_LEVELS: Mapping[str, NoiseLevel] = MappingProxyType(
    {
        level.name: level
        for level in (
            NoiseLevel(name="none"),
            # After 7 U-shaped cycles the paper's robot has an error of only 7 mm. This requires a
            # gyro bias of 0.0014 °/s after a rest of some seconds. With the datasheet's noise
            # density (0.005) such a calibration is impossible, so this level has 0.0015.
            NoiseLevel(
                name="paper",
                gyro_density_deg_s_sqrt_hz=0.0015,
                gyro_turn_on_deg_s=1.0,
                gyro_motion_bias_deg_s=0.0011,
                gyro_bias_walk_deg_s_sqrt_s=1e-5,
                gyro_scale_error=0.0002,
                gyro_tempco_deg_s_c=0.0002,
                gyro_cross_axis=0.002,
                accel_density_ug_sqrt_hz=400.0,
                accel_bias_mg=10.0,
                accel_tempco_mg_c=0.1,
                accel_cross_axis=0.002,
                accel_vibration_mg=5.0,
                imu_temperature_error_c=0.5,
                ultrasonic_sigma_m=0.001,
                infrared_sigma_m=0.0008,
                infrared_reflectance_spread=0.1,
                wheel_diameter_error=0.0005,
                wheel_mismatch=0.0005,
                wheel_base_error=0.001,
                slip_sigma=0.0005,
                voltage_sigma_v=0.01,
                current_sigma_a=0.002,
            ),
            NoiseLevel(
                name="typical",
                gyro_density_deg_s_sqrt_hz=0.005,
                gyro_turn_on_deg_s=3.0,
                gyro_motion_bias_deg_s=0.01,
                gyro_bias_walk_deg_s_sqrt_s=1e-4,
                gyro_scale_error=0.001,
                gyro_tempco_deg_s_c=0.004,
                gyro_cross_axis=0.01,
                accel_density_ug_sqrt_hz=400.0,
                accel_bias_mg=30.0,
                accel_tempco_mg_c=0.3,
                accel_cross_axis=0.01,
                accel_vibration_mg=15.0,
                imu_temperature_error_c=1.0,
                ultrasonic_sigma_m=0.003,
                ultrasonic_dropout=0.01,
                ultrasonic_crosstalk=0.001,
                infrared_sigma_m=0.0015,
                infrared_reflectance_spread=0.3,
                wheel_diameter_error=0.003,
                wheel_mismatch=0.002,
                wheel_base_error=0.005,
                slip_mean=0.001,
                slip_sigma=0.003,
                voltage_sigma_v=0.02,
                current_sigma_a=0.005,
            ),
            NoiseLevel(
                name="harsh",
                gyro_density_deg_s_sqrt_hz=0.01,
                gyro_turn_on_deg_s=10.0,
                gyro_motion_bias_deg_s=0.03,
                gyro_bias_walk_deg_s_sqrt_s=3e-4,
                # 0.3° per lane of 4 m, which takes 20 s at 0.20 m/s: 0.3 / √20.
                gyro_yaw_walk_deg_sqrt_s=0.067,
                gyro_scale_error=0.003,
                gyro_tempco_deg_s_c=0.02,
                gyro_cross_axis=0.02,
                accel_density_ug_sqrt_hz=600.0,
                accel_bias_mg=50.0,
                accel_tempco_mg_c=0.5,
                accel_cross_axis=0.02,
                accel_vibration_mg=40.0,
                imu_temperature_error_c=3.0,
                ultrasonic_sigma_m=0.008,
                ultrasonic_dropout=0.05,
                ultrasonic_crosstalk=0.01,
                infrared_sigma_m=0.004,
                infrared_reflectance_spread=0.7,
                wheel_diameter_error=0.01,
                wheel_mismatch=0.01,
                wheel_base_error=0.02,
                slip_mean=0.005,
                slip_sigma=0.02,
                voltage_sigma_v=0.05,
                current_sigma_a=0.02,
            ),
        )
    },
)


def noise_level(name: str) -> NoiseLevel:
    """Return a level by its name.

    Raises:
        UnknownNoiseLevelError: it is not in the table.

    """
    try:
        return NOISE_LEVELS[name]
    except KeyError:
        raise UnknownNoiseLevelError(name) from None


class Draws:
    """Single random values, drawn in blocks, because a single numpy draw is 10 times slower.

    Each part of the device has its own object with its own child generator. So an additional draw
    in one part does not change the random values of other parts.
    """

    __slots__ = ("_normals", "_rng", "_uniforms")

    def __init__(self, rng: np.random.Generator) -> None:
        """Use ``rng``; no other object may use it from now on."""
        self._rng = rng
        self._normals: list[float] = []
        self._uniforms: list[float] = []

    def normal(self) -> float:
        """Return the next standard normal value."""
        if not self._normals:
            self._normals = self._rng.standard_normal(_BLOCK).tolist()
        return self._normals.pop()

    def normals(self, count: int) -> list[float]:
        """Return the values of the next ``count`` calls of ``normal``."""
        drawn: list[float] = []
        while len(drawn) < count:
            waiting = self._normals or self._rng.standard_normal(_BLOCK).tolist()
            rest = max(0, len(waiting) - (count - len(drawn)))
            drawn += waiting[: rest - len(waiting) - 1 : -1]
            self._normals = waiting[:rest]
        return drawn

    def uniform(self) -> float:
        """Return the next value, uniform in [0, 1)."""
        if not self._uniforms:
            self._uniforms = self._rng.random(_BLOCK).tolist()
        return self._uniforms.pop()

    def tolerance(self, limit: float) -> float:
        """Return the next value, uniform in ±``limit``."""
        return limit * (2.0 * self.uniform() - 1.0)

    def sign(self) -> float:
        """Return +1 or -1, each with probability 1/2."""
        return 1.0 if self.uniform() < 0.5 else -1.0  # noqa: PLR2004 - even odds
