"""The virtual sweeper with the real firmware: the binary runs on a chip that QEMU emulates.

The interface for link, faults and port is the interface of
:class:`sim_device.sweeper.VirtualSweeper`. The chip's clock determines the time of the plant.
Before each control period, the chip requests the sensor readings at the start of the period. The
plant advances to this time with the present duties and sends the readings. If the chip sends no
requests (it boots, is off, or the computer is busy), the plant follows this computer's clock. So
the robot keeps moving even if its chip has failed.
"""

from __future__ import annotations

import time
from enum import Enum, auto
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.clock import DeviceUs, extend_us
from protocol.messages.values import ResetCause
from sim_device.body.plant import Plant, Truth
from sim_device.body.supply import BROWN_OUT_V, SUPPLY_GOOD_V
from sim_device.core.core_firmware import DUTY_ONE, PAGE_SIZE, PAGES
from sim_device.device.clock import DeviceClock
from sim_device.noise import noise_level
from sim_device.ports import qemu_link as link
from sim_device.ports.qemu_process import QemuGoneError, QemuProcess
from sim_device.sensors.sensors import SensorSuite
from sim_device.world.world import World

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from sim_device.line.device_end import DeviceEnd

CANNOT = "the emulated chip keeps its own time; --target python has this fault"
CANNOT_IMU = "the emulated chip reads a sample in each period; --target python has this fault"
START_S = 10.0
"""Maximum time from QEMU's start to the chip's first message, s; 0.2 s was measured on an idle
computer."""
TURN_US = 10_000
"""Period at which the plant advances while the chip is silent, µs."""
SILENCE_US = 50_000
"""Time without a request after which the plant advances without the chip, µs: five missed
requests."""
LOST_US = 200_000
"""Time after which unconfirmed readings count as lost, µs, for example because of a reset."""
DEAD_US = 2_000_000
"""Time without a request after which a running chip counts as dead, µs. The cause is that its
interrupts stay disabled. The emulated watchdog counts in an interrupt, so it cannot detect this.
The time is long because a busy computer may suspend QEMU."""
GATHER_S = 0.0002
"""Time to wait for the rest of a frame, s. QEMU delivers single bytes, and a wake-up for each byte
would be slow."""
POWER_PERIODS = 10
_WRAP = 1 << 32


class _Chip(Enum):
    BOOTING = auto()
    RUNNING = auto()
    OFF = auto()


def _boot_id(rng: np.random.Generator) -> int:
    return int(rng.integers(1, _WRAP))


