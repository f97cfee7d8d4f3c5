"""The virtual sweeper: world, plant, sensors and firmware behind one ``step(bytes, now)``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.catalogue import CATALOGUE
from protocol.values import ResetCause
from sim_device.firmware import TICK_US, Firmware, Identity
from sim_device.noise import noise_level
from sim_device.plant import Plant, Truth
from sim_device.sensors import SensorSuite
from sim_device.world import World

if TYPE_CHECKING:
    from bridge.coverage.floorplan import FloorPlan
    from protocol.catalogue import Catalogue

_TICK_MS = TICK_US // 1000


class VirtualSweeper:
    """A device that speaks the wire protocol, deterministic for its seed.

    Time is the device's microseconds since it booted, and is passed in. Between two calls
    the plant moves on in control periods of 10 ms; bytes are taken at the moment given.
    """

    def __init__(  # noqa: PLR0913 - what a device can be made with
        self,
        plan: FloorPlan,
        model: RobotModel | None = None,
        *,
        seed: int = 0,
        noise: str = "typical",
        node: int = 1,
        catalogue: Catalogue = CATALOGUE,
        boot_id: int | None = None,
    ) -> None:
        """Boot at time 0, at rest at the plan's start.

        ``catalogue`` is what the firmware's version of the project declares. Without a
        ``boot_id`` it follows from the seed.

        Raises:
            FloorPlanError: the robot does not fit where it should start.
            UnknownNoiseLevelError: no such level.

        """
        model = model or RobotModel()
        level = noise_level(noise)
        identity_rng, plant_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self.sensors = SensorSuite(self.plant, model, level, sensor_rng)
        identity = Identity(
            node, identity_rng.bytes(12), boot_id or int(identity_rng.integers(1, 1 << 32))
        )
        self._model, self._catalogue = model, catalogue
        self.firmware = Firmware(model, identity, self.sensors, catalogue)
        self._next_tick_us = 0

    def step(self, data: bytes, now_us: int) -> bytes:
        """Live until ``now_us``, then take ``data``; give what the device writes meanwhile."""
        while self._next_tick_us <= now_us:
            self.plant.set_duty(*self.firmware.tick(self._next_tick_us))
            self.plant.advance_ms(_TICK_MS)
            self._next_tick_us += TICK_US
        if data:
            self.firmware.receive(data, now_us)
        return self.firmware.data_to_send()

    def reboot(self, boot_id: int, cause: ResetCause = ResetCause.SOFTWARE) -> None:
        """Start the firmware anew where the body stands; the device's time begins at 0 again."""
        self.plant.set_duty(0.0, 0.0)
        identity = replace(self.firmware.identity, boot_id=boot_id, reset_cause=cause)
        self.firmware = Firmware(self._model, identity, self.sensors, self._catalogue)
        self._next_tick_us = 0

    def next_deadline_us(self) -> int:
        """When the device has something to do next, bytes aside."""
        return self._next_tick_us

    @property
    def truth(self) -> Truth:
        """What is really so, at the end of the running control period."""
        return self.plant.truth
