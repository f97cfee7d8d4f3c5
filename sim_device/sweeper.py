"""The virtual sweeper: world, plant, sensors and chip with one method ``step(bytes, now)``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.messages.values import RebootKind, ResetCause
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.link import Link
from sim_device.body.plant import Plant, Truth
from sim_device.body.supply import BROWN_OUT_V, SUPPLY_GOOD_V
from sim_device.device.clock import DeviceClock
from sim_device.device.flash import Flash
from sim_device.device.identity import CrashRecord, Identity, capabilities_of
from sim_device.device.modes import DeviceState, Event, ModeMachine
from sim_device.device.virtual_firmware import TICK_US, Firmware
from sim_device.noise import NoiseLevel, noise_level
from sim_device.sensors.imu import ImuConfig
from sim_device.sensors.sensors import SensorSuite
from sim_device.world.world import World

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.link import LinkBase
    from protocol.messages.values import Mode, StopCause
    from protocol.schema.catalogue import Catalogue
    from sim_device.line.device_end import DeviceEnd

BOOT_US = 300_000
"""Time from reset to the first control period, µs: start of clocks and IMU, detection of
sensors."""
WATCHDOG_US = 100_000
"""Timeout of the chip's independent watchdog (RM0090, section 21), µs. The control loop feeds the
watchdog in each period of 10 ms. Ten missed periods are longer than any normal delay. Until the
watchdog resets the chip, the outputs do not change."""
CRASH_PC, CRASH_LR, CRASH_CFSR = 0x0800_4D2A, 0x0800_4C91, 0x0001_0000
"""Crash record that this firmware reports: two addresses in the flash, and the fault "undefined
instruction" (PM0214, section 4.4.10). The addresses are constants, because the virtual firmware has
no real addresses."""
_OFF = DeviceState.OFF
_SUPPLY_CAUSES = frozenset({ResetCause.POWER_ON, ResetCause.BROWN_OUT})


def _boot_id(rng: np.random.Generator) -> int:
    """Return a random boot id from the device's generator; never 0."""
    return int(rng.integers(1, 1 << 32))


class Program(Protocol):
    """Interface of a firmware between two boots. Times are its uptime, µs."""

    reboot_wanted: RebootKind | None
    """The reboot that the firmware has accepted; None: no reboot."""

    def tick(self, now_us: int) -> tuple[float, float]:
        """Run one control period; return the duties of the left and the right wheel, -1..1."""

    def next_us(self, now_us: int) -> int:
        """Return the start of the control period after the one at ``now_us``."""

    def receive(self, data: bytes, now_us: int) -> None:
        """Process bytes that arrived at ``now_us``."""

    def data_to_send(self) -> bytes:
        """Return the bytes to send."""

    @property
    def fed(self) -> bool:
        """True if the last tick fed the watchdog."""

    @property
    def waits(self) -> bool:
        """True if received bytes may time out, such as a command without its tag."""

    @property
    def drivers(self) -> bool:
        """True if the firmware enables the motor drivers."""

    @property
    def state(self) -> DeviceState:
        """State in the mode table."""

    @property
    def mode(self) -> Mode:
        """Mode as in the status message."""

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop; ``NONE``: no stop is latched."""


class Memory(Protocol):
    """The chip's flash."""

    def power_lost(self) -> None:
        """Abort the write or erase in progress."""

    def erase(self) -> None:
        """Erase everything."""


P = TypeVar("P", bound=Program)


