"""Bumper, cliff sensor and encoder faults, with poses and counts that the test sets."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from bridge.evaluation.regions import find_regions
from bridge.floor_plan.floor_plan import FloorPlanError, parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from sim_device.body.footing import wheel_over
from sim_device.sensors.bumper import RELEASE_M, Bumper
from sim_device.sensors.cliff import CliffSensor
from sim_device.sensors.faults import CountDropout
from support.scripted_body import Placed
from support.sim_body import box, duty, plant, room, sensors, world

SMALL = box(0.0, 0.0, 2.0, 2.0)
RADIUS_M = 0.16
TOUCHING_X_M = 2.0 - RADIUS_M
FREE, BOTH, LEFT = (False, False), (True, True), (True, False)


# Bumper.


def bumper(body: Placed) -> Bumper:
    return Bumper(body.plant, RADIUS_M)


def test_a_switch_closes_on_touch_and_opens_a_travel_later() -> None:
    body = Placed(world(room((1.0, 1.0, 0.0), walls=SMALL)))
    device = bumper(body)
    body.put(TOUCHING_X_M - 1e-4, 1.0)
    assert device.read() == FREE
    body.touch_bearings_rad = (0.0,)
    body.put(TOUCHING_X_M, 1.0)
    assert device.read() == BOTH
    body.touch_bearings_rad = ()
    for gap_m in (1e-4, 0.9 * RELEASE_M):
        body.put(TOUCHING_X_M - gap_m, 1.0)
        assert device.read() == BOTH
    body.put(TOUCHING_X_M - 1.1 * RELEASE_M, 1.0)
    assert device.read() == FREE
    # An open switch closes only at contact, however close the obstacle is.
    body.put(TOUCHING_X_M - 1e-4, 1.0)
    assert device.read() == FREE


def test_a_half_turned_away_opens_though_the_wall_is_as_near() -> None:
    body = Placed(world(room((1.0, 1.0, 0.0), walls=SMALL)))
    device = bumper(body)
    body.put(TOUCHING_X_M, 1.0, math.radians(-40.0))
    body.touch_bearings_rad = (math.radians(40.0),)
    assert device.read() == LEFT
    body.touch_bearings_rad = ()
    body.put(TOUCHING_X_M - 1e-4, 1.0, math.radians(-80.0))
    assert device.read() == LEFT
    body.put(TOUCHING_X_M - 1e-4, 1.0, math.radians(-100.0))
    assert device.read() == FREE


def test_a_walker_holds_the_switch_as_a_wall_does() -> None:
    made = world(room((1.0, 1.0, 0.0), walls=SMALL))
    body = Placed(made.with_walker(1.0 + RADIUS_M + 0.05, 1.0, 0.05), Pose2(1.0, 1.0, 0.0))
    device = bumper(body)
    body.touch_bearings_rad = (0.0,)
    assert device.read() == BOTH
    body.touch_bearings_rad = ()
    body.put(1.0 - 0.5 * RELEASE_M, 1.0)
    assert device.read() == BOTH
    body.world = made
    assert device.read() == FREE


def test_backing_off_a_wall_frees_the_switch_after_its_travel() -> None:
    body = plant(room((TOUCHING_X_M - 0.02, 1.0, 0.0), walls=SMALL))
    suite = sensors(body)
    body.set_duty(duty(0.1), duty(0.1))
    body.advance_ms(1000)
    assert suite.bumpers() == BOTH
    body.set_duty(-duty(0.1), -duty(0.1))
    while suite.bumpers() == BOTH:
        body.advance_ms(1)
    gap_m = TOUCHING_X_M - body.pose.x_m
    # In one millisecond the robot moves by less than 0.1 mm.
    assert RELEASE_M < gap_m < RELEASE_M + 1.1e-4


def test_stuck_bumper_switches_stay_pressed() -> None:
    suite = sensors(plant(room((1.0, 1.0, 0.0), walls=SMALL)))
    suite.faults.bumper_stuck_left = True
    assert suite.bumpers() == LEFT
    suite.faults.bumper_stuck_right = True
    assert suite.bumpers() == BOTH
    suite.faults.bumper_stuck_left = suite.faults.bumper_stuck_right = False
    assert suite.bumpers() == FREE


# Cliff.

ROOM = {
    "name": "stairs",
    "walls": [[0, 0], [2, 0], [2, 2], [0, 2]],
    "start": [0.5, 1.0, 0.0],
    "cliffs": [[[1.5, 0], [2, 0], [2, 2], [1.5, 2]]],
}


def test_the_floor_is_missed_as_soon_as_a_cliff_sensor_is_over_the_cliff() -> None:
    plan = parse_floorplan(json.dumps(ROOM))
    device = CliffSensor(RADIUS_M)
    assert device.sees_none(Pose2(1.5 - 0.149, 1.0, 0.0), plan.cliffs)
    assert not device.sees_none(Pose2(1.5 - 0.151, 1.0, 0.0), plan.cliffs)
    # Turned by 55°, an outer sensor points straight at the edge. None of the sensors points back.
    assert device.sees_none(Pose2(1.5 - 0.149, 1.0, math.radians(55.0)), plan.cliffs)
    assert device.sees_none(Pose2(1.5 - 0.149, 1.0, math.radians(-55.0)), plan.cliffs)
    assert not device.sees_none(Pose2(1.5 - 0.149, 1.0, math.radians(45.0)), plan.cliffs)
    assert not device.sees_none(Pose2(1.5 - 0.149, 1.0, math.pi), plan.cliffs)


@pytest.mark.parametrize("aside_mm", range(0, 130, 3))
@pytest.mark.parametrize("side", [-1, 1])
def test_no_wheel_drives_straight_over_a_cliff_that_no_sensor_saw(aside_mm: int, side: int) -> None:
    """A pit of 40 cm length begins ``aside_mm`` beside the path of the robot's centre."""
    low, high = sorted((1.0 + side * 0.001 * aside_mm, 1.0 + side * 0.5))
    pit = ((0.8, low), (1.2, low), (1.2, high), (0.8, high))
    device = CliffSensor(RADIUS_M)
    for mm in range(500, 1400):
        pose = Pose2(0.001 * mm, 1.0, 0.0)
        if device.sees_none(pose, (pit,)):
            return
        assert not wheel_over(pose, 0.115, (pit,))


