"""All sensors of the virtual sweeper, read on demand by its firmware."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.contacts import Bumpers, bumpers
from sim_device.encoders import Encoders
from sim_device.imu import Imu, ImuCounts
from sim_device.noise import Draws
from sim_device.power import PowerMonitor, PowerReading
from sim_device.rangers import Rangers, Ranges

if TYPE_CHECKING:
    import numpy as np

    from bridge.motion.robot_model import RobotModel
    from sim_device.noise import NoiseLevel
    from sim_device.plant import Plant


class SensorSuite:
    """Raw readings of one plant; nothing is computed that is not asked for.

    ``rng`` only gives birth to children, one per noisy sensor: how often one is read, or how
    many values it draws, shifts nothing in another. New sensors take later children.
    """

    def __init__(
        self,
        plant: Plant,
        model: RobotModel,
        noise: NoiseLevel,
        rng: np.random.Generator,
    ) -> None:
        """Attach to ``plant``; ``model`` gives the mounts and the encoder's counts."""
        imu_rng, range_rng, power_rng = rng.spawn(3)
        self._plant = plant
        self._encoders = Encoders(plant, model)
        self._imu = Imu(plant, noise, Draws(imu_rng))
        self._rangers = Rangers(model, noise, Draws(range_rng))
        self._power = PowerMonitor(plant, noise, Draws(power_rng))

    def imu(self) -> ImuCounts:
        """MPU6050 registers: acceleration, temperature, rotation."""
        return self._imu.read()

    def encoders(self) -> tuple[int, int]:
        """Left and right count, 0..65535."""
        return self._encoders.read()

    def ranges(self) -> Ranges:
        """Ultrasonic, infrared left, infrared right, metres or ``None``."""
        return self._rangers.read(self._plant.pose, self._plant.world)

    def bumpers(self) -> Bumpers:
        """Left and right half."""
        return bumpers(self._plant.touch_bearings_rad)

    def cliff(self) -> bool:
        """Whether the floor is missing ahead; a room's floor has no holes and no steps down."""
        return False

    def power(self) -> PowerReading:
        """Battery and 5 V rail, motor currents."""
        return self._power.read()
