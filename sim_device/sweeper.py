"""The virtual sweeper: world, plant, sensors and firmware behind one ``step(bytes, now)``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.messages.values import RebootKind, ResetCause
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.link import Link
from sim_device.body.plant import Plant, Truth
from sim_device.device.clock import DeviceClock
from sim_device.device.flash import Flash
from sim_device.device.identity import CrashRecord, Identity
from sim_device.device.modes import Event, ModeMachine, State
from sim_device.device.virtual_firmware import TICK_US, Firmware
from sim_device.noise import NoiseLevel, noise_level
from sim_device.sensors.imu import ImuConfig
from sim_device.sensors.sensors import SensorSuite
from sim_device.world.world import World

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.link import LinkBase
    from protocol.schema.catalogue import Catalogue

BOOT_US = 300_000
"""From reset to the first control period: clocks, the IMU's start-up, sensors found."""
WATCHDOG_US = 100_000
"""An independent watchdog (RM0090, section 21) that the control loop feeds in each period: ten
periods missed are no delay. Until it bites the outputs stay as they were."""
BROWN_OUT_V = 4.0
"""On the 5 V rail: the 3.3 V behind its regulator then falls below brown-out level 3 (2.7 to
3.6 V in RM0090, section 5.2.3), and the chip holds itself in reset."""
CRASH_PC, CRASH_LR, CRASH_CFSR = 0x0800_4D2A, 0x0800_4C91, 0x0001_0000
"""What a crash of this firmware leaves: an address each in the flash, and "undefined instruction"
(PM0214, section 4.4.10). The virtual firmware has no addresses of its own."""
SUPPLY_GOOD_V = 4.3
"""Where it lets go of it again."""
_HALF_TICK_US = TICK_US // 2
_OFF = State.OFF
_SUPPLY_CAUSES = frozenset({ResetCause.POWER_ON, ResetCause.BROWN_OUT})


def _boot_id(rng: np.random.Generator) -> int:
    """A boot id of the device's own sequence: random, never 0."""
    return int(rng.integers(1, 1 << 32))


