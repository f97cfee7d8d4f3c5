"""Walls seen again keep a drifting estimate near a simulated truth."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.motion.estimation.ekf import STATES, THETA, X, Y
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.estimation.wall_map import WallMap, WallTuning
from bridge.motion.estimation.wall_measurements import FrontMeasurement, LineMeasurement
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.wheel_speeds import wheel_speeds_m_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.motion.robot_model import RangerMount

pytestmark = pytest.mark.slow

MODEL = RobotModel()
Point = tuple[float, float]
ROOM: list[Point] = [(0.0, 0.0), (3.0, 0.0), (3.0, 2.4), (0.0, 2.4)]
CORNERS: list[Point] = [(0.25, 0.25), (2.75, 0.25), (2.75, 2.15), (0.25, 2.15)]
"""A round along the walls, which are on the right."""
FREE: dict[str, bool] = {"bumper_left": False, "bumper_right": False}
START = Pose2(*CORNERS[0], 0.0)
SPEED_M_S, YAW_RATE_RAD_S = 0.2, 1.0


def update_heading(estimator: PoseEstimator, error_rad: float, variance: float) -> None:
    """Update with the heading's error, estimate less truth."""
    estimator.ekf.update(
        (THETA,), np.array([[1.0]]), np.array([-error_rad]), np.array([[variance]])
    )


def update_position(
    estimator: PoseEstimator,
    direction_x: float,
    direction_y: float,
    error_m: float,
    variance: float,
) -> None:
    """Update with the position's error along a unit vector."""
    rows = np.array([[direction_x, direction_y]])
    estimator.ekf.update((X, Y), rows, np.array([-error_m]), np.array([[variance]]))


def box(x: float, y: float, degrees: float, size: float = 0.3) -> list[Point]:
    """Return a square obstacle around a centre."""
    middle, h = Pose2(x, y, math.radians(degrees)), size / 2
    return [middle.transform(*corner) for corner in ((h, h), (-h, h), (-h, -h), (h, -h))]


class World:
    """A robot on a round; estimators get its sensor readings, with drift."""

    def __init__(self, seed: int, obstacles: Sequence[list[Point]] = (), *, range_m: float) -> None:
        """``range_m``: standard deviation of the rangers."""
        self.rng = random.Random(seed)
        self.range_sigma_m = range_m
        self.edges = [
            (polygon[i - 1], polygon[i])
            for polygon in (ROOM, *obstacles)
            for i in range(len(polygon))
        ]
        self.bias = math.radians(self.rng.uniform(-0.5, 0.5))
        self.gyro_scale = 1.0 + self.rng.choice((-1, 1)) * self.rng.uniform(0.001, 0.002)
        self.wheel_scale = 1.0 + self.rng.choice((-1, 1)) * self.rng.uniform(0.004, 0.008)
        self.truth = START
        self.tick = 0
        self.left = self.right = 0.0
        self.alone = PoseEstimator(MODEL, START)
        self.helped = PoseEstimator(MODEL, START)
        self.walls = Relocaliser(MODEL, self.helped)
        self.worst_alone = self.worst_helped = self.worst_yaw = 0.0
        self.worst_harm = 0.0
        self.min_eigenvalue = math.inf

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self._step(0.0, 0.0)

    def round(self) -> None:
        for corner, (x, y) in enumerate(CORNERS[1:] + CORNERS[:1]):
            way = math.dist((x, y), self.truth[:2])
            ticks = round(way / SPEED_M_S * 100)
            for _ in range(ticks):
                self._step(way / ticks * 100, 0.0)
            ticks = round(math.pi / 2 / YAW_RATE_RAD_S * 100)
            for _ in range(ticks):
                self._step(0.0, math.pi / 2 / ticks * 100)
            theta = math.remainder((corner + 1) * math.pi / 2, math.tau)
            self.truth = Pose2(x, y, theta)  # no rounding errors of this test
            self.rest(0.6)

    def _step(self, v: float, w: float) -> None:
        self.tick += 1
        x, y, theta = self.truth
        self.truth = Pose2(
            x + 0.01 * v * math.cos(theta), y + 0.01 * v * math.sin(theta), theta + 0.01 * w
        )
        left, right = wheel_speeds_m_s(MODEL, v, w)
        self.left += 0.01 * left * self.wheel_scale
        self.right += 0.01 * right * self.wheel_scale
        t = 0.01 * self.tick
        gyro = w * self.gyro_scale + self.bias + self.rng.gauss(0, math.radians(0.05))
        counts = [math.floor(m / MODEL.metres_per_count) & 0xFFFF for m in (self.left, self.right)]
        for estimator in (self.alone, self.helped):
            estimator.on_imu(t, gyro)
            if self.tick % 2 == 0:
                estimator.on_encoders(t, *counts)
        if self.tick % 10 in {0, 5} and self.tick > 300:
            mounts = (MODEL.ultrasonic, MODEL.infrared_left, MODEL.infrared_right)
            self.walls.update(
                *(self._look(mount) for mount in mounts), **FREE, t_s=t, ultrasonic_age_s=0.0
            )
            self._measure()

    def _look(self, mount: RangerMount) -> float | None:
        """Return the distance to the nearest edge along the sensor's axis."""
        x, y = self.truth.transform(mount.x_m, mount.y_m)
        facing = self.truth.theta_rad + mount.yaw_rad
        dx, dy = math.cos(facing), math.sin(facing)
        nearest = math.inf
        for (ax, ay), (bx, by) in self.edges:
            ex, ey = bx - ax, by - ay
            cross = dx * ey - dy * ex
            if abs(cross) < 1e-9:
                continue
            t = ((ax - x) * ey - (ay - y) * ex) / cross
            u = ((ax - x) * dy - (ay - y) * dx) / cross
            if t > 0 and 0 <= u <= 1:
                nearest = min(nearest, t)
        seen = nearest + self.rng.gauss(0, self.range_sigma_m)
        return seen if mount.min_range_m <= seen <= mount.max_range_m else None

    def _measure(self) -> None:
        alone, helped = (e.pose.distance_m(self.truth) for e in (self.alone, self.helped))
        self.worst_alone = max(self.worst_alone, alone)
        self.worst_helped = max(self.worst_helped, helped)
        self.worst_harm = max(self.worst_harm, helped - alone)
        yaw = math.remainder(self.helped.pose.theta_rad - self.truth.theta_rad, math.tau)
        self.worst_yaw = max(self.worst_yaw, abs(yaw))
        if self.tick % 100 == 0:
            lowest = float(np.linalg.eigvalsh(np.array(self.helped.covariance)).min())
            self.min_eigenvalue = min(self.min_eigenvalue, lowest)