class Sweeper(ABC, Generic[P]):
    """A robot in a room, with a chip that runs a firmware; deterministic for its seed.

    Times passed in are true times, in microseconds since the device was first switched on. The
    firmware has its own clock (``clock``), which restarts with each boot. Between two calls the
    plant advances in control periods of 10 ms of this clock. Bytes are received at the given time.
    """

    firmware: P
    """The running firmware; each boot creates a new object."""
    cannot: Mapping[str, str] = MappingProxyType({})
    """Kinds of fault that the device rejects, each with the reason; none by default."""

    def __init__(  # noqa: PLR0913 - options of a device
        self,
        plan: FloorPlan,
        model: RobotModel,
        flash: Memory,
        *,
        seed: int,
        noise: str | NoiseLevel,
        node: int,
        link: type[LinkBase],
        boot_id: int | None,
        imu: ImuConfig,
    ) -> None:
        """Switch on at time 0, at rest at the plan's start pose; the subclass boots the firmware.

        Raises:
            FloorPlanError: the robot does not fit at its start.
            UnknownNoiseLevelError: no such level.

        """
        level = noise if isinstance(noise, NoiseLevel) else noise_level(noise)
        identity_rng, plant_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self.sensors = SensorSuite(self.plant, model, level, sensor_rng, imu)
        self.clock = DeviceClock()
        self.link = link
        """The link to the host: UART or CAN."""
        self._memory = flash
        self._identity = Identity(
            node,
            identity_rng.bytes(12),
            boot_id or _boot_id(identity_rng),
            capabilities=capabilities_of(model),
        )
        self._identity_rng = identity_rng
        self._modes = ModeMachine()
        self._modes.fire(Event.SUPPLY_BACK)
        self._modes.fire(Event.BOOTED)
        self.duties = (0.0, 0.0)
        """Duties of the left and the right wheel since the last control period, -1..1."""
        self._next_tick_us = 0
        self._ready_us = 0
        """Time at which the firmware starts, or started, µs."""
        self._fed_us = 0
        self._hung = False
        self._crystal_failed = False

    @abstractmethod
    def _new_firmware(self) -> P:
        """Boot the firmware with the identity in ``_identity``."""

    def step(self, data: bytes, now_us: int) -> bytes:
        """Advance to ``now_us``, then receive ``data``; return the bytes that the device sends."""
        while self._next_tick_us <= now_us:
            self._period()
        if self._hung or not self._modes.awake:
            return b""  # received bytes are lost, and nothing is sent
        firmware = self.firmware
        if data or firmware.waits:
            firmware.receive(data, self.clock.uptime_us(now_us))
        out = firmware.data_to_send()
        if firmware.reboot_wanted is not None:
            if firmware.reboot_wanted is RebootKind.FACTORY_RESET:
                self._memory.erase()
            self.reset(ResetCause.SOFTWARE)
        return out

    def attach_line(self, end: DeviceEnd) -> None:
        """Use the counters of this end of the link; ignored by a chip with its own counters."""

    def close(self) -> None:
        """Release the resources of the firmware; by default there are none."""

    def skip_to(self, now_us: int) -> None:
        """Advance the device's clock to ``now_us``, as if the device had been on for this time."""
        self._next_tick_us = now_us

    def next_deadline_us(self) -> int:
        """Return the time of the device's next work if it receives no bytes."""
        return self._next_tick_us

    @property
    def truth(self) -> Truth:
        """Return the true state at the end of the running control period."""
        return self.plant.truth

    @property
    def drivers(self) -> bool:
        """Whether the motor drivers are enabled; they are disabled during a reset of the chip.

        At rest, a disabled bridge holds the wheels like a braking bridge, so the plant brakes in
        both cases.
        """
        return self._modes.awake and self.firmware.drivers

    @property
    def state(self) -> DeviceState:
        """State of the device in its mode table."""
        return self.firmware.state if self._modes.awake else self._modes.state

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop; ``NONE``: no stop is latched."""
        return self.firmware.stop_cause

    @property
    def mode(self) -> Mode:
        """Mode of the firmware."""
        return self.firmware.mode

    # ---- events from outside ------------------------------------------------------------------

    def reset(
        self,
        cause: ResetCause,
        off_s: float = 0.0,
        *,
        boot_id: int | None = None,
        crash: CrashRecord | None = None,
    ) -> None:
        """Reset the chip without a change of the plant; the chip boots after ``off_s`` + 0.3 s.

        Until then its outputs are off and received bytes are ignored. Queued data and memory are
        lost, and a running save is aborted. After ``POWER_ON`` and ``BROWN_OUT`` the chip also
        waits for its supply voltage. Without a ``boot_id`` the device draws a random id.
        """
        self._modes.fire(Event.SUPPLY_LOST if cause in _SUPPLY_CAUSES else Event.RESET)
        self.duties = (0.0, 0.0)
        self.plant.set_duty(0.0, 0.0)
        self._memory.power_lost()
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
        """Freeze the firmware until the watchdog resets it; the outputs do not change."""
        self._hung = self._modes.awake

    def crash(self) -> None:
        """Cause a processor fault; the crash record survives the reset."""
        if self._modes.awake:
            self._reset_by_fault_handler(CRASH_CFSR)

    def fail_crystal(self, drift_ppm: float) -> None:
        """Stop the crystal. The clock security system calls the fault handler, which resets."""
        self._crystal_failed = True
        if self._modes.awake:
            self._reset_by_fault_handler(cfsr=0)
        else:
            self.reset(self._identity.reset_cause)
        self.clock.drift_ppm += drift_ppm

    def _reset_by_fault_handler(self, cfsr: int) -> None:
        uptime_us = self.clock.uptime_us(self._next_tick_us)
        self.reset(ResetCause.CRASH, crash=CrashRecord(CRASH_PC, CRASH_LR, cfsr, uptime_us))

    # ---- time -----------------------------------------------------------------------------

    def _period(self) -> None:
        """Run one control period: the firmware's tick (if it runs), then the plant."""
        now_us, modes, plant = self._next_tick_us, self._modes, self.plant
        next_us = now_us + TICK_US if modes.awake else self._wait(now_us)
        if modes.awake:
            if self._hung:
                if now_us - self._fed_us >= WATCHDOG_US:
                    self.reset(ResetCause.WATCHDOG)
            else:
                clock, firmware = self.clock, self.firmware
                uptime_us = clock.uptime_us(now_us)
                left, right = self.duties = firmware.tick(uptime_us)
                plant.set_duty(left, right)
                next_us = clock.true_us(firmware.next_us(uptime_us))
                if firmware.fed:
                    self._fed_us = now_us
                elif now_us - self._fed_us >= WATCHDOG_US:
                    self.reset(ResetCause.WATCHDOG)
        self._next_tick_us = next_us
        plant.advance_ms(next_us // 1000 - now_us // 1000)
        if plant.rail_5v_v < BROWN_OUT_V and modes.state is not _OFF:
            self.reset(ResetCause.BROWN_OUT)

    def _wait(self, now_us: int) -> int:
        """Run one control period without firmware; return the time of the next period."""
        if self._modes.state is DeviceState.OFF:
            if self.plant.rail_5v_v < SUPPLY_GOOD_V:
                self._ready_us = max(self._ready_us, now_us + TICK_US + BOOT_US)
            elif now_us >= self._ready_us - BOOT_US:
                self._modes.fire(Event.SUPPLY_BACK)
        if self._modes.state is DeviceState.BOOT and now_us >= self._ready_us:
            self._modes.fire(Event.BOOTED)
            self.clock.boot(now_us)
            return now_us
        return min(now_us + TICK_US, max(now_us + 1, self._ready_us))


class VirtualSweeper(Sweeper[Firmware]):
    """A sweeper that runs the model of the firmware in Python."""

    def __init__(  # noqa: PLR0913 - one parameter per option of a device
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
        """Boot at time 0, at rest at the plan's start pose.

        Args:
            plan: The room.
            model: The robot; by default the model of the paper's robot.
            seed: The seed of all random values.
            noise: A noise level or its name.
            node: The device's node number.
            catalogue: The declarations of the firmware's version of the project.
            link: The link to the host.
            local: True if only a person beside the robot can use the link; otherwise no key can be
                set.
            boot_id: The boot id; without it, it follows from the seed.
            imu: The IMU settings that the firmware writes.

        Raises:
            FloorPlanError: the robot does not fit at its start pose.
            UnknownNoiseLevelError: no such level.

        """
        self._model = model = model or RobotModel()
        self._imu = imu or ImuConfig()
        self.flash = Flash()
        super().__init__(
            plan,
            model,
            self.flash,
            seed=seed,
            noise=noise,
            node=node,
            link=link,
            boot_id=boot_id,
            imu=self._imu,
        )
        self.catalogue, self._local = catalogue, local
        self._line: DeviceEnd | None = None
        self.firmware = self._new_firmware()

    def attach_line(self, end: DeviceEnd) -> None:
        """Use the counters of this end of the link."""
        self._line = end
        self.firmware.telemetry.counters.line_health = end.health

    def _new_firmware(self) -> Firmware:
        firmware = Firmware(
            self._model,
            self._identity,
            self.sensors,
            self.catalogue,
            flash=self.flash,
            link=self.link,
            clock=self.clock,
            modes=self._modes,
            imu_scale=self._imu.scale,
            local=self._local,
        )
        if self._line is not None:
            self._line.boot()
            firmware.telemetry.counters.line_health = self._line.health
        return firmware
