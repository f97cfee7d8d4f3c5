"""A pose filter with a wall map, and measurements for it."""

from __future__ import annotations

import math

import numpy as np

from bridge.motion.estimation.ekf import Ekf
from bridge.motion.estimation.wall_map import WallMap
from bridge.motion.estimation.wall_measurements import LineMeasurement
from bridge.motion.geometry import Pose2

ORIGIN = Pose2(0.0, 0.0, 0.0)
DEGREE = math.radians(1.0)
SURE = 0.05 * DEGREE


def line(normal_rad: float, distance_m: float, span_m: float = 0.3) -> LineMeasurement:
    half = 0.5 * span_m
    return LineMeasurement(normal_rad, distance_m, SURE**2, 0.0, 0.001**2, -half, half)


class Room:
    """A filter and its walls; tests can inflate the covariance."""

    def __init__(self) -> None:
        self.filter = Ekf(ORIGIN)
        self.walls = WallMap(self.filter)

    def inflate(self, sigma_m: float, sigma_rad: float) -> None:
        self.filter.inflate(sigma_m, sigma_rad)

    def believe(self, x: float, y: float, theta: float) -> None:
        step = np.zeros(self.filter.joint_covariance.size)
        step[:3] = x, y, theta
        self.filter.apply(step)
