"""Model of the MPU6050: register counts for a configuration; default ±2 g, ±250 °/s, 100 Hz.

Sources: InvenSense PS-MPU-6000A-00 rev. 3.4 (the datasheet), sections 6.1 (gyroscope), 6.2
(accelerometer), 6.3 (temperature); RM-MPU-6000A-00 rev. 4.2 (the register map), sections 4.2
(sample rate), 4.3 (filter), 4.4 and 4.5 (ranges), 4.18 (temperature). The chip is at the axle's
centre. Its axes are the body's axes: x ahead, y left, z up; the yaw rate is positive
counter-clockwise.

The registers change at the output rate. A read before the next sample returns the same values. The
low-pass filter is modelled as a running mean over twice the chip's group delay, so its delay is
exact. With the default settings the window of 9.6 ms is about the time between samples, so the
motion between two samples is not lost. If the firmware reads less often than the chip samples, it
averages the chip's buffer (section 7.17), so a reading is the mean since the previous reading.
White noise with the one-sided density n then has the sigma n/√(2T) over a time T. If the filter's
window is shorter than the sample time, the noise is greater by the square root of the ratio. The
plant provides only the mean motion in a reading's interval, so a faster filter does not add detail.

The module ``noise`` defines the noise levels. The model omits three effects: the change of scale
with temperature, the non-linearity of the scale (0.2 %), and the gyro's response to acceleration
(0.1 °/s per g; with constant gravity this is a part of the bias).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from protocol.imu import GRAVITY_M_S2, NOMINAL, ImuScale
from sim_device.body.lift import Lift
from sim_device.sensors.faults import SensorFaults
from sim_device.sensors.imu_kernel import AXES, DRAWS, ImuChip, sample

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_device.body.plant import Plant
    from sim_device.body.truth import Inertial
    from sim_device.noise import NoiseLevel

GYRO_LSB_PER_DEG_S = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
"""Gyro scale for each full-scale range (°/s), counts per °/s: FS_SEL 0 to 3, section 6.1."""
ACCEL_LSB_PER_G = {2: 16384.0, 4: 8192.0, 8: 4096.0, 16: 2048.0}
"""Accelerometer scale for each full-scale range (g), counts per g: AFS_SEL 0 to 3, section 6.2."""
GYRO_DELAY_MS = (0.98, 1.9, 2.8, 4.8, 8.3, 13.4, 18.6)
"""Group delay of the gyro for each filter setting DLPF_CFG, ms (register map, section 4.3). The
accelerometer's delay differs by at most 0.9 ms."""
AMBIENT_C = 25.0
WARMING_C = 6.0
"""Temperature rise of the board above ambient, °C, with the time constant
``imu_kernel.WARMING_TIME_S``. It is an assumption for 1.5 W under a cover."""

_BLOCK = 512 * DRAWS
_DEG = 180.0 / math.pi
_new = tuple.__new__
_EIGHTHS = 8
"""Number of samples of the unfiltered gyro (8 kHz) per millisecond."""


class ImuConfigError(ValueError):
    """A setting that the chip does not have."""

    def __init__(self, setting: str, value: int, known: str) -> None:
        """Store the setting, its value and the valid values."""
        self.setting, self.value, self.known = setting, value, known
        super().__init__(f"{setting} {value} is not one of {known}")


