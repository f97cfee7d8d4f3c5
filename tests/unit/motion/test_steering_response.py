"""Measured gains of steering: bearing and wall distance while driving."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.executor import LegExecutor
from bridge.motion.control.pid import PidGains
from bridge.motion.control.point_to_point import BEARING_GAINS
from bridge.motion.control.rotary import ROTARY_GAINS
from bridge.motion.control.wall_follow import FollowTuning
from bridge.motion.estimation.wall_track import TrackTuning
from bridge.motion.geometry import Pose2
from bridge.motion.legs import FollowWall, GoTo, Leg
from bridge.motion.robot_model import RobotModel
from bridge.motion.step_response import StepResponse
from support.observed import AT_REST
from support.sim_body import box, room
from support.sim_drive import SimDrive
from support.steering_response import (
    BEARING_BAND_RAD,
    WALL_BAND_M,
    bearing_step,
    column_stand_off_m,
    wall_step,
)
from support.step_response import DEAD_S

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

MODEL = RobotModel()
CRUISE_M_S = MODEL.cruise_speed_m_s


def test_the_rise_is_read_off_the_series_and_a_step_never_taken_up_has_none() -> None:
    seen = StepResponse([0.1, 0.2, 0.3, 0.4], [-0.05, -0.2, -0.9, -1.2], [0.0] * 4, -1.0)
    assert seen.rise_s == pytest.approx(0.1)
    assert seen._replace(value=[-0.5] * 4).rise_s == math.inf


# ---- bearing ---------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [5.0, 20.0, 30.0, -30.0, 44.0, 60.0, 90.0, 150.0])
def test_a_bearing_settles_without_overshoot(degrees: float) -> None:
    response = bearing_step(MODEL, math.radians(degrees))
    assert response.overshoot < 0.005
    # at most 1.5 rad/s, and an end that falls with exp(-4 t)
    assert response.rise_s < 0.4 + math.radians(abs(degrees)) / 2.2
    assert response.settled_s(BEARING_BAND_RAD) < 0.65 + math.radians(abs(degrees)) / 1.5


def test_the_bearing_gain_is_the_fastest_stable_at_twice_the_dead_time() -> None:
    """With the rotary's Td, 30° settle in 0.76 s; at twice the dead time it overshoots by 2.5 %."""
    angle, td_s = math.radians(30.0), ROTARY_GAINS.td_s
    fit = []
    for kp in (2.0, 3.0, 4.0, 5.0, 6.0, 8.0):
        gains = PidGains(kp=kp, td_s=td_s)
        if bearing_step(MODEL, angle, gains, dead_s=2.0 * DEAD_S).overshoot < 0.03:
            fit.append((bearing_step(MODEL, angle, gains).settled_s(BEARING_BAND_RAD), kp))
    assert min(fit)[1] == BEARING_GAINS.kp
    assert BEARING_GAINS.td_s == td_s
    hasty = bearing_step(MODEL, angle, PidGains(kp=8.0, td_s=td_s))
    assert hasty.overshoot > 0.05, "the experiment can tell"


# ---- wall ------------------------------------------------------------------------------


@pytest.mark.parametrize("step_m", [0.02, -0.02, 0.01, -0.01, 0.04])
@pytest.mark.parametrize("speed_m_s", [CRUISE_M_S, 1.2 * CRUISE_M_S])
def test_the_distance_to_a_wall_settles(step_m: float, speed_m_s: float) -> None:
    response = wall_step(MODEL, step_m, speed_m_s=speed_m_s)
    assert response.overshoot * abs(step_m) < 0.003
    assert response.settled_s(WALL_BAND_M) * speed_m_s < 0.4
    assert response.rise_s * speed_m_s < 0.15
    assert abs(response.value[-1] - step_m) < WALL_BAND_M, "and nothing lasts"


@pytest.mark.parametrize("step_m", [0.02, 0.04])
def test_the_approach_is_slow_near_the_wall(step_m: float) -> None:
    """A perimeter is driven 0.5 mm off: the last centimetre at 15 mm/s, a gentle contact."""
    gap_m = RecoveryOptions().perimeter_gap_m
    response = wall_step(MODEL, step_m, gap_m=gap_m, speed_m_s=1.2 * CRUISE_M_S)
    ways = zip(response.value, response.value[1:], strict=False)
    across = [(b - a) / 0.02 for a, b in ways if b > step_m]
    assert 0.0 < max(across) < 0.017


