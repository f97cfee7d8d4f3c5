"""Consistency of the filter's covariance with its errors (NEES), and the size of the errors.

The first test simulates a robot with the noise of the drift model, in steps of 2 ms and by other
equations than the filter's; the sum of NEES must be within chi-square bounds. The second test uses
the virtual robot, whose errors differ from the model's.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from bridge.motion.estimation.drift_model import DriftModel, NoiseScale
from bridge.motion.estimation.ekf import BIAS, GYRO_SCALE, MOTION_BIAS, STATES, WHEEL_SCALE
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.noise_monitor import NoiseTuning, SlipMonitor, gyro_share
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.dead_reckoning import DeadReckoning
from support.sim_body import box, room
from support.sim_drive import SimDrive

MODEL = RobotModel()
ORIGIN = Pose2(0.0, 0.0, 0.0)
DRIFT = DriftModel()
NOISE = NoiseTuning()
RUNS = 24
TICK_S = 0.002
LEGS = ((3.0, 0.0), (1.2, 1.3), (4.0, 0.0), (1.2, -1.3), (3.0, 0.25))
"""Duration (s) and yaw rate (rad/s) of the legs of a drive; a rest follows every second leg."""


class Truth:
    """True motion: two wheels on a floor, each with its slip, and a gyro with all its errors."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.x = self.y = self.theta = 0.0
        self.turned = [0.0, 0.0]
        """Travel of the wheels by their encoders, m at the nominal diameter."""
        self.bias = math.radians(rng.normal(0.0, 1.0))
        self.shift = rng.normal(0.0, DRIFT.motion_bias_rad_s)
        self.gyro_gain = 1.0 / (1.0 - rng.normal(0.0, DRIFT.gyro_scale))
        self.wheel = 1.0 + rng.normal(0.0, DRIFT.wheel_scale)
        self.tick = 0
        self.angle = 0.0
        """Integral of yaw rate and gyro noise since the last sample, rad."""

    def step(self, v: float, w: float) -> None:
        rng, b = self.rng, MODEL.wheel_base_m
        gone = []
        for side, speed in enumerate((v - 0.5 * w * b, v + 0.5 * w * b)):
            way = speed * TICK_S
            self.turned[side] += way / self.wheel
            # The wheels slip independently, so the mean of both has the model's value.
            stray = math.sqrt(2.0) * DRIFT.along_m_sqrt_m * math.sqrt(abs(0.5 * v) * 2.0 * TICK_S)
            gone.append(way + rng.normal(0.0, 1.0) * stray if v else way)
        turn = (gone[1] - gone[0]) / b
        ahead = 0.5 * (gone[0] + gone[1])
        aside = DRIFT.across_m_sqrt_m * math.sqrt(abs(v) * TICK_S) * rng.normal(0.0, 1.0)
        c, s = math.cos(self.theta + turn / 2), math.sin(self.theta + turn / 2)
        self.x += ahead * c - aside * s
        self.y += ahead * s + aside * c
        self.theta += turn
        self.tick += 1
        moving = bool(v or w)
        noise = moving * math.hypot(DRIFT.gyro_walk_rad_sqrt_s, DRIFT.gyro_shaken_rad_sqrt_s)
        self.angle += turn * self.gyro_gain + (self.bias + self.shift * moving) * TICK_S
        self.angle += noise * math.sqrt(TICK_S) * rng.normal(0.0, 1.0)

    def counts(self) -> tuple[int, int]:
        left, right = (math.floor(m / MODEL.metres_per_count) & 0xFFFF for m in self.turned)
        return left, right

    def gyro(self, still: bool) -> float:  # noqa: FBT001 - a gyro takes positional values
        rate, self.angle = self.angle / 0.01, 0.0
        return rate + (self.rng.normal(0.0, DRIFT.gyro_sample_rad_s) if still else 0.0)


