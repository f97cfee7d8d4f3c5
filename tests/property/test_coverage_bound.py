"""No motion within the robot's speed limits is faster than the lower bound of the time."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.coverage.registry import make_planner
from bridge.evaluation.metrics import CoverageMeter, max_sweep_rate_m2_s
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast
from tools.rooms.generator import KINDS, generate_room

pytestmark = pytest.mark.slow

MODEL = RobotModel()
_STEP_S = 0.02
_EDGE = 0.004
"""Tolerated share of a room: cells at the edge of the swept floor may count too early."""

HALL = FloorPlan("hall", ((-2, -2), (2, -2), (2, 2), (-2, 2)), (), Pose2(0.0, 0.0, 0.0))


def corridor(length_m: float, width_m: float) -> FloorPlan:
    walls = ((0.0, 0.0), (length_m, 0.0), (length_m, width_m), (0.0, width_m))
    return FloorPlan(f"{length_m} x {width_m}", walls, (), Pose2(0.25, width_m / 2, 0.0))


CORRIDORS = [corridor(12.0, 0.7), corridor(12.0, 0.42), corridor(12.0, 0.36), corridor(6.0, 0.5)]
DRAWN = [generate_room(seed, np.random.default_rng(seed), kind) for seed, kind in enumerate(KINDS)]


@pytest.mark.parametrize("planner", ["recovery", "u-shape"])
@pytest.mark.parametrize("plan", [*CORRIDORS, *DRAWN], ids=lambda plan: plan.name)
def test_no_run_beats_the_time_bound(plan: FloorPlan, planner: str) -> None:
    made = make_planner(planner, MODEL, random.Random(1))
    run = run_fast(plan, made, MODEL, seed=1, noise=LEVELS["typical"], max_time_s=300.0)
    meter = CoverageMeter(plan, MODEL, 0.01)
    report = meter.measure(run.poses)
    assert report.coverage.mouth_sweepable > 0.04, "the robot swept no floor"
    times = np.linspace(0.0, report.duration_s, 600)
    shares = np.array(meter.share_at(report, times.tolist()))
    assert (shares <= times / report.min_time_s + _EDGE).all()


def test_a_run_may_beat_the_reference_time() -> None:
    """A run can be faster than the reference time, so the report must not call it a bound."""
    made = make_planner("recovery", MODEL, random.Random(1))
    plan = corridor(12.0, 0.7)
    run = run_fast(plan, made, MODEL, seed=1, noise=LEVELS["typical"], max_time_s=300.0)
    meter = CoverageMeter(plan, MODEL, 0.01)
    report = meter.measure(run.poses)
    (share,) = meter.share_at(report, [0.5 * report.reference_time_s])
    assert share > 0.5


@given(
    width_m=st.floats(0.05, 0.5),
    offset_m=st.floats(-0.1, 0.2),
    max_speed_m_s=st.floats(0.02, 0.5),
    max_yaw_rate_rad_s=st.floats(0.1, 4.0),
    commands=st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.sampled_from([-1.0, 0.0, 0.3, 1.0])),
        min_size=1,
        max_size=4,
    ),
)
def test_no_motion_within_the_limits_sweeps_faster(
    width_m: float,
    offset_m: float,
    max_speed_m_s: float,
    max_yaw_rate_rad_s: float,
    commands: list[tuple[float, float]],
) -> None:
    model = replace(
        MODEL,
        cleaning_width_m=width_m,
        mouth_offset_m=offset_m,
        max_speed_m_s=max_speed_m_s,
        cruise_speed_m_s=max_speed_m_s,
        max_yaw_rate_rad_s=max_yaw_rate_rad_s,
    )
    x_m = y_m = theta_rad = time_s = 0.0
    track = [(0.0, x_m, y_m, theta_rad)]
    for speed, yaw_rate in commands:
        for _ in range(50):
            time_s += _STEP_S
            step_m = speed * max_speed_m_s * _STEP_S
            x_m += step_m * math.cos(theta_rad)
            y_m += step_m * math.sin(theta_rad)
            theta_rad += yaw_rate * max_yaw_rate_rad_s * _STEP_S
            track.append((time_s, x_m, y_m, theta_rad))
    meter = CoverageMeter(HALL, model, 0.01)
    report = meter.measure(track)
    swept_m2 = report.coverage.mouth_free * report.free_m2
    rate_m2_s = max_sweep_rate_m2_s(model)
    path_m = width_m + (abs(max_speed_m_s) + max_yaw_rate_rad_s * (width_m + 0.2)) * time_s
    assert swept_m2 <= rate_m2_s * time_s * 1.02 + 0.01 * path_m
    assert report.min_time_s == pytest.approx(report.sweepable_m2 / rate_m2_s)


def test_the_rate_is_reached_straight_on_and_on_the_spot() -> None:
    """A narrow mouth sweeps fastest straight ahead, a wide mouth on a slow robot in a turn."""
    assert max_sweep_rate_m2_s(MODEL) == pytest.approx(0.30 * 0.16)
    slow = replace(MODEL, max_speed_m_s=0.02, cruise_speed_m_s=0.02, cleaning_width_m=0.4)
    spin = [(_STEP_S * k, 0.0, 0.0, 0.04 * k) for k in range(80)]  # half a turn, at 2 rad/s
    swept = CoverageMeter(HALL, slow, 0.005).measure(spin)
    rate_m2_s = swept.coverage.mouth_free * swept.free_m2 / swept.duration_s
    assert rate_m2_s == pytest.approx(2.0 * 0.2**2, rel=0.02)
    assert 0.4 * 0.02 < rate_m2_s <= max_sweep_rate_m2_s(slow)