@pytest.mark.parametrize("radius_m", [0.15, 0.2, 0.3, 0.5, 1.0])
def test_a_column_is_followed_at_the_set_distance(radius_m: float) -> None:
    assert abs(column_stand_off_m(MODEL, radius_m)) < 0.001
    # a filter that takes each wall for a straight one keeps away from the column
    straight = TrackTuning(bend_rad_m_sqrt_m=0.0, first_bend_rad_m=0.0)
    assert column_stand_off_m(MODEL, radius_m, replace(FollowTuning(), track=straight)) > 0.004


@pytest.mark.parametrize(
    ("tuning", "overshoot_m"),
    [
        (replace(FollowTuning(), yaw_gain_s=2.0), 0.0035),
        (replace(FollowTuning(), lookahead_m=0.06), 0.0045),
    ],
)
def test_a_slack_yaw_or_a_short_range_swings(tuning: FollowTuning, overshoot_m: float) -> None:
    response = wall_step(MODEL, 0.02, tuning)
    assert response.overshoot * 0.02 > overshoot_m


def test_a_stiff_yaw_swings_where_the_line_is_slow() -> None:
    """Three times the dead time makes it swing: the yaw gain is therefore 4, not 8."""
    late_s = 3.0 * DEAD_S
    given = wall_step(MODEL, 0.02, dead_s=late_s)
    stiff = wall_step(MODEL, 0.02, replace(FollowTuning(), yaw_gain_s=8.0), dead_s=late_s)
    assert given.settled_s(WALL_BAND_M) * CRUISE_M_S < 0.9
    assert stiff.settled_s(WALL_BAND_M) == math.inf


# ---- the same on the virtual sweeper's plant ---------------------------------------------


def observe(drive: SimDrive, left_m: float | None) -> Observation:
    estimator = drive.estimator
    return AT_REST._replace(
        time_s=0.01 * drive.tick,
        pose=estimator.pose,
        v_m_s=estimator.v_m_s,
        yaw_rate_rad_s=estimator.yaw_rate_rad_s,
        infrared_left_m=left_m,
    )


def drive_leg(level: str, seed: int, leg: Leg, start: Pose2) -> list[Pose2]:
    """Return true poses every 20 ms, until the leg is done."""
    drive = SimDrive(room(start, walls=box(0.0, 0.0, 6.0, 4.0)), level, seed, walls=False)
    drive.rest(2.0)
    executor = LegExecutor(MODEL)
    left_m: float | None = None
    executor.start(leg, observe(drive, left_m))
    poses: list[Pose2] = []
    while executor.result is None:
        if len(poses) % 5 in {0, 3}:
            left_m = drive.suite.ranges().infrared_left_m
        command = executor.step(observe(drive, left_m))
        drive.step(*command)
        drive.step(*command)
        poses.append(drive.body.pose)
    return poses


@pytest.mark.parametrize("seed", range(3))
def test_the_body_settles_on_a_bearing_like_the_plant(seed: int) -> None:
    angle = math.radians(30.0)
    x, y = 1.0 + math.cos(angle), 1.0 + math.sin(angle)
    poses = drive_leg("typical", seed, GoTo(x, y), Pose2(1.0, 1.0, 0.0))
    left = [
        math.remainder(math.atan2(y - p.y_m, x - p.x_m) - p.theta_rad, math.tau)
        for p in poses
        if math.hypot(x - p.x_m, y - p.y_m) > 0.1
    ]
    seen = StepResponse(
        [0.02 * (i + 1) for i in range(len(left))], [angle - e for e in left], [], angle
    )
    plant = bearing_step(MODEL, angle)
    assert seen.overshoot < 0.02
    # its own wheel control also ramps from rest: 0.16 s of rise, 0.36 s until it is settled
    assert 0.0 < seen.rise_s - plant.rise_s < 0.25
    assert 0.0 < seen.settled_s(BEARING_BAND_RAD) - plant.settled_s(BEARING_BAND_RAD) < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_the_body_settles_on_a_walls_distance_like_the_plant(seed: int) -> None:
    y = 4.0 - MODEL.radius_m - 0.05
    leg = FollowWall(left=True, gap_m=0.05, distance_m=2.5)
    poses = drive_leg("typical", seed, leg, Pose2(1.0, y - 0.02, 0.0))
    off_m = [p.y_m - y for p in poses]
    assert max(off_m) < 0.005
    assert max(abs(off) for p, off in zip(poses, off_m, strict=True) if p.x_m > 2.0) < 0.005