@dataclass(frozen=True, slots=True)
class ImuConfig:
    """Settings that the firmware writes into the chip at its start.

    Raises:
        ImuConfigError: the chip does not have a setting.

    """

    gyro_range_deg_s: int = 250
    accel_range_g: int = 2
    dlpf: int = 3
    """Filter setting DLPF_CFG, 0 to 6; 3 is a bandwidth of 42 Hz."""
    divider: int = 9
    """Sample rate divider SMPLRT_DIV, 0 to 255; 9 is 100 Hz with a filter."""

    def __post_init__(self) -> None:
        """Check each setting."""
        if self.gyro_range_deg_s not in GYRO_LSB_PER_DEG_S:
            raise ImuConfigError("gyro range", self.gyro_range_deg_s, "250, 500, 1000, 2000")
        if self.accel_range_g not in ACCEL_LSB_PER_G:
            raise ImuConfigError("accelerometer range", self.accel_range_g, "2, 4, 8, 16")
        if not 0 <= self.dlpf < len(GYRO_DELAY_MS):
            raise ImuConfigError("DLPF_CFG", self.dlpf, "0 to 6")
        if not 0 <= self.divider <= 0xFF:  # noqa: PLR2004 - a byte
            raise ImuConfigError("SMPLRT_DIV", self.divider, "0 to 255")

    @property
    def sample_period_ms(self) -> float:
        """Time between samples, ms: (1 + SMPLRT_DIV) / 1 kHz, or / 8 kHz without the filter."""
        return (1 + self.divider) / (1.0 if self.dlpf else 8.0)

    @property
    def scale(self) -> ImuScale:
        """Scale of the counts; the temperature scale is in section 4.18 of the register map."""
        return ImuScale(
            Fraction(ACCEL_LSB_PER_G[self.accel_range_g]),
            Fraction(str(GYRO_LSB_PER_DEG_S[self.gyro_range_deg_s])),
            NOMINAL.per_k,
            NOMINAL.zero_deg_c,
        )

    @property
    def window_ms(self) -> float:
        """Return the length of the running mean that models the filter, ms."""
        return 2.0 * GYRO_DELAY_MS[self.dlpf]


_CONFIG = ImuConfig()


class ImuCounts(NamedTuple):
    """The registers from ACCEL_XOUT on, in the chip's order."""

    accel_x: int
    accel_y: int
    accel_z: int
    temperature: int
    gyro_x: int
    gyro_y: int
    gyro_z: int


class ImuSensor:
    """The chip, mounted on the plant."""

    def __init__(
        self,
        plant: Plant,
        noise: NoiseLevel,
        rng: np.random.Generator,
        faults: SensorFaults | None = None,
        config: ImuConfig = _CONFIG,
    ) -> None:
        """Draw this chip's errors from ``rng``, which no other object may use; apply ``faults``."""
        self._plant = plant
        self._noise = noise
        self._rng = rng
        self._faults = faults or SensorFaults()
        self._lift = Lift()
        self._alias = math.sqrt(max(1.0, config.sample_period_ms / config.window_ms))
        self._period_eighths = round(_EIGHTHS * config.sample_period_ms)
        self._bias, self._extra = np.zeros(AXES), np.zeros(AXES)
        """Offsets added to each axis: the bias including faults, and the effect of lifting."""
        self._chip = _drawn_chip(noise, rng, config, self._bias, self._extra)
        self._own_bias = self._bias.copy()
        self._reported_bias: tuple[object, object] = (None, None)
        self._normals = np.empty(_BLOCK)
        self._at = _BLOCK
        self._interval_ms = 0
        self._set_interval(max(1, round(config.sample_period_ms)))
        now = plant.inertial
        self._chip.begin(*now[1:])
        self._was_ms = now.tick_ms
        self._sample_no = _EIGHTHS * plant.tick_ms // self._period_eighths
        self._last = self._reported = self._sample(now)
        self.samples = 1
        """Number of samples that the firmware has read."""

    def read(self) -> ImuCounts:
        """Return the registers at this tick."""
        plant = self._plant
        tick_ms = plant.tick_ms
        eighths = _EIGHTHS * tick_ms
        if self._faults.imu_clock:
            eighths = int(eighths * (1.0 + self._faults.imu_clock))
        sample_no = eighths // self._period_eighths
        if sample_no != self._sample_no and not self._faults.i2c_stuck:
            self._sample_no = sample_no
            self.samples += 1
            interval_ms = tick_ms - self._was_ms
            if interval_ms != self._interval_ms:
                self._set_interval(interval_ms)
            self._was_ms = tick_ms
            self._last = self._sample(plant.inertial)
        if not self._faults.imu_frozen:
            self._reported = self._last
        return self._reported

    def _sample(self, now: Inertial) -> ImuCounts:
        at = self._at
        if at >= _BLOCK:
            self._rng.standard_normal(out=self._normals)
            at = 0
        self._at = at + DRAWS
        if self._faults.changed or self._lift.active:
            self._obey(now.tick_ms)
        return _new(ImuCounts, sample(self._chip, self._normals, at, *now))

    def _obey(self, tick_ms: int) -> None:
        faults = self._faults
        if faults.lifted or self._lift.active:
            self._feel_lift(tick_ms)
        else:
            faults.changed = False
        gyro, accel = self._reported_bias
        if faults.gyro_bias_deg_s != gyro or faults.accel_bias_g != accel:
            self._obey_bias()

    def _feel_lift(self, tick_ms: int) -> None:
        self._extra[:] = self._lift.felt(tick_ms, self._interval_ms, lifted=self._faults.lifted)

    def _obey_bias(self) -> None:
        faults = self._faults
        self._reported_bias = (faults.gyro_bias_deg_s, faults.accel_bias_g)
        self._bias[:] = self._own_bias + np.array((*faults.accel_bias_g, *faults.gyro_bias_deg_s))

    def _set_interval(self, interval_ms: int) -> None:
        """Compute the noise for a sample interval; the interval rarely changes."""
        noise, chip = self._noise, self._chip
        interval_s = 0.001 * interval_ms
        self._interval_ms = interval_ms
        rate = 1.0 / interval_s
        chip.interval_ms, chip.per_s = interval_ms, rate
        chip.per_g, chip.per_deg = rate / GRAVITY_M_S2, rate * _DEG
        white = self._alias / math.sqrt(2.0 * interval_s)
        chip.sigma_deg_s = noise.gyro_density_deg_s_sqrt_hz * white
        rest_g = 1e-6 * noise.accel_density_ug_sqrt_hz * white
        chip.rest_sigma_g = rest_g
        chip.moving_sigma_g = math.hypot(rest_g, 0.001 * noise.accel_vibration_mg)
        chip.walk_sigma_deg_s = noise.gyro_bias_walk_deg_s_sqrt_s * math.sqrt(interval_s)
        chip.yaw_sigma_deg_s = noise.gyro_yaw_walk_deg_sqrt_s / math.sqrt(interval_s)