def run_model(seed: int) -> tuple[np.ndarray, np.ndarray, PoseEstimator]:
    """Return error, covariance and estimator at the end of a drive of half a minute."""
    truth = Truth(seed)
    estimator = PoseEstimator(MODEL, ORIGIN)

    def go(seconds: float, v: float, w: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            truth.step(v, w)
            if truth.tick % 5 == 0:
                estimator.on_imu(truth.tick * TICK_S, truth.gyro(still=not v and not w))
            if truth.tick % 10 == 0:
                estimator.on_encoders(truth.tick * TICK_S, *truth.counts())

    go(1.5, 0.0, 0.0)
    for i, (seconds, w) in enumerate(LEGS):
        go(seconds, 0.2 if abs(w) < 1.0 else 0.0, w)
        if i % 2:
            go(0.8, 0.0, 0.0)
    go(0.1, 0.0, 0.0)
    estimator.ekf.propagate_covariance()
    pose = estimator.pose
    turn = math.remainder(pose.theta_rad - truth.theta, math.tau)
    error = np.array([pose.x_m - truth.x, pose.y_m - truth.y, turn])
    return error, np.array(estimator.covariance), estimator


def test_nees_lies_within_its_chi_square_bounds() -> None:
    """The NEES of 3 states, summed over 24 runs, is chi-square with 72 degrees of freedom.

    99.8 % of this distribution lies in (41, 113).
    """
    runs = [run_model(seed) for seed in range(RUNS)]
    nees = [float(error @ np.linalg.solve(p, error)) for error, p, _ in runs]
    assert 41.0 < sum(nees) < 113.0
    for axis in range(3):  # one state alone: 24 degrees of freedom, 99.8 % in (8, 51)
        alone = sum(float(error[axis] ** 2 / p[axis, axis]) for error, p, _ in runs)
        assert 8.0 < alone < 51.0


@pytest.mark.parametrize("seed", range(3))
def test_through_the_virtual_body_at_typical(seed: int) -> None:
    """The robot drives around a room near the walls for a minute and a half.

    Its errors differ from the model. The bounds are 1.5 cm, 0.7°, and a mean NEES below 5.
    """
    drive = SimDrive(room((0.26, 0.26, 0.0), walls=box(0.0, 0.0, 2.2, 1.8)), "typical", seed)
    alone = DeadReckoning(MODEL, drive.estimator.pose)
    assert alone.pose == drive.body.pose
    drive.rest(2.0)
    for heading, way in ((0.0, 1.68), (0.5, 1.28), (1.0, 1.68), (1.5, 1.28)) * 2:
        drive.turn_to(heading * math.pi)
        drive.straight(way)
    errors = drive.errors
    assert max(errors.position_m) < 0.015
    assert max(errors.yaw_rad) < math.radians(0.7)
    # The samples of one run are correlated, so the bounds of their mean are wide.
    assert 0.1 < sum(errors.nees) / len(errors.nees) < 5.0
    assert drive.estimator.disturbances == (), "no false alarm"


def scale_variance(drive: SimDrive) -> float:
    return float(drive.estimator.ekf.joint_covariance.p[WHEEL_SCALE, WHEEL_SCALE])


def test_walls_estimate_wheel_scale_and_the_bias_of_motion() -> None:
    """Walls help from the second round on: before, the wall ahead has no known direction."""
    drive = SimDrive(room((0.26, 0.26, 0.0), walls=box(0.0, 0.0, 2.2, 1.8)), "typical", 5)
    drive.rest(2.0)
    before = scale_variance(drive)
    for heading, way in ((0.0, 1.68), (0.5, 1.28), (1.0, 1.68), (1.5, 1.28)) * 3:
        drive.turn_to(heading * math.pi)
        drive.straight(way)
    body = drive.body
    nominal = 0.5 * MODEL.wheel_diameter_m
    mean = 0.5 * (body.left_radius_m + body.right_radius_m) / nominal
    assert scale_variance(drive) < 0.5**2 * before
    assert drive.estimator.wheel_scale == pytest.approx(mean, abs=0.003)


def test_without_noise_no_error_grows() -> None:
    """A range belongs to an older place than the pose.

    Without this distinction the room would grow.
    """
    drive = SimDrive(room((0.26, 0.26, 0.0), walls=box(0.0, 0.0, 2.2, 1.8)), "none", 1)
    drive.rest(2.0)
    for heading, way in ((0.0, 1.68), (0.5, 1.28), (1.0, 1.68), (1.5, 1.28)) * 2:
        drive.turn_to(heading * math.pi)
        drive.straight(way)
    assert max(drive.errors.position_m) < 0.003
    assert drive.estimator.wheel_scale == pytest.approx(1.0, abs=0.001)


# ---- the reference ---------------------------------------------------------------------


def test_dead_reckoning_is_the_papers() -> None:
    """The path is a square: 1 m lanes by the encoders, exact quarter turns by the gyro."""
    reckoning = DeadReckoning(MODEL, ORIGIN)
    bias, t, left = 0.02, 0.0, 0.0
    for _ in range(50):
        t += 0.01
        reckoning.on_imu(t, bias)
        reckoning.on_encoders(t, 0, 0)
    assert reckoning.gyro_bias_rad_s == pytest.approx(bias)
    for _ in range(100):
        t += 0.01
        left += 0.01
        count = round(left / MODEL.metres_per_count)
        reckoning.on_imu(t, bias + 0.5 * math.pi)
        reckoning.on_encoders(t, count, count)
    radius = 1.0 / (0.5 * math.pi)
    assert reckoning.pose.theta_rad == pytest.approx(0.5 * math.pi, abs=1e-9)
    assert reckoning.pose.x_m == pytest.approx(radius, abs=2e-3)
    assert reckoning.pose.y_m == pytest.approx(radius, abs=2e-3)


# ---- measured noise --------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.0005, 0.005])
def test_slip_is_measured_from_wheels_against_gyro(sigma: float) -> None:
    rng = np.random.default_rng(1)
    monitor = SlipMonitor(0.0015)
    for _ in range(5000):  # 4 mm steps; wheels that differ by 0.2 % are no noise
        stray = rng.normal(0.0, math.sqrt(2.0) * sigma * math.sqrt(0.004), 2)
        monitor.update(0.004 + stray[0], 0.004008 + stray[1], 0.0)
    assert monitor.along_m_sqrt_m == pytest.approx(sigma, rel=0.35)


def slip(monitor: SlipMonitor, along_m_sqrt_m: float) -> None:
    """Drive sixty metres with this slip, once to the left and once to the right."""
    path_m = 0.101
    for window in range(600):
        stray_m = (-1) ** window * along_m_sqrt_m * math.sqrt(path_m)
        monitor.update(path_m - stray_m, path_m + stray_m, 0.0)


def test_more_slip_inflates_more() -> None:
    """Inflation is as measured below 1.7 mm/√m.

    Above it, more of the slip is common to both wheels.
    """
    expected = {0.0004: (0.5, 0.4), 0.001: (1.0, 1.0), 0.0034: (6.8, 3.0), 0.01: (22.0, 3.0)}
    for along_m, (slippery, of_the_mean) in expected.items():
        monitor = SlipMonitor(0.001)
        slip(monitor, along_m)
        assert monitor.slippery == pytest.approx(slippery, rel=0.03)
        assert monitor.mean_slippery == pytest.approx(of_the_mean, rel=0.03)


def test_slip_and_vibration_leave_the_scales_uncertain() -> None:
    estimator = PoseEstimator(MODEL, ORIGIN)
    states = [WHEEL_SCALE, GYRO_SCALE, MOTION_BIAS]
    wheels, gyro, bias = DRIFT.wheel_scale, DRIFT.gyro_scale, DRIFT.motion_bias_rad_s
    slip(estimator.ekf.slip_monitor, 2.0 * DRIFT.along_m_sqrt_m)
    for _ in range(2):  # the same slip a second time gives no information
        estimator.ekf.wait(0.2)
        estimator.ekf.inflate_for_vibration(0.30)
        with_sigma = np.sqrt(np.diag(estimator.ekf.joint_covariance.p)[states])
        expected = [2.0 * wheels, 4.0**0.6 * gyro, 4.0**0.6 * bias]
        assert with_sigma == pytest.approx(expected, rel=0.03)


def test_only_the_vibration_part_of_the_gyro_walk_grows() -> None:
    """That part grows with the cube of the vibration.

    The chip's own 0.005 °/√s is the same at rest and in motion.
    """
    for vibration_m_s2, grown in ((0.15, 1.0), (0.30, 8.0)):
        estimator = PoseEstimator(MODEL, ORIGIN)
        estimator.ekf.inflate_for_vibration(vibration_m_s2)
        sensors = range(BIAS, STATES)
        estimator.ekf.joint_covariance.reset(sensors, [0.0] * len(sensors))
        estimator.ekf.advance(0.2, 0.0, 1.0, 1.0, by_wheels=False)
        walk = math.hypot(DRIFT.gyro_walk_rad_sqrt_s, grown * DRIFT.gyro_shaken_rad_sqrt_s)
        assert math.sqrt(estimator.covariance[2][2]) == pytest.approx(walk)


def test_vibration_makes_the_gyro_worse_by_its_square() -> None:
    assert gyro_share(0.15, NOISE) == pytest.approx(1.0)
    assert gyro_share(0.30, NOISE) == pytest.approx(4.0)
    assert gyro_share(0.0, NOISE) == 0.25
    assert gyro_share(5.0, NOISE) == 10.0


def settled(scale: NoiseScale, variance: float, seed: int) -> float:
    """Return the geometric mean of the settled scale, for ``variance`` times the model's errors."""
    rng = np.random.default_rng(seed)
    logs = []
    for count in range(6000):
        scale.learn(variance * float(rng.normal()) ** 2 / scale.value)
        if count >= 1000:
            logs.append(math.log(scale.value))
    return math.exp(sum(logs) / len(logs))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("variance", [4.0, 9.0])
def test_innovations_scale_the_noise_to_the_errors(variance: float, seed: int) -> None:
    scale = NoiseScale(NOISE)
    assert settled(scale, variance, seed) == pytest.approx(variance, rel=0.25)
    # It returns to one once the errors are small again.
    assert settled(scale, 0.2, seed) < 1.05


@pytest.mark.parametrize("seed", range(3))
def test_errors_as_large_as_the_models_leave_the_scale_near_one(seed: int) -> None:
    """The scale is not exactly one: it is limited from below there and fluctuates upwards."""
    assert 1.0 < settled(NoiseScale(NOISE), 1.0, seed) < 1.6


def test_the_scale_of_the_noise_stays_within_its_bounds() -> None:
    scale = NoiseScale(NOISE)
    for _ in range(100):
        scale.learn(1e6)
    assert scale.value == 25.0
    for _ in range(100):
        scale.learn(0.0)
    assert scale.value == 1.0
