"""A person who walks in front of the robot, for the fault ``person``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_device.faults.knobs import Walker
    from sim_device.rigged import RiggedDevice

STEP_US = 20_000
"""Simulation step of a walking person, µs: 16 mm at 0.8 m/s."""
BODY_GAP_M = 0.02
"""Gap at which a person stops in front of the robot, m."""


class PersonPath:
    """Path of a walker: back and forth across the robot's heading at the fault's start."""

    def __init__(self, walker: Walker, device: RiggedDevice, now_us: int) -> None:
        """Begin on the left of the robot's heading."""
        pose = device.plant.pose
        self._walker, self._device = walker, device
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        self._x_m, self._y_m = pose.x_m + walker.ahead_m * c, pose.y_m + walker.ahead_m * s
        self._along = (-s, c)
        self._offset_m = walker.reach_m  # the walker comes from the left
        self._direction = -1.0
        self._last_us = now_us
        self.next_us = now_us + STEP_US
        """Time of the next step, µs."""

    def step(self, now_us: int) -> None:
        """Move the person up to ``now_us``. It stops in front of the robot."""
        walker, plant = self._walker, self._device.plant
        gone_m = walker.speed_m_s * (now_us - self._last_us) * 1e-6
        self._last_us, self.next_us = now_us, now_us + STEP_US
        offset_m = self._offset_m + self._direction * gone_m
        direction = self._direction
        if abs(offset_m) > walker.reach_m:
            offset_m = math.copysign(max(0.0, 2.0 * walker.reach_m - abs(offset_m)), offset_m)
            direction = -direction
        x_m, y_m = self._at(offset_m)
        pose = plant.pose
        apart_m = plant.world.radius_m + walker.radius_m + BODY_GAP_M
        free = math.hypot(x_m - pose.x_m, y_m - pose.y_m) > apart_m
        if free:
            self._offset_m, self._direction = offset_m, direction
        plant.set_walker(*self._at(self._offset_m), walker.radius_m)

    def _at(self, offset_m: float) -> tuple[float, float]:
        return self._x_m + self._along[0] * offset_m, self._y_m + self._along[1] * offset_m
