"""The virtual sweeper's plant and sensors, driven by a test, with the host's estimator.

The test steers by the estimate, as a planner does. It uses the true state only for comparison.
Values are rounded as on the wire.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.robot_model import RobotModel
from sim_device.device.wheel_control import WheelControl
from support.sim_body import plant, sensors

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan

MODEL = RobotModel()
_G, _LSB_G, _LSB_DEG = 9.80665, 16384.0, 131.0


@dataclass
class Errors:
    """Errors of the estimate, compared with the true pose at the encoder samples."""

    position_m: list[float] = field(default_factory=list)
    yaw_rad: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    """Normalised estimation error squared (NEES) of (x, y, θ) every two seconds; its mean is 3 for
    a consistent covariance.
    """


class SimDrive:
    """A robot in a room with its estimator and the estimate's errors."""

    def __init__(
        self, plan: FloorPlan, level: str, seed: int, *, walls: bool = True, accel: bool = True
    ) -> None:
        self.body = plant(plan, level=level, seed=seed, battery=None)
        self.suite = sensors(self.body, level=level, seed=1000 + seed)
        self.control = WheelControl(MODEL, 1.0)
        self.estimator = PoseEstimator(MODEL, plan.start)
        self.walls = Relocaliser(MODEL, self.estimator) if walls else None
        self.errors = Errors()
        self.front_m: float | None = None
        self.bumped = False
        self.tick = 0
        self.encoder_gain = (1.0, 1.0)
        """Gains of the left and right encoder counters; a gain other than 1 simulates slip."""
        self._accel = accel
        self._raw = (0, 0)
        self._counts = [0.0, 0.0]

    # -- driving ---------------------------------------------------------------------------

    def step(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Drive for 10 ms at a commanded velocity."""
        raw = self.suite.encoders()
        supply_v = self.body.supply_v
        self.body.set_duty(*self.control.step(v_m_s, yaw_rate_rad_s, raw, supply_v))
        self.body.advance_ms(10)
        self.tick += 1
        t_s = 0.001 * self.body.tick_ms
        imu = self.suite.imu()
        accel = (imu.accel_x / _LSB_G * _G, imu.accel_y / _LSB_G * _G) if self._accel else ()
        self.estimator.on_imu(t_s, math.radians(imu.gyro_z / _LSB_DEG), *accel)
        if self.tick % 2 == 0:
            self.estimator.on_encoders(t_s, *self._counters())
            self._measure()
        if self.tick % 5 == 0:
            self._range(t_s)

    def rest(self, seconds: float) -> None:
        for _ in range(round(100 * seconds)):
            self.step(0.0, 0.0)

    def straight(self, distance_m: float, *, speed_m_s: float = 0.2) -> None:
        """Drive along the estimated heading, rounded to a quarter turn."""
        start = self.estimator.pose
        heading = round(start.theta_rad / (0.5 * math.pi)) * 0.5 * math.pi
        c, s = math.cos(heading), math.sin(heading)
        for _ in range(round(300 * distance_m / speed_m_s)):
            pose = self.estimator.pose
            dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
            left = distance_m - (dx * c + dy * s)
            if left < 0.01 or self.bumped:
                break
            off = math.remainder(heading - pose.theta_rad, math.tau) - 2.0 * (dy * c - dx * s)
            self.step(min(speed_m_s, 0.05 + 1.5 * left), 3.0 * off)
        self.rest(0.3)

    def turn_to(self, heading_rad: float) -> None:
        for _ in range(800):
            error = math.remainder(heading_rad - self.estimator.pose.theta_rad, math.tau)
            if abs(error) < 0.01:
                break
            self.step(0.0, max(min(4.0 * error, 1.2), -1.2) + math.copysign(0.1, error))
        self.rest(0.4)

    # -- internal ---------------------------------------------------------------------------

    def _counters(self) -> tuple[int, int]:
        """Return the encoder counters as on the wire, with simulated slip."""
        raw = self.suite.encoders()
        for side in (0, 1):
            delta = (raw[side] - self._raw[side] + 0x8000) % 0x10000 - 0x8000
            self._counts[side] += delta * self.encoder_gain[side]
        self._raw = raw
        left, right = (math.floor(count) & 0xFFFF for count in self._counts)
        return left, right

    def _range(self, t_s: float) -> None:
        pressed = self.suite.bumpers()
        self.bumped = pressed.left or pressed.right
        halves = {"bumper_left": pressed.left, "bumper_right": pressed.right}
        if self.walls is None:
            return
        ranges = self.suite.ranges()
        front = ranges.ultrasonic_m
        self.front_m = None if front is None else round(front, 3)
        sides = [
            None if r is None else round(r / 0.00125) * 0.00125
            for r in (ranges.infrared_left_m, ranges.infrared_right_m)
        ]
        age_s = 1e-6 * ranges.ultrasonic_age_us
        self.walls.update(self.front_m, *sides, **halves, t_s=t_s, ultrasonic_age_s=age_s)

    def _measure(self) -> None:
        truth, pose = self.body.pose, self.estimator.pose
        error = np.array(
            [
                pose.x_m - truth.x_m,
                pose.y_m - truth.y_m,
                math.remainder(pose.theta_rad - truth.theta_rad, math.tau),
            ]
        )
        self.errors.position_m.append(math.hypot(error[0], error[1]))
        self.errors.yaw_rad.append(abs(float(error[2])))
        if self.tick % 200 == 0:
            self.estimator.ekf.propagate_covariance()
            covariance = np.array(self.estimator.covariance)
            if covariance[0, 0] > 1e-8 and covariance[1, 1] > 1e-8:
                self.errors.nees.append(float(error @ np.linalg.solve(covariance, error)))