def _drawn_chip(
    noise: NoiseLevel,
    rng: np.random.Generator,
    config: ImuConfig,
    bias: NDArray[np.float64],
    extra: NDArray[np.float64],
) -> ImuChip:
    """Draw the errors of a chip in a fixed order; append new draws at the end.

    The function fills ``bias``. The chip stores references to ``bias`` and ``extra``.
    """

    def tolerance(limit: float, *shape: int) -> NDArray[np.float64]:
        return limit * rng.uniform(-1.0, 1.0, shape or None)

    accel_bias_g = tolerance(0.001 * noise.accel_bias_mg, 3)
    turn_on_deg_s = tolerance(noise.gyro_turn_on_deg_s, 3)
    bias[:] = (*accel_bias_g, *turn_on_deg_s)
    motion_deg_s = math.copysign(noise.gyro_motion_bias_deg_s, rng.uniform(-1.0, 1.0))
    scale = tolerance(noise.gyro_scale_error, 3)
    accel_tempco = tolerance(0.001 * noise.accel_tempco_mg_c, 3)
    gyro_tempco = tolerance(noise.gyro_tempco_deg_s_c, 3)
    accel = tolerance(noise.accel_cross_axis, 3, 3)
    gyro = tolerance(noise.gyro_cross_axis, 3, 3)
    np.fill_diagonal(accel, 1.0)
    np.fill_diagonal(gyro, 1.0 + scale)
    tempco = np.concatenate([accel_tempco, gyro_tempco])
    chip = ImuChip(np.vstack([accel, gyro]), bias, tempco, extra)
    chip.motion_deg_s = motion_deg_s
    chip.temperature_error_c = float(tolerance(noise.imu_temperature_error_c))
    chip.lsb_accel = ACCEL_LSB_PER_G[config.accel_range_g]
    chip.lsb_gyro = GYRO_LSB_PER_DEG_S[config.gyro_range_deg_s]
    chip.window_ms = config.window_ms
    chip.ambient_c, chip.warming_c = AMBIENT_C, WARMING_C
    return chip
