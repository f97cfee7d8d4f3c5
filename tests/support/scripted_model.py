"""Runs the Python firmware on the scripts of the C firmware's script board, and compares both."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from bridge.motion.robot_model import RobotModel
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.messages.values import Contact, RebootKind, ResetCause
from protocol.uart.link import Link
from sim_device.core.core_firmware import DUTY_ONE, STATES
from sim_device.device.flash import Flash
from sim_device.device.identity import Identity
from sim_device.device.virtual_firmware import TICK_US, Firmware
from sim_device.sensors.contacts import Bumpers
from sim_device.sensors.imu import ImuCounts
from sim_device.sensors.power_monitor import PowerReading
from sim_device.sensors.rangers import Ranges
from support.core_build import script_board
from support.script_format import (
    NO_RANGE,
    Boot,
    Held,
    LoseSupply,
    Readings,
    Reported,
    Step,
    frames,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sim_device.device.watchdog import Watchdog
    from support.script_format import Act

UID = b"script-board"
_V_STEP, _YAW_STEP, _DUTY_STEP = 0.0001, 0.0002, 0.0001


class PaperSensors:
    """Sensors that return the readings in the script."""

    def __init__(self) -> None:
        self.now = Readings()
        self._samples = 0

    def imu(self) -> ImuCounts:
        return ImuCounts(*self.now.imu)

    def imu_samples(self) -> int:
        self._samples += 1
        return self._samples

    def encoders(self) -> tuple[int, int]:
        left, right = self.now.encoders
        return left & 0xFFFF, right & 0xFFFF

    def ranges(self) -> Ranges:
        left, right = self.now.infrared_dmm
        return Ranges(
            seen(self.now.ultrasonic_mm, 1e3),
            seen(left, 1e4),
            seen(right, 1e4),
            self.now.ultrasonic_age_us,
        )

    def bumpers(self) -> Bumpers:
        contacts = self.now.contacts
        return Bumpers(bool(contacts & Contact.BUMPER_LEFT), bool(contacts & Contact.BUMPER_RIGHT))

    def cliff(self) -> bool:
        return bool(self.now.contacts & Contact.CLIFF)

    def power(self) -> PowerReading:
        now = self.now
        left, right = now.motors_ma
        return PowerReading(now.battery_mv / 1e3, now.logic_mv / 1e3, left / 1e3, right / 1e3)


def seen(reading: int, per_m: float) -> float | None:
    return None if reading == NO_RANGE else reading / per_m


def pieces(data: bytes, *, can: bool) -> list[bytes]:
    """Return one frame after the other: a describe message affects the frames after it."""
    if can:
        size = RECORD.size
        whole = len(data) - len(data) % size
        return [data[i : i + size] for i in range(0, whole, size)]
    return re.findall(rb"[^\0]*\0|[^\0]+", data)


class ScriptedModel:
    """Runs a script on the Python firmware."""

    def __init__(self) -> None:
        self.sensors = PaperSensors()
        self._now_us = 0
        self._reboots = 0
        self._duties = (0.0, 0.0)
        self._flash = Flash()
        self._boot_id, self._cause, self._can = 1, ResetCause.POWER_ON, False
        self._boot()

    def run(self, acts: Iterable[Act]) -> list[Reported]:
        """Run the whole script; return the state after each step."""
        reported: list[Reported] = []
        for act in acts:
            match act:
                case Boot():
                    self._boot_id, self._cause = act.boot_id, ResetCause(act.reset_cause)
                    self._can = act.can
                    if act.empty_flash:
                        self._flash = Flash()
                    self._flash.power_lost()
                    self._boot()
                case Readings():
                    self.sensors.now = act
                case Step():
                    reported.append(self._step(act))
                case LoseSupply():
                    raise NotImplementedError("pages of flash differ")
        return reported

    def _boot(self) -> None:
        self._booted_us = self._due_us = self._now_us
        self._duties = (0.0, 0.0)
        self.firmware = Firmware(
            RobotModel(),
            Identity(1, UID, self._boot_id, self._cause),
            self.sensors,
            flash=self._flash,
            link=CanLink if self._can else Link,
        )

    def _step(self, step: Step) -> Reported:
        until_us = self._now_us + step.for_us
        wrote = b""
        while self._due_us <= until_us:
            self._duties = self.firmware.tick(self._due_us - self._booted_us)
            self._due_us += TICK_US
            if self._can:  # the frames of one period leave in order of priority
                wrote += self.firmware.data_to_send()
        self._now_us = until_us
        for piece in pieces(step.data, can=self._can):
            self.firmware.receive(piece, until_us - self._booted_us)
        reported = self._report(wrote + self.firmware.data_to_send())
        if self.firmware.reboot_wanted is not None:
            if self.firmware.reboot_wanted is RebootKind.FACTORY_RESET:
                self._flash.erase()
            self._reboots += 1
            self._boot_id += 1
            self._cause = ResetCause.SOFTWARE
            self._boot()
        return reported

    def _report(self, wrote: bytes) -> Reported:
        firmware, control = self.firmware, self.firmware.control
        stale = firmware.telemetry.counters.stale
        present = firmware.parameters.present
        left, right = self._duties
        return Reported(
            self._now_us - self._booted_us,
            firmware.session_id,
            firmware.negotiated,
            STATES.index(control.modes.state),
            int(control.latch.cause),
            control.fault_bits,
            stale & 0xFFFF,
            self._reboots,
            _held(control.setpoints, _V_STEP, _YAW_STEP),
            _held(control.duties, _DUTY_STEP, _DUTY_STEP),
            tuple(present),
            (round(left * DUTY_ONE), round(right * DUTY_ONE)),
            control.drivers.enabled,
            wrote,
        )


def compare(acts: list[Act], *, can: bool = False) -> list[Reported]:
    """Run both firmwares and compare their state and output after each step.

    Returns the reports of the C firmware.
    """
    cores, models = script_board().run(acts), ScriptedModel().run(acts)
    assert len(cores) == len(models)
    for number, (core, model) in enumerate(zip(cores, models, strict=True)):
        assert frames(core.wrote, can=can) == frames(model.wrote, can=can), number
        assert core._replace(wrote=b"", motors=(0, 0)) == model._replace(wrote=b"", motors=(0, 0))
        # The C core computes in single precision and the Python model in double precision. So a
        # duty may differ by one step, 1/10 000.
        assert core.motors == pytest.approx(model.motors, abs=1), number
    return cores


def _held(watchdog: Watchdog, first_step: float, second_step: float) -> Held:
    counter = watchdog.counter
    return Held(
        round(watchdog.first / first_step),
        round(watchdog.second / second_step),
        0x100 if counter is None else counter,
        watchdog.until_us,
    )