class VirtualSweeper:
    """A device that speaks the wire protocol, deterministic for its seed.

    The time that is passed in is true time, in microseconds since the device was first switched
    on. The firmware has a clock of its own (``clock``), which begins anew with each boot.
    Between two calls the plant moves on in control periods of 10 ms of that clock; bytes are
    taken at the moment given.
    """

    def __init__(  # noqa: PLR0913 - what a device can be made with
        self,
        plan: FloorPlan,
        model: RobotModel | None = None,
        *,
        seed: int = 0,
        noise: str | NoiseLevel = "typical",
        node: int = 1,
        catalogue: Catalogue = CATALOGUE,
        link: type[LinkBase] = Link,
        boot_id: int | None = None,
        local: bool = True,
        imu: ImuConfig | None = None,
    ) -> None:
        """Boot at time 0, at rest at the plan's start.

        ``noise`` names a level, or is one of one's own. ``catalogue`` is what the firmware's
        version of the project declares, ``link`` what the device is connected by, and ``local``
        whether that can be reached from nowhere but beside the robot: a key is set only so.
        Without a ``boot_id`` it follows from the seed. ``imu`` is how the firmware
        sets the IMU.

        Raises:
            FloorPlanError: the robot does not fit where it should start.
            UnknownNoiseLevelError: no such level.

        """
        model = model or RobotModel()
        level = noise if isinstance(noise, NoiseLevel) else noise_level(noise)
        identity_rng, plant_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self._imu = imu or ImuConfig()
        self.sensors = SensorSuite(self.plant, model, level, sensor_rng, self._imu)
        self.clock = DeviceClock()
        self.flash = Flash()
        self._model, self.catalogue, self._link, self._local = model, catalogue, link, local
        self._identity = Identity(node, identity_rng.bytes(12), boot_id or _boot_id(identity_rng))
        self._identity_rng = identity_rng
        self._modes = ModeMachine()
        self._modes.fire(Event.SUPPLY_BACK)
        self._modes.fire(Event.BOOTED)
        self.firmware = self._new_firmware()
        self._next_tick_us = 0
        self._ready_us = 0
        """When the firmware begins, or began."""
        self._fed_us = 0
        self._hung = False
        self._crystal_failed = False

    def step(self, data: bytes, now_us: int) -> bytes:
        """Live until ``now_us``, then take ``data``; give what the device writes meanwhile."""
        while self._next_tick_us <= now_us:
            self._period()
        if self._hung or not self._modes.awake:
            return b""  # what comes now is lost, and nothing is said
        firmware = self.firmware
        # With a key, time alone decides too: a command on CAN waits for its tag.
        if data or firmware.link.key is not None:
            firmware.receive(data, self.clock.uptime_us(now_us))
        out = firmware.data_to_send()
        if firmware.reboot_wanted is not None:
            if firmware.reboot_wanted is RebootKind.FACTORY_RESET:
                self.flash.erase()
            self.reset(ResetCause.SOFTWARE)
        return out

    def skip_to(self, now_us: int) -> None:
        """Set the device's clock ahead, µs, as if it had been on for so long."""
        self._next_tick_us = now_us

    def next_deadline_us(self) -> int:
        """When the device has something to do next, bytes aside."""
        return self._next_tick_us

    @property
    def truth(self) -> Truth:
        """What is really so, at the end of the running control period."""
        return self.plant.truth

    @property
    def drivers(self) -> bool:
        """Whether the motor drivers are enabled; a resetting chip's are not.

        At rest a disabled bridge lets the wheels stand like a braking one: the plant brakes.
        """
        return self._modes.awake and self.firmware.control.drivers

    @property
    def state(self) -> State:
        """Where the device stands in its mode table."""
        return self._modes.state

    # ---- what may befall it ---------------------------------------------------------------

    def reset(
        self,
        cause: ResetCause,
        off_s: float = 0.0,
        *,
        boot_id: int | None = None,
        crash: CrashRecord | None = None,
    ) -> None:
        """Reset the chip where the body stands; it boots ``off_s`` and 0.3 s later.

        Outputs are off until then, whatever was on its way or in memory is lost, a save under
        way included, and bytes that come are not heard. After ``POWER_ON`` and ``BROWN_OUT`` it
        also waits for its supply. Without a ``boot_id`` the device draws one.
        """
        self._modes.fire(Event.SUPPLY_LOST if cause in _SUPPLY_CAUSES else Event.RESET)
        self.plant.set_duty(0.0, 0.0)
        self.flash.power_lost()
        self._hung = False
        self._identity = replace(
            self._identity,
            boot_id=boot_id or _boot_id(self._identity_rng),
            reset_cause=cause,
            crash=crash,
            crystal_failed=self._crystal_failed,
        )
        self.firmware = self._new_firmware()
        self._ready_us = self._next_tick_us + round(off_s * 1e6) + BOOT_US

    def hang(self) -> None:
        """Let the firmware stand still, its outputs as they are, until the watchdog resets it."""
        self._hung = self._modes.awake

    def crash(self) -> None:
        """Let the processor fault: its record outlives the reset."""
        if self._modes.awake:
            uptime_us = self.clock.uptime_us(self._next_tick_us)
            record = CrashRecord(CRASH_PC, CRASH_LR, CRASH_CFSR, uptime_us)
            self.reset(ResetCause.CRASH, crash=record)

    def fail_crystal(self, drift_ppm: float) -> None:
        """Let the crystal stop: the watchdog, which has a clock of its own, resets the chip."""
        self._crystal_failed = True
        self.clock.drift_ppm += drift_ppm
        self.reset(ResetCause.WATCHDOG)

    # ---- time -----------------------------------------------------------------------------

    def _period(self) -> None:
        """One control period: the firmware's tick, if it lives, and the body until the next."""
        now_us, modes, plant = self._next_tick_us, self._modes, self.plant
        next_us = now_us + TICK_US if modes.awake else self._wait(now_us)
        if modes.awake:
            if self._hung:
                if now_us - self._fed_us >= WATCHDOG_US:
                    self.reset(ResetCause.WATCHDOG)
            else:
                self._fed_us = now_us
                clock = self.clock
                uptime_us = clock.uptime_us(now_us)
                left, right = self.firmware.tick(uptime_us)
                plant.set_duty(left, right)
                ticks = (uptime_us + _HALF_TICK_US) // TICK_US
                next_us = clock.true_us((ticks + 1) * TICK_US)
        self._next_tick_us = next_us
        plant.advance_ms(next_us // 1000 - now_us // 1000)
        if plant.rail_5v_v < BROWN_OUT_V and modes.state is not _OFF:
            self.reset(ResetCause.BROWN_OUT)

    def _wait(self, now_us: int) -> int:
        """A period without firmware; gives when the next one begins."""
        if self._modes.state is State.OFF:
            if self.plant.rail_5v_v < SUPPLY_GOOD_V:
                self._ready_us = max(self._ready_us, now_us + TICK_US + BOOT_US)
            elif now_us >= self._ready_us - BOOT_US:
                self._modes.fire(Event.SUPPLY_BACK)
        if self._modes.state is State.BOOT and now_us >= self._ready_us:
            self._modes.fire(Event.BOOTED)
            self.clock.boot(now_us)
            return now_us
        return min(now_us + TICK_US, max(now_us + 1, self._ready_us))

    def _new_firmware(self) -> Firmware:
        return Firmware(
            self._model,
            self._identity,
            self.sensors,
            self.catalogue,
            flash=self.flash,
            link=self._link,
            clock=self.clock,
            modes=self._modes,
            imu_scale=self._imu.scale,
            local=self._local,
        )
