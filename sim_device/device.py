"""The virtual sweeper: world, plant, sensors and firmware behind one ``step(bytes, now)``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.catalogue import CATALOGUE
from protocol.link import Link
from protocol.values import RebootKind, ResetCause
from sim_device.firmware import TICK_US, Firmware, Identity
from sim_device.noise import noise_level
from sim_device.plant import Plant, Truth
from sim_device.sensors import SensorSuite
from sim_device.world import World

if TYPE_CHECKING:
    from bridge.coverage.floorplan import FloorPlan
    from protocol.catalogue import Catalogue
    from protocol.link import LinkBase

_TICK_MS = TICK_US // 1000
BOOT_US = 300_000
"""From reset to the first control period: clocks, the IMU's start-up, sensors found."""


def _boot_id(rng: np.random.Generator) -> int:
    """A boot id of the device's own sequence: random, never 0."""
    return int(rng.integers(1, 1 << 32))


class VirtualSweeper:
    """A device that speaks the wire protocol, deterministic for its seed.

    Time is the device's microseconds since it was switched on, and is passed in; a reboot that
    the host asks for starts the firmware's own clock anew within it. Between two calls
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
        link: type[LinkBase] = Link,
        boot_id: int | None = None,
    ) -> None:
        """Boot at time 0, at rest at the plan's start.

        ``catalogue`` is what the firmware's version of the project declares, ``link`` what the
        device is connected by. Without a ``boot_id`` it follows from the seed.

        Raises:
            FloorPlanError: the robot does not fit where it should start.
            UnknownNoiseLevelError: no such level.

        """
        model = model or RobotModel()
        level = noise_level(noise)
        identity_rng, plant_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self.sensors = SensorSuite(self.plant, model, level, sensor_rng)
        identity = Identity(node, identity_rng.bytes(12), boot_id or _boot_id(identity_rng))
        self._model, self._catalogue, self._link = model, catalogue, link
        self._identity_rng = identity_rng
        self._stored: dict[str, int] = {}
        self.firmware = Firmware(
            model, identity, self.sensors, catalogue, stored=self._stored, link=link
        )
        self._next_tick_us = 0
        self._booted_us = 0
        """When the firmware's own clock began: 0, or after a reboot that it was told to do."""

    def step(self, data: bytes, now_us: int) -> bytes:
        """Live until ``now_us``, then take ``data``; give what the device writes meanwhile."""
        while self._next_tick_us <= now_us:
            tick_us = self._next_tick_us - self._booted_us
            duties = self.firmware.tick(tick_us) if tick_us >= 0 else (0.0, 0.0)
            self.plant.set_duty(*duties)
            self.plant.advance_ms(_TICK_MS)
            self._next_tick_us += TICK_US
        if data and now_us >= self._booted_us:
            self.firmware.receive(data, now_us - self._booted_us)
        out = self.firmware.data_to_send()
        if self.firmware.reboot_wanted is not None:
            self._obey_reboot(self.firmware.reboot_wanted)
        return out

    def _obey_reboot(self, kind: RebootKind) -> None:
        if kind is RebootKind.FACTORY_RESET:
            self._stored.clear()
        self._boot(_boot_id(self._identity_rng), ResetCause.SOFTWARE)
        self._booted_us = self._next_tick_us + BOOT_US

    def reboot(self, boot_id: int, cause: ResetCause = ResetCause.SOFTWARE) -> None:
        """Start the firmware anew where the body stands; the device's time begins at 0 again."""
        self._boot(boot_id, cause)
        self._next_tick_us = self._booted_us = 0

    def _boot(self, boot_id: int, cause: ResetCause) -> None:
        self.plant.set_duty(0.0, 0.0)
        identity = replace(self.firmware.identity, boot_id=boot_id, reset_cause=cause)
        self.firmware = Firmware(
            self._model,
            identity,
            self.sensors,
            self._catalogue,
            stored=self._stored,
            link=self._link,
        )

    def next_deadline_us(self) -> int:
        """When the device has something to do next, bytes aside."""
        return self._next_tick_us

    @property
    def truth(self) -> Truth:
        """What is really so, at the end of the running control period."""
        return self.plant.truth