class QemuSweeper:
    """A plant in a room, with a chip in a QEMU process. Times are since the start of the plant."""

    def __init__(  # noqa: PLR0913 - options of a device
        self,
        firmware: Path,
        plan: FloorPlan,
        model: RobotModel | None = None,
        *,
        seed: int = 0,
        noise: str = "typical",
        node: int = 1,
        boot_id: int | None = None,
    ) -> None:
        """Start QEMU with ``firmware``; the chip gets its identity in :meth:`step`.

        Raises:
            UnknownNoiseLevelError: no such noise level.
            FloorPlanError: the robot does not fit at its start pose.
            QemuGoneError: QEMU is not installed, or does not run this firmware.

        """
        model = model or RobotModel()
        level = noise_level(noise)
        identity_rng, plant_rng, sensor_rng = np.random.default_rng(seed).spawn(3)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self.sensors = SensorSuite(self.plant, model, level, sensor_rng)
        self.clock = DeviceClock()
        """Unused device clock: faults cannot change the chip's clock; see ``cannot``."""
        self.cannot: Mapping[str, str] = {
            "clock-drift": CANNOT,
            "clock-jump": CANNOT,
            "hse-failed": CANNOT,
            "i2c-stuck": CANNOT_IMU,
            "imu-clock": CANNOT_IMU,
        }
        """Kinds of fault that this device rejects, each with the reason."""
        self.flash = [bytearray(b"\xff" * PAGE_SIZE) for _ in range(PAGES)]
        self.drivers = False
        """True if the motor drivers are enabled."""
        self.stack_free = 0
        """Number of bytes of the chip's stack that have never been used, reported by the chip."""
        self._node, self._uid = node, identity_rng.bytes(12)
        self._boot_id = boot_id or _boot_id(identity_rng)
        self._identity_rng = identity_rng
        self._cause = ResetCause.POWER_ON
        self._state = _Chip.BOOTING
        self._on_us = 0
        """Time at which a switched-off chip starts again, µs."""
        self._now_us = self._deadline_us = 0
        self._received_us = 0
        """Time at which the chip last requested readings, or booted, µs."""
        self._base_us: int | None = None
        """Time of the plant when the chip's clock was 0; None until its first request."""
        self._chip_us = 0
        """Time of the chip's clock at its last request, µs, extended beyond 32 bits."""
        self._answered_us = 0
        """Time of the chip's clock for the last readings that were sent, µs."""
        self._answered_at_us = -LOST_US
        """Time at which these readings were sent, µs."""
        self._periods = 0
        self._imu_sample = (0, 0)
        """Number of the IMU's newest sample, and the time of its reading by the chip's clock,
        µs."""
        self._parser = link.Parser()
        self._out = bytearray()
        self._asked = False
        self.qemu = QemuProcess(firmware)
        try:
            self._await_chip()
        except QemuGoneError as error:
            self.qemu.close()
            raise QemuGoneError(f"{firmware} does not run: {error}") from None

    # ---- like a virtual sweeper -----------------------------------------------------------

    def step(self, data: bytes, now_us: int) -> bytes:
        """Advance to ``now_us``, then send ``data`` to the chip; return the bytes that it has sent.

        Raises:
            QemuGoneError: QEMU has ended.

        """
        self._now_us = now_us
        self._deadline_us = now_us + TURN_US
        self._listen()
        self._keep_pace()
        if data and self._state is _Chip.RUNNING:
            self.qemu.wire.write(data)
        out = bytes(self._out)
        self._out.clear()
        return out

    def attach_line(self, end: DeviceEnd) -> None:
        """Do nothing, because the chip has its own counters."""

    def next_deadline_us(self) -> int:
        """Return the time of the next work."""
        return self._deadline_us

    @property
    def truth(self) -> Truth:
        """Return the true state."""
        return self.plant.truth

    def reset(self, cause: ResetCause, off_s: float = 0.0, *, boot_id: int | None = None) -> None:
        """Reset the chip without a change of the plant; the chip starts again after ``off_s``.

        After ``POWER_ON`` and ``BROWN_OUT`` the chip also waits for its supply voltage.
        """
        self._begin_anew(cause, boot_id)
        self._out.clear()
        if cause in {ResetCause.POWER_ON, ResetCause.BROWN_OUT}:
            self._state = _Chip.OFF
            self._on_us = self._now_us + round(off_s * 1e6)
            self.qemu.halt()
        else:
            self.qemu.reset()

    def hang(self) -> None:
        """Freeze the firmware until its watchdog resets it; the outputs do not change."""
        self.qemu.plant.write(link.frame(link.ToChip.HANG))

    def crash(self) -> None:
        """Cause a processor fault by an invalid instruction."""
        self.qemu.plant.write(link.frame(link.ToChip.CRASH))

    def fail_crystal(self, drift_ppm: float) -> None:
        """Not supported; never called, see ``cannot``."""
        raise NotImplementedError(drift_ppm)

    # ---- interface of the serving loop -------------------------------------------------------

    def filenos(self) -> list[int]:
        """File descriptors that become readable when the chip has sent bytes."""
        return self.qemu.filenos()

    def poll(self, now_us: int) -> None:
        """Record that the chip has sent bytes; the next step, at ``now_us``, reads them."""
        time.sleep(GATHER_S)
        self._deadline_us = min(self._deadline_us, now_us)

    @property
    def pid(self) -> int:
        """Process id of QEMU."""
        return self.qemu.pid

    def close(self) -> None:
        """End QEMU."""
        self.qemu.close()

    # ---- the chip ---------------------------------------------------------------------------

    def _await_chip(self) -> None:
        """Wait for the chip's first message."""
        until_s = time.monotonic() + START_S
        while not self._asked:
            if time.monotonic() > until_s:
                raise QemuGoneError(f"the chip sent nothing for {START_S:g} s")
            time.sleep(0.005)
            self.qemu.check()
            for message in self._parser.feed(self.qemu.plant.read()):
                if isinstance(message, link.ChipBoot):
                    if message.version != link.VERSION:
                        raise QemuGoneError(
                            f"it speaks version {message.version} of the link to the plant, this "
                            f"emulator {link.VERSION}; rebuild it"
                        )
                    self._asked = True

    def _begin_anew(self, cause: ResetCause, boot_id: int | None = None) -> None:
        """Apply a reset to the plant and to pending work."""
        self.plant.set_duty(0.0, 0.0)
        self.drivers = False
        self._cause, self._boot_id = cause, boot_id or _boot_id(self._identity_rng)
        self._state = _Chip.BOOTING
        self._base_us = None
        self._asked = False
        self._received_us = self._now_us

    def _listen(self) -> None:
        self.qemu.check()
        messages = list(self._parser.feed(self.qemu.plant.read()))
        # read again: the chip's last data before its reset
        said = self.qemu.wire.read()
        if self._state is _Chip.RUNNING:
            self._out += said
        newest = max(
            (i for i, m in enumerate(messages) if isinstance(m, link.PlantRequest)), default=0
        )
        for place, message in enumerate(messages):
            self._take(message, answered=place >= newest)
        if self._asked and self._state is _Chip.BOOTING:
            self._asked = False
            self._send_identity()

    def _take(self, message: link.Message, *, answered: bool) -> None:
        if isinstance(message, link.ChipBoot):
            if self._state is _Chip.RUNNING:  # restart without a reset message: a fault
                self._begin_anew(ResetCause.SOFTWARE)
            self._asked = True
        elif self._state is not _Chip.RUNNING:
            return  # last message before a reset
        elif isinstance(message, link.PlantRequest):
            self._request(message)
            if answered and self._wanted(message):
                self._send_readings(self._extended(message.sample_us))
        elif isinstance(message, link.Motors):
            self._advance(self._extended(message.now_us))
            self._set_motors(message)
        elif isinstance(message, link.Erase):
            self.flash[message.page][:] = b"\xff" * PAGE_SIZE
        elif isinstance(message, link.Write):
            end = message.offset + len(message.data)
            self.flash[message.page][message.offset : end] = message.data
        else:
            known = message.cause in set(ResetCause)
            self._begin_anew(ResetCause(message.cause) if known else ResetCause.SOFTWARE)

    def _send_identity(self) -> None:
        plant = self.qemu.plant
        chunks = link.pages(self.flash)
        for chunk in chunks:
            plant.write(chunk)
        plant.write(link.identity(self._uid, self._boot_id, self._cause, self._node, len(chunks)))
        self._state = _Chip.RUNNING
        self._received_us = self._now_us

    def _request(self, request: link.PlantRequest) -> None:
        if self._base_us is None:
            self._chip_us = request.now_us
            self._base_us = self._now_us - request.now_us
        chip_us = self._extended(request.now_us)
        ahead_us = 1000 * self.plant.tick_ms - (self._base_us + chip_us)
        if ahead_us > SILENCE_US:  # the plant has advanced while the chip's clock stood still
            self._base_us += ahead_us
        self._chip_us = chip_us
        self._received_us = self._now_us
        self.stack_free = request.stack_free
        self._set_motors(request)
        self._advance(self._extended(request.sample_us))

    def _wanted(self, request: link.PlantRequest) -> bool:
        """Return whether to answer a request: a slow chip gets fewer answers.

        A request is answered only if the chip has received the previous readings, or these are
        lost. Otherwise readings would accumulate in QEMU's queue, and all of them would be late.
        """
        had = request.newest_us == self._answered_us % _WRAP
        return had or self._now_us - self._answered_at_us > LOST_US

    def _send_readings(self, at_us: int) -> None:
        """Send the readings at ``at_us`` to the chip."""
        self._answered_us, self._answered_at_us = at_us, self._now_us
        sensors, plant = self.sensors, self.qemu.plant
        imu = sensors.imu()
        samples = sensors.imu_samples()
        number, fetched_us = self._imu_sample
        if samples != number or at_us < fetched_us:  # the chip's clock restarts at a boot
            fetched_us = at_us
        self._imu_sample = samples, fetched_us
        plant.write(
            link.sample(
                at_us,
                sensors.encoders(),
                imu,
                sensors.ranges(),
                sensors.bumpers(),
                cliff=sensors.cliff(),
                imu_age_us=at_us - fetched_us,
            )
        )
        if self._periods % POWER_PERIODS == 0:
            plant.write(link.power(at_us, sensors.power()))
        self._periods += 1

    def _set_motors(self, motors: link.PlantRequest | link.Motors) -> None:
        self.plant.set_duty(motors.left / DUTY_ONE, motors.right / DUTY_ONE)
        self.drivers = motors.drivers

    # ---- time -------------------------------------------------------------------------------

    def _extended(self, chip_us: int) -> int:
        """Extend a 32-bit time of the chip's clock to the value nearest to its last time."""
        return extend_us(DeviceUs(self._chip_us), chip_us)

    def _advance(self, chip_us: int) -> None:
        """Advance the plant to a time of the chip's clock, if the plant is not already later."""
        if self._base_us is not None:
            self._advance_to(self._base_us + chip_us)

    def _advance_to(self, body_us: int) -> None:
        missing_ms = body_us // 1000 - self.plant.tick_ms
        if missing_ms > 0:
            self.plant.advance_ms(missing_ms)

    def _keep_pace(self) -> None:
        """Advance plant and supply independently of the chip."""
        silent_us = self._now_us - self._received_us
        if self._state is not _Chip.RUNNING or silent_us > SILENCE_US:
            self._advance_to(self._now_us)
        if self._state is _Chip.OFF:
            if self._now_us >= self._on_us and self.plant.rail_5v_v >= SUPPLY_GOOD_V:
                self._state = _Chip.BOOTING
                self._received_us = self._now_us
                self.qemu.reset()
                self.qemu.resume()
        elif self.plant.rail_5v_v < BROWN_OUT_V:
            self.reset(ResetCause.BROWN_OUT)
        elif silent_us > DEAD_US:
            self._begin_anew(ResetCause.WATCHDOG)
            self.qemu.reset()
