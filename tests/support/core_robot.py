"""The C core in the virtual robot: the sensors measure the plant, the duties drive it."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.robot_model import RobotModel
from protocol.link import Received
from protocol.messages.values import Contact
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.body.plant import Plant
from sim_device.noise import noise_level
from sim_device.sensors.sensors import SensorSuite
from sim_device.world.world import World
from support.script_format import NO_RANGE, REPORTED, Readings, Reported, Step, read

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.schema.message import Message

PERIOD_US = 10_000
_DUTY_ONE = 10_000
_RANGE_PERIODS, _RANGE_PHASE = 5, 4
_POWER_PERIODS, _POWER_PHASE = 20, 5


class CoreRobot:
    """The firmware's program in a child process, which runs one control period after the other."""

    def __init__(
        self, program: Path, plan: FloorPlan, *, seed: int = 0, noise: str = "typical"
    ) -> None:
        model, level = RobotModel(), noise_level(noise)
        plant_rng, sensor_rng = np.random.default_rng(seed).spawn(2)
        self.plant = Plant(World(plan, model), model, level, plant_rng)
        self._sensors = SensorSuite(self.plant, model, level, sensor_rng)
        self._process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self._readings = Readings()
        self._ticks = 0
        self.link = Link(Direction.HOST)
        self.received: list[Message] = []
        self.reported: Reported

    @property
    def now_us(self) -> int:
        """True time, which is also the time of the firmware's clock."""
        return self._ticks * PERIOD_US

    def inform(self, *messages: Message) -> None:
        """Send messages at the end of the current control period."""
        for message in messages:
            self.link.send(message, self.now_us, node=1)

    def live(self, seconds: float) -> None:
        """Run firmware and plant for this time."""
        for _ in range(round(seconds * 1e6 / PERIOD_US)):
            self._period()

    def _period(self) -> None:
        self._sense()
        step = Step(PERIOD_US if self._ticks else 0, self.link.data_to_send())
        self.reported = self._ask(self._readings.record() + step.record())
        self.received += [
            e.message for e in self.link.receive(self.reported.wrote) if isinstance(e, Received)
        ]
        left, right = self.reported.motors
        self.plant.set_duty(left / _DUTY_ONE, right / _DUTY_ONE)
        self.plant.advance_ms(PERIOD_US // 1000)
        self._ticks += 1

    def _sense(self) -> None:
        """Set the board's readings. Slow sensors change only when the firmware reads them."""
        sensors, before = self._sensors, self._readings
        pressed = sensors.bumpers()
        contacts = (
            (Contact.BUMPER_LEFT if pressed.left else 0)
            | (Contact.BUMPER_RIGHT if pressed.right else 0)
            | (Contact.CLIFF if sensors.cliff() else 0)
        )
        ultrasonic_mm, infrared_dmm = before.ultrasonic_mm, before.infrared_dmm
        age_us = before.ultrasonic_age_us + PERIOD_US
        if self._ticks % _RANGE_PERIODS == _RANGE_PHASE:
            now = sensors.ranges()
            age_us = now.ultrasonic_age_us
            ultrasonic_mm = _steps(now.ultrasonic_m, 1e3)
            infrared_dmm = _steps(now.infrared_left_m, 1e4), _steps(now.infrared_right_m, 1e4)
        battery_mv, logic_mv, motors_ma = before.battery_mv, before.logic_mv, before.motors_ma
        if self._ticks % _POWER_PERIODS == _POWER_PHASE:
            supply = sensors.power()
            battery_mv, logic_mv = round(1e3 * supply.battery_v), round(1e3 * supply.rail_v)
            motors_ma = round(1e3 * abs(supply.left_a)), round(1e3 * abs(supply.right_a))
        self._readings = Readings(
            sensors.encoders(),
            sensors.imu(),
            ultrasonic_mm,
            infrared_dmm,
            int(contacts),
            battery_mv,
            logic_mv,
            motors_ma,
            age_us,
        )

    def _ask(self, records: bytes) -> Reported:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(records)
        process.stdin.flush()
        head = process.stdout.read(REPORTED.size)
        assert len(head) == REPORTED.size, "the firmware has ended"
        (reported,) = read(head + process.stdout.read(REPORTED.unpack(head)[-1]))
        return reported

    def close(self) -> None:
        """End the program, which must exit without an error."""
        _, err = self._process.communicate(timeout=20)
        assert self._process.returncode == 0, err.decode()


def _steps(range_m: float | None, per_m: float) -> int:
    return NO_RANGE if range_m is None else min(NO_RANGE - 1, round(range_m * per_m))
