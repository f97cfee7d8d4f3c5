"""The length of a run. A report has no values beyond the end of a run."""

from __future__ import annotations

import json
import math

import pytest

from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from sim_device.body.chassis import Chassis
from sim_device.body.motors import MotorParameters
from tools.experiment import curves
from tools.experiment.curves import MULTIPLES
from tools.experiment.span import cruise_power_w, limit_s, planner_of
from tools.experiment.tables import at_multiples
from tools.experiment.trials import PERFECT, Trial, TrialKind, room_of
from tools.experiment.worker import run_trial
from tools.experiment.zimablue_run import limit_s as their_limit_s

pytestmark = pytest.mark.slow

MODEL = RobotModel()


# ---- the length of a run ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def closet(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a room that is so small that eight times its reference time is short."""
    path = tmp_path_factory.mktemp("rooms") / "closet.json"
    corners = [[0.0, 0.0], [0.6, 0.0], [0.6, 0.6], [0.0, 0.6]]
    room = {"name": "closet", "walls": corners, "obstacles": [], "start": [0.3, 0.3, 0.0]}
    path.write_text(json.dumps(room))
    return str(path)


def test_random_runs_for_the_compared_time(closet: str) -> None:
    run = run_trial(Trial(closet, "random", "typical", 0))
    assert run["duration_s"] > MULTIPLES[-1] * run["reference_time_s"]
    assert run["energy_wh"] > MULTIPLES[-1] * run["reference_energy_wh"]
    # The run ends soon afterwards.
    assert run["duration_s"] < 12 * run["reference_time_s"]
    assert run["outcome"] == "timeout"
    for curve in ("coverage", "by_energy"):
        assert None not in run["curve"][curve]
    # the path is shorter than eight times the reference path, so the last value is unknown
    assert run["path_ratio"] < MULTIPLES[-1]
    assert run["curve"]["by_path"][-1] is None


def test_random_ended_by_time_is_not_held_level(closet: str) -> None:
    whole = run_trial(Trial(closet, "random", "typical", 0))
    unit_s = whole["reference_time_s"]
    cut = run_trial(Trial(closet, "random", "typical", 0, 2.2 * unit_s))
    assert cut["limit_s"] == 2.2 * unit_s
    known = sum(multiple <= 2.0 for multiple in MULTIPLES)
    for curve in ("coverage", "by_energy", "energy_wh"):
        assert cut["curve"][curve] == whole["curve"][curve][:known] + [None] * (11 - known)
    assert at_multiples([cut, whole], "coverage")[known:] == ["-"] * (11 - known)


def test_a_planners_own_time_limit_gives_no_comparison() -> None:
    planner = planner_of(Trial("case-1", "random", "none", 5), MODEL)
    assert isinstance(planner, RandomPlanner)
    assert planner.options.max_time_s == math.inf
    # outside experiments the planner has a limit, because a person waits for the robot
    assert RandomOptions().max_time_s == 1800.0
    for name in ("paper", "u-shape", "recovery"):
        assert not isinstance(planner_of(Trial("case-1", name, "none", 0), MODEL), RandomPlanner)


def test_an_hour_is_not_enough_in_every_room() -> None:
    small, large = (CoverageMeter(room_of(name), MODEL, 0.02) for name in ("empty", "studio-flat"))
    trial = Trial("empty", "random", "typical", 0)
    assert limit_s(trial, small) == 3600.0
    assert limit_s(trial, large) > MULTIPLES[-1] * large.reference_time_s > 3600.0
    asked = Trial("empty", "random", "typical", 0, 7.0)
    assert limit_s(asked, large) == 7.0
    assert their_limit_s(trial, large.reference_time_s) == 6.0 * large.reference_time_s > 3600.0
    assert their_limit_s(asked, large.reference_time_s) == 7.0


def test_a_perfect_pose_goes_as_far_and_reports_its_loss(closet: str) -> None:
    run = run_trial(Trial(closet, "random", PERFECT, 0, None, TrialKind.LIMITS))
    assert run["time_ratio"] > MULTIPLES[-1]
    assert sum(run["loss"].values()) == pytest.approx(1.0 - run["mouth_sweepable"], abs=1e-3)


# ---- energy -----------------------------------------------------------------------------------


def test_the_power_at_cruise_by_the_motors_constants() -> None:
    motor, chassis = MotorParameters(), Chassis()
    wheel_m = 0.5 * MODEL.wheel_diameter_m
    torque_nm = 0.5 * chassis.caster_drag_n * wheel_m
    current_a = motor.friction_v / motor.resistance_ohm + torque_nm / motor.back_emf_v_s
    volts = motor.resistance_ohm * current_a + motor.back_emf_v_s * MODEL.cruise_speed_m_s / wheel_m
    power_w = chassis.electronics_w + 2.0 * current_a * (volts + MODEL.driver_drop_v)
    assert cruise_power_w(MODEL) == pytest.approx(power_w, rel=0.02)


def test_a_straight_lane_by_energy() -> None:
    side = 2.0
    plan = FloorPlan("s", ((0, 0), (side, 0), (side, side), (0, side)), (), Pose2(0.5, 1.0, 0.0))
    meter = CoverageMeter(plan, MODEL, 0.01)
    track = [(0.1 * k, 0.5 + 0.01 * k, 1.0, 0.0) for k in range(101)]
    measured = meter.measure(track)
    area = (side - 0.16) ** 2 - (4 - math.pi) * 0.08**2
    lane = MODEL.cleaning_width_m / area
    # 0.2 Wh/s in the first half, and 0.6 Wh/s in the second half: 4 Wh in total
    drawn = [(0.0, 0.0), (5.0, 1.0), (10.0, 4.0)]
    found = curves.over_energy(meter, measured, drawn, 1.0)
    by_hand = {0.5: 0.25, 1.0: 0.5, 2.5: 0.75, 4.0: 1.0, 5.0: 1.0, 8.0: 1.0}
    for multiple, path_m in by_hand.items():
        assert found[MULTIPLES.index(multiple)] == pytest.approx(path_m * lane, abs=0.03 * lane)
    cut = curves.over_energy(meter, measured, drawn, 1.0, cut=True)
    known = MULTIPLES.index(4.0) + 1
    assert cut == found[:known] + [None] * (len(MULTIPLES) - known)
    assert curves.over_energy(meter, measured, [], 1.0, cut=True) == [None] * len(MULTIPLES)
