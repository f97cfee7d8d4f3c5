"""All sensors of the virtual sweeper, read on demand by its firmware."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.noise import Draws
from sim_device.sensors.bumper import Bumper
from sim_device.sensors.cliff import CliffSensor
from sim_device.sensors.encoders import EncoderCounters
from sim_device.sensors.faults import SensorFaults
from sim_device.sensors.imu import ImuConfig, ImuSensor
from sim_device.sensors.power_monitor import PowerMonitor, PowerReading
from sim_device.sensors.rangers import Rangers, Ranges

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from bridge.motion.robot_model import RobotModel
    from sim_device.body.plant import Plant
    from sim_device.noise import NoiseLevel
    from sim_device.sensors.contacts import Bumpers
    from sim_device.sensors.imu import ImuCounts

__all__ = ["SensorFaults", "SensorSuite"]


class SensorSuite:
    """Raw readings of one plant, computed on demand.

    ``rng`` only spawns child generators, one per noisy sensor. So the use of one sensor does not
    change the random values of another sensor. A new sensor must use the next child generator.
    """

    def __init__(
        self,
        plant: Plant,
        model: RobotModel,
        noise: NoiseLevel,
        rng: np.random.Generator,
        imu: ImuConfig | None = None,
    ) -> None:
        """Measure ``plant``; ``model`` defines the mounts and the encoder's counts per turn."""
        imu = imu or ImuConfig()
        imu_rng, range_rng, power_rng = rng.spawn(3)
        self.faults = SensorFaults()
        """Faults of the sensors; they may change at any time."""
        self._plant = plant
        self.encoders: Callable[[], tuple[int, int]] = EncoderCounters(
            plant, model, self.faults
        ).read
        """Function that returns the left and the right count, 0..65535."""
        self._imu = ImuSensor(plant, noise, imu_rng, self.faults, imu)
        self.imu: Callable[[], ImuCounts] = self._imu.read
        """Function that returns the MPU6050's registers: acceleration, temperature, rotation."""
        self._rangers = Rangers(model, noise, range_rng)
        self._bumper = Bumper(plant, model.radius_m)
        self._cliff = CliffSensor(model.radius_m)
        self._power = PowerMonitor(plant, noise, Draws(power_rng))
        self._power_before: PowerReading | None = None

    def imu_samples(self) -> int:
        """Return the number of the IMU's samples that the firmware has read."""
        return self._imu.samples

    def ranges(self) -> Ranges:
        """Return ultrasonic, infrared left and infrared right, m, each ``None`` if out of range."""
        plant, faults = self._plant, self.faults
        ranges = self._rangers.read(plant.tick_ms, plant.pose, plant.world)
        if faults.ultrasonic_constant_m is not None:
            return ranges._replace(ultrasonic_m=faults.ultrasonic_constant_m)
        return ranges._replace(ultrasonic_m=None) if faults.ultrasonic_blind else ranges

    def bumpers(self) -> Bumpers:
        """Return the left and the right bumper switch."""
        pressed, faults = self._bumper.read(), self.faults
        if faults.bumper_stuck_left or faults.bumper_stuck_right:
            return pressed._replace(
                left=pressed.left or faults.bumper_stuck_left,
                right=pressed.right or faults.bumper_stuck_right,
            )
        return pressed

    def cliff(self) -> bool:
        """Return True if the floor is missing ahead."""
        if self.faults.lifted:
            return True
        cliffs = self._plant.world.plan.cliffs
        return bool(cliffs) and self._cliff.sees_none(self._plant.pose, cliffs)

    def power(self) -> PowerReading:
        """Return battery voltage, 5 V rail and motor currents."""
        if self._power_before is None or not self.faults.adc_frozen:
            self._power_before = self._power.read()
        return self._power_before
