"""The `paper` level against the paper's drift: 7 U-shaped cycles end 5 to 9 mm off."""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING

from bridge.motion.robot_model import RobotModel
from support.sim_body import duty, plant, room, sensors

if TYPE_CHECKING:
    from sim_device.plant import Plant
    from sim_device.sensors import SensorSuite

LANE_M, STEP_M = 1.77, 0.16
"""14 lanes and their side steps are 27 m."""
MODEL = RobotModel()


class DeadReckoning:
    """A host as plain as can be: wheel counts for distance, the gyro for heading."""

    def __init__(self, body: Plant, suite: SensorSuite, *, rest_s: float) -> None:
        self.body, self.suite = body, suite
        self.x_m = self.y_m = self.theta_rad = 0.0
        samples = []
        for _ in range(round(100 * rest_s)):
            body.advance_ms(10)
            samples.append(suite.imu().gyro_z)
        self.bias = statistics.fmean(samples)
        self.counts = suite.encoders()

    def drive(self, ms: int) -> None:
        self.body.advance_ms(ms)
        counts = self.suite.encoders()
        ahead = 0.0
        for now, before in zip(counts, self.counts, strict=True):
            ahead += 0.5 * ((now - before + 0x8000) % 0x10000 - 0x8000) * MODEL.metres_per_count
        self.counts = counts
        turn = math.radians((self.suite.imu().gyro_z - self.bias) / 131.0) * 0.001 * ms
        mid = self.theta_rad + 0.5 * turn
        self.x_m += ahead * math.cos(mid)
        self.y_m += ahead * math.sin(mid)
        self.theta_rad += turn


def run_cycles(seed: int, level: str, *, rest_s: float = 5.0) -> tuple[float, float, float]:
    """Position error (mm), yaw drift (°/s) and path (m) after 7 cycles steered by the truth."""
    body = plant(room((5.0, 5.0, 0.0)), level=level, seed=seed, battery=None)
    host = DeadReckoning(body, sensors(body, level=level, seed=1000 + seed), rest_s=rest_s)
    began_ms, cruise, turning = body.tick_ms, duty(0.2), duty(0.12)

    def straight(distance_m: float) -> None:
        until = body.truth.path_m + distance_m
        body.set_duty(cruise, cruise)
        while body.truth.path_m < until:
            host.drive(50)  # the gyro's sample is the mean over them

    def turn_to(heading_rad: float) -> None:
        sign = 1.0 if heading_rad > body.truth.heading_rad else -1.0
        body.set_duty(-sign * turning, sign * turning)
        while sign * (heading_rad - body.truth.heading_rad) > 0.03:
            host.drive(10)
        body.set_duty(0.0, 0.0)
        host.drive(100)

    for lane in range(14):
        end = math.pi if lane % 2 == 0 else 0.0
        straight(LANE_M)
        turn_to(0.5 * math.pi)
        straight(STEP_M)
        turn_to(end)
    truth = body.truth
    error_m = math.dist((truth.pose.x_m - 5.0, truth.pose.y_m - 5.0), (host.x_m, host.y_m))
    seconds = 0.001 * (truth.tick_ms - began_ms)
    drift = math.degrees(abs(host.theta_rad - truth.heading_rad)) / seconds
    return 1000.0 * error_m, drift, truth.path_m


def test_paper_level_ends_as_far_off_as_the_papers_robot() -> None:
    runs = [run_cycles(seed, "paper") for seed in range(12)]
    assert all(26.0 < path < 28.0 for _, _, path in runs)
    assert 5.0 <= statistics.median(error for error, _, _ in runs) <= 9.0
    assert statistics.median(drift for _, drift, _ in runs) < 0.0014


def test_without_noise_only_quantisation_is_left_and_typical_is_far_worse() -> None:
    clean, _, _ = run_cycles(0, "none")
    typical = statistics.median(run_cycles(seed, "typical")[0] for seed in range(3))
    assert clean < 3.0
    assert typical > 20.0
