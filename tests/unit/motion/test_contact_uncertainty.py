"""Effect of contact on the estimate: the encoders count, but a wall prevents the motion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.motion.estimation.contact_uncertainty import ContactUncertainty
from bridge.motion.estimation.drift_model import DriftModel
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.tuning import EstimationTuning
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.sim_body import box, room
from support.sim_drive import SimDrive

if TYPE_CHECKING:
    from collections.abc import Sequence

MODEL = RobotModel()
START = Pose2(1.0, 1.0, 0.0)
TUNING = EstimationTuning().contact


class Pushed:
    """An estimator without accelerometer whose only motion input is the encoders."""

    def __init__(self, heading_rad: float = 0.0) -> None:
        self.estimator = PoseEstimator(MODEL, Pose2(START.x_m, START.y_m, heading_rad))
        self.contact = ContactUncertainty(self.estimator)

    def go(self, ways_m: Sequence[float], *, left: bool, right: bool, graze: bool = False) -> None:
        for way in ways_m:
            self.estimator.ekf.advance(way, 0.0, 0.05, 0.0, by_wheels=False)
            self.contact.update(left=left, right=right, grazing=graze)

    @property
    def sigma_m(self) -> tuple[float, float]:
        self.estimator.ekf.propagate_covariance()
        covariance = self.estimator.covariance
        return math.sqrt(covariance[0][0]), math.sqrt(covariance[1][1])


@pytest.mark.parametrize(("left", "right", "aside"), [(True, False, -1), (False, True, 1)])
def test_a_pressed_half_holds_back_part_of_the_way(*, left: bool, right: bool, aside: int) -> None:
    pushed = Pushed()
    pushed.go([0.005] * 10, left=left, right=right)
    x, y, theta = pushed.estimator.pose
    assert x - START.x_m == pytest.approx(0.05 * (1.0 - TUNING.slide_ahead))
    assert y - START.y_m == pytest.approx(aside * 0.05 * TUNING.slide_aside)
    assert theta == 0.0


@pytest.mark.parametrize(("way", "left", "right"), [(-0.005, True, False), (0.005, True, True)])
def test_backing_off_and_both_halves_take_nothing_back(
    way: float, *, left: bool, right: bool
) -> None:
    pushed = Pushed()
    pushed.go([way] * 10, left=left, right=right)
    assert pushed.estimator.pose == pytest.approx((START.x_m + 10 * way, START.y_m, 0.0))


def test_inertial_evidence_after_a_bump_is_kept() -> None:
    drive = SimDrive(room((1.0, 1.0, 0.0)), "typical", 1, walls=False)
    drive.rest(1.0)
    for _ in range(50):
        drive.step(0.1, 0.0)
    estimator = drive.estimator
    estimator.on_imu(0.001 * drive.body.tick_ms + 0.001, 0.0, -12.0, 0.0)
    assert estimator.bridging
    contact, before = ContactUncertainty(estimator), estimator.pose
    estimator.ekf.shift(0.005, 0.0)
    contact.update(left=True, right=False, grazing=False)
    assert estimator.pose.distance_m(before) == pytest.approx(0.005)


@pytest.mark.parametrize("speed_m_s", [0.06, 0.15, 0.2])
@pytest.mark.parametrize("pressed", [1, 3])
def test_after_a_bumper_release_the_wheels_path_counts(speed_m_s: float, pressed: int) -> None:
    """By the accelerometer a jerk looks like a stop. The robot rolls on, so the encoders count."""
    drive, contact = struck(speed_m_s)
    for k in range(8):
        contact.update(left=k < pressed, right=False, grazing=False)
        for _ in range(5):
            drive.step(speed_m_s, 0.0)
    assert not drive.estimator.bridging
    reported, true = drive.estimator.pose, drive.body.pose
    sigma_m = math.sqrt(drive.estimator.covariance[0][0])
    # while the switch is pressed, the obstacle may hold the robot; readings come every 50 ms
    held_m = 0.05 * (pressed - 1) * speed_m_s
    low_m = 0.002 if held_m else -0.004
    assert low_m < true.x_m - reported.x_m < held_m + 0.004
    assert sigma_m < 0.02


def test_a_free_bumper_does_not_clear_evidence_outside_its_range() -> None:
    drive, contact = struck(0.06)
    for _ in range(8):
        contact.update(left=False, right=False, grazing=False)
        for _ in range(5):
            drive.step(0.06, 0.0)
    assert drive.estimator.bridging


def test_a_bump_felt_before_does_not_end_the_next_one() -> None:
    drive, contact = struck(0.06)
    estimator, bridging = drive.estimator, []
    contact.update(left=True, right=False, grazing=False)
    for _ in range(4):
        contact.update(left=False, right=False, grazing=False)
    bridging.append(estimator.bridging)
    estimator.on_imu(0.001 * drive.body.tick_ms + 0.008, 0.0, -12.0, 0.0)
    bridging.append(estimator.bridging)
    contact.update(left=False, right=False, grazing=False)
    bridging.append(estimator.bridging)
    assert bridging == [False, True, True]


def struck(speed_m_s: float) -> tuple[SimDrive, ContactUncertainty]:
    """Return a moving robot whose accelerometer has just measured a hard impact."""
    drive = SimDrive(room((1.0, 1.0, 0.0)), "typical", 5)
    drive.rest(2.0)
    for _ in range(100):
        drive.step(speed_m_s, 0.0)
    contact = ContactUncertainty(drive.estimator)
    drive.estimator.on_imu(0.001 * drive.body.tick_ms + 0.005, 0.0, -12.0, 0.0)
    assert drive.estimator.bridging
    return drive, contact


def test_after_a_gap_one_readings_path_counts_as_contact() -> None:
    pushed = Pushed()
    pushed.go([0.2], left=True, right=False)
    assert abs(pushed.estimator.pose.y_m - START.y_m) == pytest.approx(TUNING.slide_aside * 0.02)


def test_a_stuck_half_does_not_lead_the_estimate_away() -> None:
    pushed = Pushed()
    pushed.go([0.01] * 1000, left=True, right=False)
    off_m = abs(pushed.estimator.pose.y_m - START.y_m)
    assert off_m < 0.06
    assert pushed.sigma_m[1] > off_m


@pytest.mark.parametrize("readings", [4, 10, 40])
def test_the_error_of_one_touch_is_one_error_however_often_it_is_read(readings: int) -> None:
    once = Pushed()
    once.go([0.0], left=True, right=False)
    many = Pushed()
    many.go([0.0] + [0.08 / readings] * readings, left=True, right=False)
    grown = math.sqrt(many.sigma_m[1] ** 2 - once.sigma_m[1] ** 2)
    assert grown == pytest.approx(TUNING.press_share * 0.08, rel=0.03)


def test_two_touches_are_two_errors() -> None:
    apart = Pushed()
    for _ in range(2):
        apart.go([0.0] + [0.01] * 4, left=True, right=True)
        apart.go([0.0], left=False, right=False)
    one = Pushed()
    one.go([0.0] + [0.01] * 4, left=True, right=True)
    assert apart.sigma_m[1] == pytest.approx(math.sqrt(2.0) * one.sigma_m[1], rel=0.02)


def test_grazing_adds_standard_deviation_with_the_root_of_the_path() -> None:
    drift = DriftModel()
    by_way = math.hypot(TUNING.graze_across_m_sqrt_m, drift.across_m_sqrt_m)
    along = math.hypot(TUNING.graze_along_m_sqrt_m, drift.along_m_sqrt_m)
    for parts in (10, 80):
        rubbed = Pushed()
        rubbed.go([0.4 / parts] * parts, left=False, right=False, graze=True)
        assert rubbed.sigma_m[1] == pytest.approx(by_way * math.sqrt(0.4), rel=0.05)
        along_m = math.hypot(along * math.sqrt(0.4), drift.wheel_scale * 0.4)
        assert rubbed.sigma_m[0] == pytest.approx(along_m, rel=0.05)
        assert rubbed.estimator.pose.y_m == START.y_m


def test_grazing_adds_standard_deviation_across_any_heading() -> None:
    heading_rad = math.radians(30.0)
    grazed, free = Pushed(heading_rad), Pushed(heading_rad)
    for pushed, graze in ((grazed, True), (free, False)):
        pushed.go([0.01] * 40, left=False, right=False, graze=graze)
        pushed.estimator.ekf.propagate_covariance()
    for direction_rad, sigma in (
        (heading_rad, TUNING.graze_along_m_sqrt_m),
        (heading_rad + 0.5 * math.pi, TUNING.graze_across_m_sqrt_m),
    ):
        before_m, after_m = (p.estimator.sigma_along_m(direction_rad) for p in (free, grazed))
        added_m = math.sqrt(after_m**2 - before_m**2)
        assert added_m == pytest.approx(sigma * math.sqrt(0.4), rel=0.05)


def test_without_contact_the_covariance_is_that_of_the_wheels() -> None:
    free, wheels = Pushed(), PoseEstimator(MODEL, START)
    for _ in range(40):
        free.go([0.01], left=False, right=False)
        wheels.ekf.advance(0.01, 0.0, 0.05, 0.0, by_wheels=False)
    free.estimator.ekf.propagate_covariance()
    wheels.ekf.propagate_covariance()
    assert free.estimator.covariance == wheels.covariance
    assert free.estimator.pose == wheels.pose


@pytest.mark.parametrize("slip_m", [0.0, 0.002])
def test_slip_of_the_wheels_does_not_change_the_walls_push(slip_m: float) -> None:
    """The push depends on the angle between heading and wall."""
    grazed, free = Pushed(), Pushed()
    for pushed in (grazed, free):
        for k in range(60):  # the wheels differ by this slip on each 10 cm
            odd_m = slip_m if k % 2 else -slip_m
            pushed.estimator.ekf.slip_monitor.update(0.1 + odd_m, 0.1 - odd_m, 0.0)
    for pushed, graze in ((grazed, True), (free, False)):
        pushed.go([0.01] * 40, left=False, right=False, graze=graze)
    added_m = math.sqrt(grazed.sigma_m[1] ** 2 - free.sigma_m[1] ** 2)
    assert added_m == pytest.approx(TUNING.graze_across_m_sqrt_m * math.sqrt(0.4), rel=0.01)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("level", ["typical", "harsh"])
def test_a_slide_along_an_unmapped_wall_is_within_the_standard_deviation(
    side: int, level: str
) -> None:
    """The heading points 0.5° into a wall that presses no bumper switch (independent plant)."""
    y = 1.5 + side * (1.5 - MODEL.radius_m - 0.0002)
    into_rad = side * math.radians(0.5)
    drive = SimDrive(room((0.6, y, into_rad), walls=box(0.0, 0.0, 4.0, 3.0)), level, 3)
    drive.rest(2.0)
    before = drive.estimator.pose
    while drive.estimator.pose.distance_m(before) < 0.35:
        turn_rad = math.remainder(into_rad - drive.estimator.pose.theta_rad, math.tau)
        drive.step(0.2, 4.0 * turn_rad)
        assert not drive.bumped
    assert drive.walls is not None
    assert drive.walls.walls.walls == [], "the wall is not in the map"
    off_m = side * (drive.estimator.pose.y_m - drive.body.pose.y_m)
    assert off_m > 0.0015, "the estimate is inside the wall"
    drive.estimator.ekf.propagate_covariance()
    assert off_m < 3.0 * drive.estimator.lateral_sigma_m


def test_a_drive_without_contact_keeps_its_small_lateral_standard_deviation() -> None:
    drive = SimDrive(room((0.6, 1.5, 0.0), walls=box(0.0, 0.0, 4.0, 3.0)), "typical", 3)
    drive.rest(2.0)
    before = drive.estimator.pose
    while drive.estimator.pose.distance_m(before) < 0.35:
        drive.step(0.2, -4.0 * drive.estimator.pose.theta_rad)
    drive.estimator.ekf.propagate_covariance()
    assert drive.estimator.lateral_sigma_m < 0.0005


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("level", ["typical", "harsh"])
def test_the_estimate_follows_a_sweeper_that_slips_along_a_wall(side: int, level: str) -> None:
    """The robot slips some 10 cm along a wall, its heading 10° into it (independent plant)."""
    y = 1.5 + side * (1.5 - MODEL.radius_m - 0.004)
    drive = SimDrive(
        room((0.6, y, math.radians(side * 10.0)), walls=box(0.0, 0.0, 4.0, 3.0)), level, 3
    )
    drive.rest(1.0)
    before, way = drive.estimator.pose, 0.0
    while way < 0.1:
        drive.step(0.08, 0.0)
        way = drive.estimator.pose.distance_m(before)
    drive.rest(0.3)
    assert drive.bumped
    reported, true = drive.estimator.pose, drive.body.pose
    off_m = reported.y_m - true.y_m
    slid_m = 0.1 * math.sin(math.radians(10.0))
    assert abs(off_m) < 0.5 * slid_m, "without it, the estimate is 17 mm inside the wall"
    sigma_m = math.sqrt(drive.estimator.covariance[1][1])
    assert abs(off_m) < 3.0 * sigma_m
    assert sigma_m < slid_m