@pytest.mark.parametrize("seed", range(3))
def test_the_error_stays_bounded_round_after_round(seed: int) -> None:
    world = World(seed, range_m=0.0015)
    world.rest(1.0)
    world.round()
    world.round()
    early = world.worst_helped
    for _ in range(3):
        world.round()
    assert world.walls.yaw_fixes > 20
    assert world.walls.position_fixes > 50
    assert world.worst_helped < 0.03
    assert world.worst_helped < early + 0.02, "it does not grow"
    assert world.worst_yaw < math.radians(1.0)
    assert world.worst_alone > 1.5 * world.worst_helped, "without walls it drifts"
    assert world.min_eigenvalue > -1e-12


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degrees", [4.0, 12.0, 30.0])
def test_rotated_obstacles_never_do_more_harm_than_the_gate(seed: int, degrees: float) -> None:
    """The boxes are on the inner side of the round, at angles that look orthogonal."""
    obstacles = [box(0.9, 0.68, degrees), box(1.9, 0.66, -degrees), box(2.3, 1.3, degrees)]
    obstacles += [box(1.5, 1.72, degrees / 2), box(0.68, 1.2, degrees)]
    world = World(seed, obstacles, range_m=0.0015)
    world.rest(1.0)
    for _ in range(3):
        world.round()
    assert world.worst_harm < WallTuning().gate_m
    assert world.worst_helped < 0.06
    assert world.min_eigenvalue > -1e-12


def test_a_perfect_estimate_stays_one() -> None:
    """Without errors to correct, noise of the rangers moves nothing."""
    world = World(1, range_m=0.0015)
    world.wheel_scale = world.gyro_scale = 1.0
    world.rest(1.0)
    for _ in range(3):
        world.round()
    assert world.worst_helped < 0.015
    assert world.worst_yaw < math.radians(0.6)


def test_a_contact_inflates_once() -> None:
    estimator = PoseEstimator(MODEL, START)
    walls = Relocaliser(MODEL, estimator)
    traces = []
    for touching in (False, True, True, False, True):
        walls.update(None, None, None, bumper_left=touching, bumper_right=False, t_s=0.0)
        traces.append(sum(estimator.covariance[i][i] for i in range(3)))
    assert traces[0] == 0.0
    assert traces[1] == traces[2] == traces[3] > 0.0
    assert traces[4] == pytest.approx(2 * traces[1])


