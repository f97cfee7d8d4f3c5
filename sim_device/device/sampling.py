"""Reads the sensors for the firmware, each sensor at most once per control period."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from protocol.imu import NOMINAL, ImuScale
from protocol.messages.device import Imu
from sim_device.sensors.imu import ImuCounts

if TYPE_CHECKING:
    from sim_device.sensors.contacts import Bumpers
    from sim_device.sensors.power_monitor import PowerReading
    from sim_device.sensors.rangers import Ranges

_MASK = 0xFFFF


class Sensors(Protocol):
    """Interface of the hardware: all sensor readings that the firmware needs."""

    def imu(self) -> ImuCounts:
        """Return the MPU6050 registers: acceleration, temperature, rates."""

    def imu_samples(self) -> int:
        """Return the number of samples read from the IMU.

        The number may increase by more or less than one per control period, because the chip has
        its own sampling clock and its bus may be stuck.
        """

    def encoders(self) -> tuple[int, int]:
        """Return the absolute 16-bit counts, left and right."""

    def ranges(self) -> Ranges:
        """Return ultrasonic, left and right infrared, m, and the age of the ultrasonic range."""

    def bumpers(self) -> Bumpers:
        """Return whether the left and the right bumper switch are pressed."""

    def cliff(self) -> bool:
        """Return whether the floor is missing ahead."""

    def power(self) -> PowerReading:
        """Return rail voltages and motor currents."""


class Around(NamedTuple):
    """Ranges and contacts in one control period."""

    ultrasonic_m: float | None
    infrared_left_m: float | None
    infrared_right_m: float | None
    bumper_left: bool
    bumper_right: bool
    cliff: bool
    ultrasonic_age_us: int
    """Time since the pulse of the ultrasonic range, µs."""


class Sampler:
    """Reads each sensor once per period, even if a value is requested several times."""

    def __init__(
        self,
        sensors: Sensors,
        corrections: tuple[tuple[float, float], ...] | None = None,
        imu_scale: ImuScale = NOMINAL,
    ) -> None:
        """Start without any reading.

        ``corrections`` are the calibrated scale and offset (m) of each ranger; ``imu_scale`` is the
        scale of the IMU's counts.
        """
        self._imu_scale = None if imu_scale == NOMINAL else imu_scale
        self._corrections = corrections
        self._sensors = sensors
        self._zero: tuple[int, int] | None = None
        """Encoder counters at boot; None: they were 0, or have not been read yet."""
        self._begun = False
        self._around: Around | None = None
        self._contacts: tuple[bool, bool, bool] | None = None
        self.counts = (0, 0)
        """Encoder counts in this period, relative to the boot."""
        self.imu: ImuCounts
        """IMU registers in this period."""
        self.imu_nominal: ImuCounts
        """IMU registers in this period, converted to nominal counts, for the device's own
        checks."""
        self.imu_samples = 0
        """Number of the IMU sample in the registers."""
        self.imu_us = 0
        """Uptime of the IMU sample in the registers, µs."""

    def begin(self, now_us: int) -> None:
        """Start a control period at uptime ``now_us``: read encoders and IMU."""
        sensors = self._sensors
        counts = sensors.encoders()
        if not self._begun:
            self._begun, self._zero = True, counts if counts != (0, 0) else None
        if self._zero is not None:
            zero_left, zero_right = self._zero
            counts = counts[0] - zero_left & _MASK, counts[1] - zero_right & _MASK
        self.counts = counts
        self.imu = self.imu_nominal = sensors.imu()
        if self._imu_scale is not None:
            self.imu_nominal = ImuCounts(*self._imu_scale.nominal(Imu(*self.imu)))
        samples = sensors.imu_samples()
        if samples != self.imu_samples:
            self.imu_samples, self.imu_us = samples, now_us
        self._around = self._contacts = None

    def around(self) -> Around:
        """Return rangers, bumpers and cliff in this period."""
        if self._around is None:
            sensors = self._sensors
            front_m, left_m, right_m, age_us = sensors.ranges()
            if self._corrections is not None:
                front_m, left_m, right_m = (
                    None if range_m is None else max(0.0, scale * range_m + offset_m)
                    for range_m, (scale, offset_m) in zip(
                        (front_m, left_m, right_m), self._corrections, strict=True
                    )
                )
            self._around = Around(front_m, left_m, right_m, *self.contacts(), age_us)
        return self._around

    def contacts(self) -> tuple[bool, bool, bool]:
        """Return left and right bumper and cliff in this period."""
        if self._contacts is None:
            self._contacts = (*self._sensors.bumpers(), self._sensors.cliff())
        return self._contacts

    def power(self) -> PowerReading:
        """Return rail voltages and motor currents now."""
        return self._sensors.power()
