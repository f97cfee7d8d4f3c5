"""Measured gains, smoothing and braking: the series behind Fig. 12 and Fig. 15."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.motion.control.braking import Braking
from bridge.motion.control.executor import LegExecutor
from bridge.motion.control.pid import PidGains
from bridge.motion.control.point_to_point import DISTANCE_GAINS
from bridge.motion.control.rotary import ROTARY_GAINS
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive
from bridge.motion.robot_model import RobotModel
from bridge.motion.step_response import StepResponse
from support.observed import AT_REST
from support.sim_body import room
from support.sim_drive import SimDrive
from support.step_response import (
    BAND_RAD,
    DEAD_S,
    LAG_S,
    gain_table,
    point_step,
    rotary_step,
    smoothing_series,
)
from tools.experiment.u_cycles import PAPER_CYCLES, CycleOffset, UCycles

if TYPE_CHECKING:
    from bridge.motion.observation import Observation

MODEL = RobotModel()


# ---- gains -----------------------------------------------------------------------------


def test_overshoot_and_settling_are_read_off_the_series() -> None:
    seen = StepResponse([0.02, 0.04, 0.06, 0.08], [0.5, 1.1, 1.01, 1.0], [0.0] * 4, 1.0)
    assert seen.overshoot == pytest.approx(0.1)
    assert seen.settled_s(0.02) == pytest.approx(0.06)
    assert seen.settled_s(0.2) == pytest.approx(0.04)
    assert seen._replace(value=[0.0] * 4).settled_s(0.1) == math.inf


@pytest.mark.parametrize("degrees", [10.0, 45.0, 90.0, -90.0, 170.0])
def test_turns_end_without_overshoot(degrees: float) -> None:
    response = rotary_step(MODEL, math.radians(degrees))
    assert response.overshoot < 0.02
    # rate and acceleration limits alone take about |angle|/1.5 + 1.5/4 s
    assert response.settled_s(BAND_RAD) < math.radians(abs(degrees)) / 1.5 + 0.8
    assert max(abs(c) for c in response.command) <= 0.75 * MODEL.max_yaw_rate_rad_s + 1e-9


def test_the_rotary_gains_are_the_quickest_that_do_not_overshoot() -> None:
    fit = [row for row in gain_table(MODEL) if row.overshoot < 0.02]
    best = min(fit, key=lambda row: row.settled_s)
    assert (best.kp, best.td_s) == (ROTARY_GAINS.kp, ROTARY_GAINS.td_s)


def test_the_distance_gain_brakes_within_its_share_of_the_limit() -> None:
    assert DISTANCE_GAINS.kp * MODEL.cruise_speed_m_s == pytest.approx(0.75 * MODEL.max_accel_m_s2)
    response = point_step(MODEL, 0.5)
    assert response.overshoot == 0.0
    assert response.settled_s(0.006) < 5.0
    hasty = point_step(MODEL, 0.5, PidGains(kp=8.0))
    assert hasty.overshoot > 0.01, "the experiment can tell"


def test_the_lag_of_the_experiment_is_the_virtual_sweepers() -> None:
    """63 % of a step of 0.1 m/s includes the ramp of wheel control, lag and dead time."""
    drive = SimDrive(room((5.0, 5.0, 0.0)), "none", 1, walls=False)
    drive.rest(1.0)
    ticks = 0
    while drive.body.truth.v_m_s < 0.063:
        drive.step(0.1, 0.0)
        ticks += 1
    assert 0.01 * ticks == pytest.approx(LAG_S + DEAD_S, abs=0.05)


# ---- Fig. 12 ---------------------------------------------------------------------------


def test_smoothing_keeps_the_acceleration_limit_that_the_raw_command_breaks() -> None:
    series = smoothing_series(MODEL)
    assert series.greatest_acceleration <= MODEL.max_accel_m_s2 * (1 + 1e-9)
    assert max(series.before_m_s) == 0.2
    assert max(series.after_m_s) == pytest.approx(0.2, abs=1e-3)
    jumps = [abs(b - a) for a, b in zip(series.before_m_s, series.before_m_s[1:], strict=False)]
    assert max(jumps) / 0.02 == pytest.approx(10.0), "m/s², 25 times the limit"
    assert len(series.time_s) == len(series.before_m_s) == len(series.after_m_s) == 200


# ---- braking ---------------------------------------------------------------------------


def test_stop_distance_is_latency_and_ramp() -> None:
    brake = Braking(0.4, 0.1)
    assert brake.distance(0.2) == pytest.approx(0.2 * 0.1 + 0.2**2 / 0.8)
    assert brake.distance(-0.2) == brake.distance(0.2)
    assert brake.run_out(0.02) == pytest.approx(0.001)


@pytest.mark.parametrize("distance", [0.001, 0.01, 0.1, 1.0])
def test_the_speed_for_a_distance_needs_just_that_distance(distance: float) -> None:
    brake = Braking(0.3, 0.08)
    assert brake.distance(brake.speed(distance)) == pytest.approx(distance)
    assert Braking(0.3, 0.08, 0.025).speed(-1.0) == 0.025


@pytest.mark.parametrize("figures", [(0.0, 0.1, 0.0), (0.4, -0.1, 0.0), (0.4, 0.1, -1.0)])
def test_braking_rejects_figures_without_meaning(figures: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="braking needs"):
        Braking(*figures)


# ---- Fig. 15 ---------------------------------------------------------------------------


def test_cycles_end_where_the_plan_ends() -> None:
    plan = UCycles(Pose2(1.0, 2.0, math.pi / 2), cycles=2, lane_m=1.0, step_m=0.1)
    assert plan.path_m == pytest.approx(4.4)
    drives = [leg for _, leg in plan.legs() if isinstance(leg, Drive)]
    x, y = 1.0, 2.0
    for leg in drives:
        assert leg.distance_m is not None
        x += leg.distance_m * math.cos(leg.heading_rad)
        y += leg.distance_m * math.sin(leg.heading_rad)
    assert (x, y) == pytest.approx(plan.end(2)[:2])
    assert plan.end(2) == pytest.approx((1.0 - 0.4, 2.0, math.pi / 2))


def test_offsets_are_reported_along_and_across_the_lanes() -> None:
    plan = UCycles(Pose2(0.0, 0.0, math.pi / 2), cycles=2, lane_m=1.0, step_m=0.1)
    (first, second) = plan.offsets(
        [(10.0, Pose2(-0.2, 0.004, math.pi / 2)), (20.0, Pose2(-0.403, 0.0, 1.6))]
    )
    assert first == pytest.approx(CycleOffset(1, 10.0, 0.004, 0.0, 0.0))
    assert second.offset_m == second.across_m == pytest.approx(0.003)
    assert second.heading_rad == pytest.approx(1.6 - math.pi / 2)


@pytest.mark.parametrize("lengths", [(0, 1.0, 0.1), (1, 0.0, 0.1), (1, 1.0, -0.1)])
def test_cycles_without_extent_are_rejected(lengths: tuple[int, float, float]) -> None:
    cycles, lane_m, step_m = lengths
    with pytest.raises(ValueError, match="must be positive"):
        UCycles(Pose2(0.0, 0.0, 0.0), cycles=cycles, lane_m=lane_m, step_m=step_m)


def drive_cycles(seed: int) -> list[CycleOffset]:
    """Run the paper's experiment on the virtual plant: executor and estimate, no walls in range."""
    drive = SimDrive(room((5.0, 5.0, 0.0)), "paper", seed, walls=False)
    drive.rest(5.0)
    plan = UCycles(drive.estimator.pose)
    executor = LegExecutor(MODEL)
    ends: list[tuple[float, Pose2]] = []
    for cycle, leg in plan.legs():
        executor.start(leg, observe(drive))
        while executor.result is None:
            command = executor.step(observe(drive))
            drive.step(*command)
            drive.step(*command)
        if cycle > len(ends):
            ends.append((0.01 * drive.tick, drive.body.pose))
    return plan.offsets(ends)


def observe(drive: SimDrive) -> Observation:
    estimator = drive.estimator
    return AT_REST._replace(
        time_s=0.01 * drive.tick,
        pose=estimator.pose,
        v_m_s=estimator.v_m_s,
        yaw_rate_rad_s=estimator.yaw_rate_rad_s,
        ultrasonic_m=drive.front_m,
    )


def test_seven_cycles_at_paper_noise_end_some_millimetres_off() -> None:
    """The paper's Fig. 15 has 7 mm, which includes the controllers' own share."""
    run = drive_cycles(1)
    assert [point.cycle for point in run] == list(range(1, PAPER_CYCLES + 1))
    assert run[-1].time_s > 120.0
    assert 0.001 < run[-1].offset_m < 0.03
