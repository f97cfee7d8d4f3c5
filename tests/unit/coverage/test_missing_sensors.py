"""Robots without one of the range sensors: they sweep with the others, and report the effect."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.control.wall_follow import FollowState, Side, WallFollower
from bridge.motion.geometry import Pose2
from bridge.motion.observation import Observation
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast

WHOLE = RobotModel()
SENSORS = ("ultrasonic", "infrared_left", "infrared_right")


def without(*names: str) -> RobotModel:
    """Return the robot without these sensors."""
    model = WHOLE
    for name in names:
        model = replace(model, **{name: replace(getattr(model, name), fitted=False)})
    return model


NO_SONAR, NO_INFRARED = without("ultrasonic"), without("infrared_left", "infrared_right")
BUMPER_ONLY = without(*SENSORS)
ROOM = FloorPlan(
    "small", ((0.0, 0.0), (1.8, 0.0), (1.8, 1.4), (0.0, 1.4)), (), Pose2(0.4, 0.4, 0.2)
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "share"), [(NO_SONAR, 0.97), (NO_INFRARED, 0.85), (BUMPER_ONLY, 0.85)]
)
def test_it_sweeps_a_room_and_reports_what_it_lacks(model: RobotModel, share: float) -> None:
    planner = RecoveryPlanner(model)
    run = run_fast(ROOM, planner, model, seed=3, noise=LEVELS["typical"], max_time_s=2500.0)
    assert run.finish_reason is not None
    assert CoverageMeter(ROOM, model, 0.01).measure(run.poses).coverage.mouth_sweepable > share
    lacks = [event.reason for _, event in run.events if event.kind == "sensor"]
    assert len(lacks) == len(model.rangers) - len(model.fitted_rangers)
    assert all(reason.startswith("without ") for reason in lacks)


def test_without_ultrasonic_lanes_and_perimeters_are_slower() -> None:
    options = RecoveryOptions()
    whole = PlannerGeometry.from_model(WHOLE, options)
    blind = PlannerGeometry.from_model(NO_SONAR, options)
    assert whole.lane_speed_m_s > blind.lane_speed_m_s == WHOLE.cruise_speed_m_s
    assert whole.perimeter_speed_m_s > blind.perimeter_speed_m_s == WHOLE.cruise_speed_m_s


def test_without_infrared_the_planner_gives_up_earlier() -> None:
    options = RecoveryOptions()
    assert options.for_model(WHOLE) is options
    assert options.for_model(without("infrared_left")) is options
    felt = options.for_model(NO_INFRARED)
    assert felt.max_fruitless < options.max_fruitless
    assert felt.perimeter_length_m < options.perimeter_length_m


def seen(pose: Pose2, *, bumper: bool = False, v_m_s: float = 0.1) -> Observation:
    return Observation(
        time_s=0.0,
        pose=pose,
        v_m_s=v_m_s,
        yaw_rate_rad_s=0.0,
        ultrasonic_m=None,
        infrared_left_m=None,
        infrared_right_m=None,
        bumper_left=bumper,
        bumper_right=False,
        cliff=False,
    )


def test_a_wall_that_no_sensor_sees_is_sought_on_a_tightening_bend() -> None:
    follower = WallFollower(NO_INFRARED, Side.LEFT, 0.0)
    x = y = theta = 0.0
    rates = []
    for _ in range(60):
        step = follower.step(seen(Pose2(x, y, theta)), 0.02)
        assert step.state is FollowState.FOLLOWING
        rates.append(step.command.yaw_rate_rad_s)
        theta += 0.02 * step.command.yaw_rate_rad_s
        x += 0.02 * step.command.v_m_s * math.cos(theta)
        y += 0.02 * step.command.v_m_s * math.sin(theta)
    assert 0.0 < rates[0] < rates[-1]
    assert y > 0.0, "towards the wall on the left"
    step = follower.step(seen(Pose2(x, y, theta), bumper=True), 0.02)
    assert step.state is FollowState.BLOCKED
    assert step.command.v_m_s == 0.0


def test_a_bend_without_a_wall_ends() -> None:
    follower = WallFollower(NO_INFRARED, Side.RIGHT, 0.0)
    states = [follower.step(seen(Pose2(0.0, 0.0, -0.02 * k)), 0.02).state for k in range(400)]
    assert states[-1] is FollowState.LOST


def test_a_felt_wall_is_put_abeam_into_the_map() -> None:
    options = RecoveryOptions()
    pose = Pose2(0.0, 0.0, 0.0)
    guess, abeam = (EvidenceMap(NO_INFRARED, options, pose) for _ in range(2))
    guess.add_bump(pose, left=True, right=False)
    abeam.add_bump(pose, left=True, right=False, abeam=1)
    at = 0.16 * math.sin(math.radians(76.0))
    assert abeam.count_occupied(0.16 * math.cos(math.radians(76.0)), at, 0.03) > 0
    assert guess.count_occupied(0.16 * math.cos(math.radians(76.0)), at, 0.03) == 0