def test_one_near_reading_is_noise_and_three_of_five_are_a_touch() -> None:
    """Grazing along a wall may push the robot aside, 3 mm/√m; a stray reading does not."""
    touch = MODEL.radius_m - abs(MODEL.infrared_left.y_m)
    for near, inflated in ((1, False), (2, False), (3, True)):
        driven = Driven()
        walls = Relocaliser(MODEL, driven.estimator)
        path_m = 0.0
        for i in range(10):
            last = driven.estimator.odometry
            driven.drive(0.2, 0.0, 5)
            path_m = driven.estimator.odometry.distance_m(last)
            before = driven.estimator.covariance[1][1]
            range_m, t_s = touch + (0.02 if i < 10 - near else 0.002), 0.01 * driven.tick
            walls.update(None, range_m, None, **FREE, t_s=t_s)
        sigma_m = 0.003 * math.sqrt(path_m)
        added = driven.estimator.covariance[1][1] - before
        assert added == pytest.approx(inflated * sigma_m**2, rel=0.05, abs=1e-15)


def seen_oblique() -> tuple[Driven, WallMap]:
    """Return a robot that knows a wall ahead with its direction, after a path aside.

    Its heading is uncertain by 1°.
    """
    driven = Driven()
    estimator = driven.estimator
    walls = Relocaliser(MODEL, estimator).walls
    walls.see_line(LineMeasurement(0.0, 0.8, 1e-4, 0.0, 1e-8, -0.5, 0.5))
    estimator.ekf.inflate(0.005, math.radians(1.0))
    for turn in (1.0, -1.0):
        driven.drive(0.0, turn * 0.5 * math.pi, 100)
        driven.drive(0.2, 0.0, 200 if turn > 0.0 else 1)
    return driven, walls


def test_a_range_ahead_moves_the_robot_and_turns_nothing() -> None:
    """Place and heading are correlated, but the heading is held, and so is the wall's."""
    driven, walls = seen_oblique()
    estimator = driven.estimator
    estimator.ekf.propagate_covariance()
    with_sigma = np.array(estimator.ekf.joint_covariance.p)
    assert abs(with_sigma[0, 2]) > 0.5 * math.sqrt(with_sigma[0, 0] * with_sigma[2, 2]), (
        "they are in doubt together"
    )
    before, normal_rad = estimator.pose, walls.normal_rad(0)
    ahead_m = 0.8 - before.x_m + START.x_m - MODEL.ultrasonic.x_m
    assert walls.see_front(FrontMeasurement(ahead_m - 0.01, 1e-6), MODEL.ultrasonic)
    assert estimator.pose.x_m == pytest.approx(before.x_m + 0.01, abs=0.004)
    assert estimator.pose.theta_rad == before.theta_rad
    assert walls.normal_rad(0) == normal_rad
    held = np.ix_((2, STATES), (2, STATES))
    assert estimator.ekf.joint_covariance.p[held] == pytest.approx(with_sigma[held], rel=1e-12)


def test_one_uncertain_direction_counts_once_for_a_whole_approach() -> None:
    """An error of 0.01 rad of the wall at a lever of 0.4 m stays 4 mm for any number of reads."""
    driven, walls = seen_oblique()
    estimator = driven.estimator
    lever_m = estimator.pose.y_m - START.y_m
    assert lever_m == pytest.approx(0.4, abs=0.02)
    range_m = 0.8 - estimator.pose.x_m + START.x_m - MODEL.ultrasonic.x_m
    for _ in range(200):
        walls.see_front(FrontMeasurement(range_m, 1e-6), MODEL.ultrasonic)
    assert walls.walls[0].measurements > 150
    by_wall_m = lever_m * math.sqrt(estimator.ekf.joint_covariance.p[STATES, STATES])
    assert math.sqrt(estimator.covariance[0][0]) > 0.5 * by_wall_m