def test_rays_pass_over_a_cliff_and_a_suite_sees_it() -> None:
    plan = parse_floorplan(json.dumps(ROOM | {"start": [1.36, 1.0, 0.0]}))
    body = plant(plan)
    suite = sensors(body)
    assert suite.cliff() is True
    body.advance_ms(59)
    assert suite.ranges().ultrasonic_m == pytest.approx(2.0 - 1.36 - 0.12)


def test_a_robot_that_drives_on_lies_at_the_cliff_with_its_wheels_free() -> None:
    body = plant(parse_floorplan(json.dumps(ROOM)))
    suite = sensors(body)
    body.set_duty(duty(0.2), duty(0.2))
    while not suite.cliff():
        body.advance_ms(10)
    # The sensor is 0.15 m ahead of the wheels.
    assert 1.5 - 0.15 <= body.pose.x_m < 1.5 - 0.15 + 0.003
    body.advance_ms(2000)
    fallen = body.truth
    assert 1.5 <= fallen.pose.x_m < 1.5 + 0.003
    body.advance_ms(1000)
    after = body.truth
    assert after.pose == fallen.pose
    assert after.left_rad > fallen.left_rad + 5.0
    assert suite.cliff() is True
    body.set_duty(-duty(0.2), -duty(0.2))
    body.advance_ms(1000)
    assert body.pose == fallen.pose
    assert after.collisions == 0


def test_a_lifted_robot_sees_no_floor() -> None:
    suite = sensors(plant(room((1.0, 1.0, 0.0), walls=SMALL)))
    assert suite.cliff() is False
    suite.faults.lifted = True
    assert suite.cliff() is True


def test_cliffs_survive_the_room_file_and_the_metrics_leave_them_out() -> None:
    plan = parse_floorplan(json.dumps(ROOM))
    assert parse_floorplan(plan.to_json()) == plan
    regions = find_regions(plan, RobotModel(), 0.01)
    cell_m2 = 0.01**2
    assert np.count_nonzero(regions.free) * cell_m2 == pytest.approx(3.0, abs=0.03)
    without = parse_floorplan(json.dumps({k: v for k, v in ROOM.items() if k != "cliffs"}))
    assert without.cliffs == ()
    assert "cliffs" not in json.loads(without.to_json())


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"cliffs": 3}, "cliffs: must be a list"),
        ({"cliffs": [[[0, 0], [1, 0]]]}, r"cliffs\[0\]: must be a list of at least 3"),
        ({"start": [1.7, 1.0, 0.0]}, r"start: \(1.7, 1\) is over cliffs\[0\]"),
    ],
)
def test_a_wrong_cliff_is_named(change: dict[str, object], text: str) -> None:
    with pytest.raises(FloorPlanError, match=text):
        parse_floorplan(json.dumps(ROOM | change))


# Ranges and encoders under faults.


def test_a_blind_and_a_lying_ultrasonic() -> None:
    body = plant(room((1.0, 1.0, 0.0), walls=SMALL))
    suite = sensors(body)
    body.advance_ms(59)
    assert suite.ranges().ultrasonic_m == pytest.approx(0.88)
    suite.faults.ultrasonic_blind = True
    assert suite.ranges().ultrasonic_m is None
    suite.faults.ultrasonic_constant_m = 0.33
    assert suite.ranges().ultrasonic_m == 0.33
    suite.faults.ultrasonic_constant_m = None
    suite.faults.ultrasonic_blind = False
    assert suite.ranges().ultrasonic_m == pytest.approx(0.88)


@pytest.mark.parametrize(("share", "left"), [(0.0, 1000), (0.25, 750), (1.0, 0), (3.0, 0)])
def test_a_share_of_the_counts_is_lost_either_way_and_through_the_wrap(
    share: float, left: int
) -> None:
    for begin, step in ((65_000, 10), (400, -10)):
        dropout = CountDropout()
        assert dropout.apply(begin, share) == begin
        reported = begin
        for i in range(1, 101):
            reported = dropout.apply((begin + i * step) & 0xFFFF, share)
        assert reported == (begin + (left if step > 0 else -left)) & 0xFFFF


def test_lost_counts_stay_lost() -> None:
    dropout = CountDropout()
    dropout.apply(0, 0.0)
    assert dropout.apply(100, 0.5) == 50
    assert dropout.apply(300, 0.0) == 250


def test_one_encoder_may_lose_counts_alone() -> None:
    body = plant(room((1.0, 1.0, 0.0), walls=box(-9.0, -9.0, 9.0, 9.0)))
    suite = sensors(body)
    suite.encoders()
    suite.faults.encoder_dropout_left = 0.5
    body.set_duty(duty(0.2), duty(0.2))
    for _ in range(200):
        body.advance_ms(10)
        left, right = suite.encoders()
    assert right > 2900
    assert left == pytest.approx(0.5 * right, abs=1)
