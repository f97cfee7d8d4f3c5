"""An emulated device on a stand with wiring faults, and a scripted person beside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.floor_plan.floor_plan import parse_floorplan
from sim_device.sensors.contacts import Bumpers
from sim_device.sensors.imu import ImuCounts
from sim_device.sweeper import VirtualSweeper

if TYPE_CHECKING:
    from sim_device.sensors.rangers import Ranges

PLAN = parse_floorplan('{"walls": [[0,0],[8,0],[8,8],[0,8]], "start": [4,4,0]}')
_TURN_RATE, _TURN_MS = 90.0, 1000
_TILT = 0.4
_SOON_MS = 600
"""Time that the person needs after a request, ms."""
_HELD_MS = 2000
_HAND_COUNTS = 2
"""Encoder counts between two samples while the person turns a wheel by hand."""
_LSB_G, _LSB_DEG = 16384, 131.0


class Stand:
    """Wrapper of a device's sensors and motors; ``wrong`` names the wiring faults."""

    def __init__(self, *wrong: str, seed: int = 3, noise: str = "typical") -> None:
        self.device = VirtualSweeper(PLAN, noise=noise, seed=seed)
        self.wrong = frozenset(wrong)
        self.device.plant.faults.lifted = True  # the cliff sensor is covered with paper
        self._hand: tuple[str, int] = ("", 0)
        self._by_hand = {"left": 0, "right": 0}
        plant, sensors = self.device.plant, self.device.sensors
        self._set_duty = plant.set_duty
        self._encoders, self._imu = sensors.encoders, sensors.imu
        self._ranges, self._bumpers = sensors.ranges, sensors.bumpers
        for thing, name, method in (
            (plant, "set_duty", self._drive),
            (sensors, "encoders", self._count),
            (sensors, "imu", self._feel),
            (sensors, "ranges", self._see),
            (sensors, "bumpers", self._press),
            (sensors, "cliff", self._floorless),
        ):
            setattr(thing, name, method)
        self._angles = plant.wheel_angles_rad

    # ---- the person -----------------------------------------------------------------------

    def confirm(self, text: str) -> bool:
        """Do the action that the text requests."""
        self._hand = (text, self.device.plant.tick_ms + _SOON_MS)
        self._angles = self.device.plant.wheel_angles_rad
        return True

    def choose(self, _text: str) -> str:
        """Return the wheel that turned, and its direction."""
        left, right = (
            now - before
            for now, before in zip(self.device.plant.wheel_angles_rad, self._angles, strict=True)
        )
        if max(abs(left), abs(right)) < 0.3:
            return "n"
        wheel, angle = ("l", left) if abs(left) > abs(right) else ("r", right)
        return wheel + ("f" if angle > 0.0 else "b")

    def _asked(self, *words: str) -> bool:
        text, at_ms = self._hand
        here = 0 <= self.device.plant.tick_ms - at_ms < _HELD_MS
        return here and all(word in text for word in words)

    # ---- the wires ------------------------------------------------------------------------

    def _drive(self, left: float, right: float) -> None:
        if "motors swapped" in self.wrong:
            left, right = right, left
        if "left motor inverted" in self.wrong:
            left = -left
        if "right motor inverted" in self.wrong:
            right = -right
        if "left motor dead" in self.wrong:
            left = 0.0
        self._set_duty(left, right)

    def _count(self) -> tuple[int, int]:
        for side, turned in self._by_hand.items():
            if self._asked("by hand", side.upper()):
                self._by_hand[side] = turned + _HAND_COUNTS
        left, right = (
            (count + by_hand) & 0xFFFF
            for count, by_hand in zip(self._encoders(), self._by_hand.values(), strict=True)
        )
        if "left encoder inverted" in self.wrong:
            left = -left & 0xFFFF
        if "right encoder inverted" in self.wrong:
            right = -right & 0xFFFF
        if "right encoder dead" in self.wrong:
            right = 0
        return (right, left) if "encoders swapped" in self.wrong else (left, right)

    def _feel(self) -> ImuCounts:
        ax, ay, az, temperature, gx, gy, gz = self._imu()
        hand, at_ms = self._hand
        if "COUNTER-CLOCKWISE" in hand and 0 <= self.device.plant.tick_ms - at_ms < _TURN_MS:
            gz += round(_TURN_RATE * _LSB_DEG)
        if self._asked("Raise", "FRONT"):
            ax += round(math.sin(_TILT) * _LSB_G)
            az -= round((1.0 - math.cos(_TILT)) * _LSB_G)
        if self._asked("Raise", "LEFT side"):
            ay += round(math.sin(_TILT) * _LSB_G)
            az -= round((1.0 - math.cos(_TILT)) * _LSB_G)
        if "imu upside down" in self.wrong:  # rotated by 180° about the x axis
            ay, az, gy, gz = -ay, -az, -gy, -gz
        if "imu turned" in self.wrong:  # rotated by 90° about the z axis
            ax, ay, gx, gy = ay, -ax, gy, -gx
        if "gyro inverted" in self.wrong:
            gz = -gz
        return ImuCounts(ax, ay, az, temperature, gx, gy, gz)

    def _see(self) -> Ranges:
        ranges = self._ranges()
        if self._asked("hand", "FRONT") and "ultrasonic dead" not in self.wrong:
            ranges = ranges._replace(ultrasonic_m=0.1)
        if self._asked("hand", "LEFT"):
            ranges = ranges._replace(infrared_left_m=0.1)
        if self._asked("hand", "RIGHT"):
            ranges = ranges._replace(infrared_right_m=0.1)
        if "infrared swapped" in self.wrong:
            ranges = ranges._replace(
                infrared_left_m=ranges.infrared_right_m, infrared_right_m=ranges.infrared_left_m
            )
        return ranges

    def _press(self) -> Bumpers:
        left, right = self._asked("Press", "LEFT"), self._asked("Press", "RIGHT")
        if "bumper stuck" in self.wrong:
            left = True
        return Bumpers(right, left) if "bumpers swapped" in self.wrong else Bumpers(left, right)

    def _floorless(self) -> bool:
        if "cliff dead" in self.wrong:
            return False
        text, at_ms = self._hand
        # The person removes the paper soon after the robot detects it, unless the paper must stay.
        return (
            "cliff sensor" in text
            and "COVER" not in text
            and self.device.plant.tick_ms > at_ms + _SOON_MS
        )
