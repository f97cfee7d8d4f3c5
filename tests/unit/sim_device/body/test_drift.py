"""The noise level `paper` against the drift in the paper: 5 to 9 mm after 7 U-shaped cycles."""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING, NamedTuple

import pytest

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.robot_model import RobotModel
from support.sim_body import duty, plant, room, sensors

if TYPE_CHECKING:
    from sim_device.body.plant import Plant
    from sim_device.sensors.sensors import SensorSuite

pytestmark = pytest.mark.slow

LANE_M, STEP_M = 1.77, 0.16
"""Lengths of a lane and of a side step, m. 14 lanes and their side steps are 27 m."""
MODEL = RobotModel()
REST_MS = 5000
TURNING_MS, STRAIGHT_MS = 20, 60
"""Time between samples of both streams, ms. A gyro sample is the mean over this time."""


class DeadReckoning:
    """The simplest host: encoder counts give the distance, and the gyro gives the heading.

    The gyro bias is the mean over the standstill before the first motion, and stays constant.
    """

    def __init__(self) -> None:
        self.pose = Pose2(0.0, 0.0, 0.0)
        self._rest_sum = self._rest_count = 0
        self._turn_rad = 0.0
        self._t_ms = 0
        self._counts: tuple[int, int] | None = None

    def on_imu(self, t_ms: int, gyro_z: int) -> None:
        dt_ms, self._t_ms = t_ms - self._t_ms, t_ms
        if t_ms <= REST_MS:
            self._rest_sum += gyro_z
            self._rest_count += 1
            return
        rate = gyro_z - self._rest_sum / self._rest_count
        self._turn_rad += math.radians(rate / 131.0) * 0.001 * dt_ms

    def on_encoders(self, _t_ms: int, counts: tuple[int, int]) -> None:
        ahead = 0.0
        for now, before in zip(counts, self._counts or counts, strict=True):
            ahead += 0.5 * ((now - before + 0x8000) % 0x10000 - 0x8000) * MODEL.metres_per_count
        self._counts = counts
        x_m, y_m, theta = self.pose
        mid = theta + 0.5 * self._turn_rad
        self.pose = Pose2(
            x_m + ahead * math.cos(mid), y_m + ahead * math.sin(mid), theta + self._turn_rad
        )
        self._turn_rad = 0.0


class Estimating:
    """The host's estimator with samples in the protocol's units and without wall measurements."""

    def __init__(self) -> None:
        self._estimator = PoseEstimator(MODEL, Pose2(0.0, 0.0, 0.0))

    def on_imu(self, t_ms: int, gyro_z: int) -> None:
        self._estimator.on_imu(0.001 * t_ms, math.radians(gyro_z / 131.0))

    def on_encoders(self, t_ms: int, counts: tuple[int, int]) -> None:
        self._estimator.on_encoders(0.001 * t_ms, *counts)

    @property
    def pose(self) -> Pose2:
        return self._estimator.pose


class Ends(NamedTuple):
    """Errors at the end of a run."""

    plain_mm: float
    """Position error of dead reckoning, mm."""
    estimated_mm: float
    """Position error of the host's estimator, mm."""
    drift_deg_s: float
    path_m: float


def advance(
    body: Plant, suite: SensorSuite, hosts: tuple[DeadReckoning, Estimating], ms: int
) -> None:
    body.advance_ms(ms)
    t_ms, gyro_z, counts = body.tick_ms, suite.imu().gyro_z, suite.encoders()
    for host in hosts:
        host.on_imu(t_ms, gyro_z)
        host.on_encoders(t_ms, counts)


def run_cycles(seed: int, level: str) -> Ends:
    """Rest for 5 s, and then drive 7 cycles that are controlled by the true pose."""
    body = plant(room((5.0, 5.0, 0.0)), level=level, seed=seed, battery=None)
    suite = sensors(body, level=level, seed=1000 + seed)
    hosts = DeadReckoning(), Estimating()
    cruise, turning = duty(0.2), duty(0.12)

    def wait(ms: int) -> None:
        for _ in range(ms // TURNING_MS):
            advance(body, suite, hosts, TURNING_MS)

    def straight(distance_m: float) -> None:
        until = body.truth.path_m + distance_m
        body.set_duty(cruise, cruise)
        while body.truth.path_m < until:
            advance(body, suite, hosts, STRAIGHT_MS)

    def turn_to(heading_rad: float) -> None:
        sign = 1.0 if heading_rad > body.truth.heading_rad else -1.0
        body.set_duty(-sign * turning, sign * turning)
        while sign * (heading_rad - body.truth.heading_rad) > 0.03:
            wait(TURNING_MS)
        body.set_duty(0.0, 0.0)
        wait(300)

    wait(REST_MS)
    for lane in range(14):
        end = math.pi if lane % 2 == 0 else 0.0
        straight(LANE_M)
        turn_to(0.5 * math.pi)
        straight(STEP_M)
        turn_to(end)
    truth = body.truth
    place = truth.pose.x_m - 5.0, truth.pose.y_m - 5.0
    plain, estimated = hosts
    drift_rad = wrap_angle(plain.pose.theta_rad - truth.heading_rad)
    seconds = 0.001 * (truth.tick_ms - REST_MS)
    return Ends(
        1000.0 * math.dist(place, plain.pose[:2]),
        1000.0 * math.dist(place, estimated.pose[:2]),
        math.degrees(abs(drift_rad)) / seconds,
        truth.path_m,
    )


@pytest.fixture(scope="module")
def paper_runs() -> list[Ends]:
    return [run_cycles(seed, "paper") for seed in range(20)]


def test_paper_noise_drifts_as_much_as_the_papers_robot(paper_runs: list[Ends]) -> None:
    """The result is the median of 20 seeds, by dead reckoning alone."""
    assert all(26.0 < run.path_m < 28.0 for run in paper_runs)
    assert 5.0 <= statistics.median(run.plain_mm for run in paper_runs) <= 9.0
    assert statistics.median(run.drift_deg_s for run in paper_runs) < 0.0014


def test_the_hosts_estimator_without_walls_drifts_as_much(paper_runs: list[Ends]) -> None:
    assert 5.0 <= statistics.median(run.estimated_mm for run in paper_runs) <= 9.0


def test_without_noise_only_quantisation_is_left_and_typical_is_far_worse() -> None:
    clean = run_cycles(0, "none")
    typical = statistics.median(run_cycles(seed, "typical").plain_mm for seed in range(3))
    assert clean.plain_mm < 3.0
    assert clean.estimated_mm < 3.0
    assert typical > 20.0
