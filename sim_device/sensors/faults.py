"""Faults of the sensors, which may change during a run; by default there are none."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim_device.change_flag import ChangeFlag

_HALF_WRAP, _MASK = 0x8000, 0xFFFF


@dataclass(slots=True)
class SensorFaultValues:
    """Parameters of the sensor faults; by default there is no fault."""

    imu_frozen: bool = False
    """True: the registers repeat their last content."""
    gyro_bias_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Bias added to the rates x, y, z before saturation, °/s."""
    accel_bias_g: tuple[float, float, float] = (0.0, 0.0, 0.0)
    encoder_dropout_left: float = 0.0
    """Share of the left encoder's counts that is lost, 0..1, in both directions. Lost counts are
    not recovered."""
    encoder_dropout_right: float = 0.0
    encoder_reversed_left: bool = False
    """True: the two channels of the left encoder are exchanged, and it counts backwards."""
    encoder_reversed_right: bool = False
    encoders_swapped: bool = False
    """True: the plugs of both encoders are exchanged."""
    i2c_stuck: bool = False
    """True: the I2C bus to the inertial sensor is stuck, and no new sample arrives."""
    imu_clock: float = 0.0
    """Relative error of the inertial sensor's own clock; positive if the clock is fast."""
    adc_frozen: bool = False
    """True: the analog-to-digital converter of the supply voltages repeats its last readings."""
    ultrasonic_blind: bool = False
    """True: no echo is detected."""
    ultrasonic_constant_m: float | None = None
    """Constant ultrasonic range that replaces each measurement, m, also with
    ``ultrasonic_blind``."""
    bumper_stuck_left: bool = False
    """True: the left switch is stuck pressed."""
    bumper_stuck_right: bool = False
    lifted: bool = False
    """True: the robot is in the air. The cliff sensor detects no floor, and the module ``lift``
    changes the accelerometer readings."""


@dataclass(slots=True)
class SensorFaults(SensorFaultValues, ChangeFlag):
    """Faults of one suite of sensors; a change takes effect at the next reading."""

    changed: bool = field(default=True, init=False, repr=False, compare=False)
    """True if a fault was set since the inertial sensor last read this object."""


class Miswiring:
    """Counters of reversed or swapped encoders; they do not jump at the fault's start or end."""

    __slots__ = ("_raw", "_seen")

    def __init__(self, counts: tuple[int, int]) -> None:
        """Start with the present values of both counters."""
        self._raw = self._seen = counts

    def apply(self, counts: tuple[int, int], faults: SensorFaults) -> tuple[int, int]:
        """Return the counters that the firmware reads, 0..65535."""
        left, right = (
            _new_counts(before, now) for before, now in zip(self._raw, counts, strict=True)
        )
        self._raw = counts
        if faults.encoder_reversed_left:
            left = -left
        if faults.encoder_reversed_right:
            right = -right
        if faults.encoders_swapped:
            left, right = right, left
        self._seen = self._seen[0] + left & _MASK, self._seen[1] + right & _MASK
        return self._seen


class CountDropout:
    """Loses a share of one encoder's edges."""

    __slots__ = ("_lost", "before")

    def __init__(self) -> None:
        """Start without loss."""
        self.before: int | None = None
        """Previous value of the counter."""
        self._lost = 0.0

    def apply(self, count: int, share: float) -> int:
        """Return the counter that the firmware reads, 0..65535, with ``share`` of new counts lost.

        The wheel must turn by less than half of the counter's range between two calls.
        """
        if self.before is not None and share > 0.0:
            self._lost += min(1.0, share) * _new_counts(self.before, count)
        self.before = count
        return (count - round(self._lost)) & _MASK


def _new_counts(before: int, now: int) -> int:
    """Return the difference of a 16-bit counter; the emulator does not use the host's odometry."""
    return (now - before + _HALF_WRAP & _MASK) - _HALF_WRAP