def approach(*, sent: bool) -> tuple[float, int]:
    """Drive at a known wall with ranges that are 80 ms old.

    Returns the error of the distance to the wall (m) and the number of position fixes.
    """
    driven = Driven()
    estimator = driven.estimator
    walls = Relocaliser(MODEL, estimator)
    walls.walls.see_line(LineMeasurement(0.0, 0.8, 1e-6, 0.0, 1e-8, -0.5, 0.5))
    estimator.ekf.inflate(0.05, 0.0)
    begin_m = MODEL.metres_per_count * driven.left
    driven.drive(0.2, 0.0, 50)
    for _ in range(30):
        driven.drive(0.2, 0.0, 5)
        t_s = 0.01 * driven.tick
        at_pulse_m = MODEL.metres_per_count * driven.left - begin_m - 0.08 * 0.2
        range_m = 0.8 - MODEL.ultrasonic.x_m - at_pulse_m
        age_s = 0.08 if sent else None
        walls.update(range_m, None, None, **FREE, t_s=t_s, ultrasonic_age_s=age_s)
    true_m = START.x_m + MODEL.metres_per_count * driven.left - begin_m
    return estimator.pose_at(t_s).x_m - true_m, walls.position_fixes


def test_a_range_counts_from_where_its_pulse_left() -> None:
    error_m, fixes = approach(sent=True)
    assert fixes > 3
    assert abs(error_m) < 0.001
    by_average_m, _ = approach(sent=False)
    assert by_average_m < -0.005, "50 ms at 0.2 m/s"


def test_a_pulse_counts_once_and_equal_ranges_of_two_pulses_count_twice() -> None:
    driven = Driven()
    walls = Relocaliser(MODEL, driven.estimator)
    walls.walls.see_line(LineMeasurement(0.0, 0.8, 1e-6, 0.0, 1e-8, -0.5, 0.5))
    range_m = 0.8 - MODEL.ultrasonic.x_m

    def fixes(ages_s: list[float]) -> int:
        before = walls.position_fixes
        for age_s in ages_s:
            driven.drive(0.0, 0.0, 5)
            t_s = 0.01 * driven.tick
            walls.update(range_m, None, None, **FREE, t_s=t_s, ultrasonic_age_s=age_s)
        return walls.position_fixes - before

    assert fixes([0.01, 0.06, 0.01, 0.0604, 0.01, 0.0596, 0.01]) == 0
    assert fixes([0.01] * 5) == 1


def test_nothing_is_corrected_before_a_wall_gave_the_grid() -> None:
    estimator = PoseEstimator(MODEL, START)
    walls = Relocaliser(MODEL, estimator)
    for _ in range(200):
        walls.update(0.5, 0.1, 0.1, **FREE, t_s=0.0)
    assert (walls.yaw_fixes, walls.position_fixes) == (0, 0)
    assert estimator.pose == START


# ---- the filter's own properties -------------------------------------------------------

VARIANCE = st.floats(1e-8, 1e-1)
ERROR = st.floats(-0.2, 0.2)
STEP = st.one_of(
    st.tuples(st.just("yaw"), ERROR, VARIANCE),
    st.tuples(st.just("position"), st.floats(-math.pi, math.pi), ERROR, VARIANCE),
    st.tuples(st.just("disturb"), st.floats(0, 0.05), st.floats(0, 0.05)),
    st.tuples(st.just("drive"), st.floats(-0.3, 0.3), st.floats(-2, 2), st.integers(1, 30)),
)


class Driven:
    """An estimator after a rest, and its clock."""

    def __init__(self) -> None:
        self.estimator = PoseEstimator(MODEL, START)
        self.tick, self.left, self.right = 0, 0.0, 0.0
        self.drive(0.0, 0.0, 60)

    def drive(self, v: float, w: float, ticks: int) -> None:
        left, right = wheel_speeds_m_s(MODEL, v, w)
        for _ in range(ticks):
            self.tick += 1
            self.left += 0.01 * left / MODEL.metres_per_count
            self.right += 0.01 * right / MODEL.metres_per_count
            self.estimator.on_imu(0.01 * self.tick, w)
            if self.tick % 2:
                counts = (math.floor(self.left) & 0xFFFF, math.floor(self.right) & 0xFFFF)
                self.estimator.on_encoders(0.01 * self.tick, *counts)

    def apply(self, step: tuple[object, ...]) -> None:
        match step:
            case ("yaw", float(error), float(variance)):
                update_heading(self.estimator, error, variance)
            case ("position", float(direction), float(error), float(variance)):
                c, s = math.cos(direction), math.sin(direction)
                update_position(self.estimator, c, s, error, variance)
            case ("disturb", float(sigma_m), float(sigma_rad)):
                self.estimator.ekf.inflate(sigma_m, sigma_rad)
            case ("drive", float(v), float(w), int(ticks)):
                self.drive(v, w, ticks)


@given(st.lists(STEP, min_size=1, max_size=25))
def test_the_covariance_stays_positive_semidefinite(steps: list[tuple[object, ...]]) -> None:
    driven = Driven()
    for step in steps:
        driven.apply(step)
        covariance = np.array(driven.estimator.covariance)
        assert np.isfinite(covariance).all()
        assert float(np.linalg.eigvalsh(covariance).min()) >= -1e-9 * max(1.0, covariance.max())
        assert np.isfinite(driven.estimator.pose).all()
        assert driven.estimator.gyro_bias_sigma_rad_s > 0.0


@given(st.lists(STEP, max_size=20), ERROR, VARIANCE)
def test_an_update_reduces_the_error_and_the_variance(
    steps: list[tuple[object, ...]], error: float, variance: float
) -> None:
    driven = Driven()
    for step in steps:
        driven.apply(step)
    estimator = driven.estimator
    estimator.ekf.propagate_covariance()
    before, with_sigma = estimator.pose, estimator.covariance[2][2]
    update_heading(estimator, error, variance)
    moved = math.remainder(estimator.pose.theta_rad - before.theta_rad, math.tau)
    assert estimator.covariance[2][2] <= min(with_sigma, variance) * (1 + 1e-9) + 1e-15
    assert moved * error <= 0.0
    assert abs(moved) <= abs(error) + 1e-12
    assert moved == pytest.approx(-error * with_sigma / (with_sigma + variance), abs=1e-9)


@given(st.lists(STEP, max_size=20), st.floats(-math.pi, math.pi), ERROR, VARIANCE)
def test_a_position_is_corrected_along_the_walls_normal(
    steps: list[tuple[object, ...]], direction: float, error: float, variance: float
) -> None:
    driven = Driven()
    for step in steps:
        driven.apply(step)
    estimator = driven.estimator
    estimator.ekf.propagate_covariance()
    c, s = math.cos(direction), math.sin(direction)
    before = estimator.pose
    (xx, xy, _), (_, yy, _), _ = estimator.covariance
    with_sigma = c * c * xx + 2 * c * s * xy + s * s * yy
    update_position(estimator, c, s, error, variance)
    after = estimator.pose
    along = (after.x_m - before.x_m) * c + (after.y_m - before.y_m) * s
    assert along == pytest.approx(-error * with_sigma / (with_sigma + variance), abs=1e-9)


def between_walls(right_m: float, left_m: float | None = None) -> tuple[Relocaliser, PoseEstimator]:
    """Drive 0.6 m along a wall or two, the rim at this distance; readings without noise."""
    estimator = PoseEstimator(MODEL, Pose2(0.0, 0.0, 0.0))
    places = Relocaliser(MODEL, estimator)
    mount_m = MODEL.radius_m - MODEL.infrared_left.y_m
    way = 0.0
    for tick in range(1, 501):
        t = 0.01 * tick
        way += 0.01 * SPEED_M_S if tick > 200 else 0.0
        counts = math.floor(way / MODEL.metres_per_count)
        estimator.on_imu(t, 0.0)
        if tick % 2 == 0:
            estimator.on_encoders(t, counts, counts)
        if tick % 5 == 0:
            left = None if left_m is None else left_m + mount_m
            places.update(None, left, right_m + mount_m, **FREE, t_s=t)
    return places, estimator


@pytest.mark.parametrize("gap_m", [0.001, 0.003, 0.006, 0.05])
def test_a_wall_passed_without_rubbing_enters_the_map(gap_m: float) -> None:
    places, estimator = between_walls(gap_m)
    assert len(places.walls.walls) == 1
    assert places.walls.normal_rad(0) == pytest.approx(-math.pi / 2, abs=math.radians(0.1))
    variance = float(estimator.ekf.joint_covariance.p[STATES, STATES])
    # nearer than 5 mm it may be an occasional contact
    assert (variance > math.radians(0.4) ** 2) == (gap_m < 0.005)
    assert variance < math.radians(0.8) ** 2


@pytest.mark.parametrize("gap_m", [-0.002, 0.0, 0.0003])
def test_a_grazed_wall_observes_its_direction_too_weakly(gap_m: float) -> None:
    places, _ = between_walls(gap_m)
    assert places.walls.walls == []


def test_grazing_on_the_right_is_not_measured_on_the_left() -> None:
    """With lateral slip, both walls seem to turn in the same direction."""
    assert between_walls(0.0, 0.05)[0].walls.walls == []
    assert len(between_walls(0.05, 0.05)[0].walls.walls) == 2
