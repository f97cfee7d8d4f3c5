"""Complete runs in the small world: the paper's results, and the end of every run."""

from __future__ import annotations

import random
from functools import cache

import pytest

from bridge.coverage.baselines.paper import PaperOptions, PaperPlanner
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.registry import make_planner
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.kinematic_world import IDEAL, TYPICAL, KinematicWorld, Run, WorldNoise, run_plan
from support.selection import seeds

pytestmark = pytest.mark.slow

MODEL = RobotModel()


def room(
    name: str,
    width: float,
    depth: float,
    *boxes: tuple[float, float, float, float],
) -> FloorPlan:
    def corners(x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[float, float], ...]:
        return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))

    return FloorPlan(
        name,
        corners(0, 0, width, depth),
        tuple(corners(*b) for b in boxes),
        Pose2(0.18, 0.18, 0.0),
    )


CASE_1 = room("case-1", 2.06, 2.057, (0.66, 0.78, 1.46, 1.28))
CASE_2 = room("case-2", 2.4, 2.0, (1.7, 0.5, 2.4, 0.95), (0.55, 1.15, 1.15, 1.55))


@cache
def meter(plan: FloorPlan) -> CoverageMeter:
    return CoverageMeter(plan, MODEL)


@cache
def run(plan: FloorPlan, name: str, seed: int, noise: WorldNoise) -> Run:
    world = KinematicWorld(plan, MODEL, random.Random(seed), noise)
    return run_plan(world, make_planner(name, MODEL, random.Random(seed)), 2000.0)


def test_paper_on_case_1_without_noise_is_the_computed_figure() -> None:
    done = run(CASE_1, "paper", 0, IDEAL)
    report = meter(CASE_1).measure(done.poses, done.runner.lane_length_m)
    assert done.finish_reason == "side step blocked at both ends of the last lane"
    assert 0.93 <= report.coverage.body_free <= 0.945
    # Equation 8 as written gives 64 %, because the lanes are W wide and end before the walls.
    assert report.coverage.eq8 == pytest.approx(0.64, abs=0.03)
    assert report.coverage.mouth_free < 0.774


@pytest.mark.parametrize("seed", seeds(2, 3))
def test_paper_on_case_1_with_typical_noise(seed: int) -> None:
    done = run(CASE_1, "paper", seed, TYPICAL)
    report = meter(CASE_1).measure(done.poses)
    assert done.finish_reason is not None
    assert 0.90 <= report.coverage.body_free <= 0.97


@pytest.mark.parametrize("noise", [IDEAL, TYPICAL])
def test_paper_on_case_2(noise: WorldNoise) -> None:
    done = run(CASE_2, "paper", 1, noise)
    assert done.finish_reason is not None
    assert meter(CASE_2).measure(done.poses).coverage.body_free == pytest.approx(0.94, abs=0.02)


def test_paper_revisits_the_floor_that_u_shape_leaves() -> None:
    coverage = {
        name: meter(CASE_1).measure(run(CASE_1, name, 0, IDEAL).poses).coverage.body_free
        for name in ("paper", "u-shape")
    }
    assert coverage["paper"] > coverage["u-shape"] + 0.05
    assert [e.kind for e in run(CASE_1, "paper", 0, IDEAL).events].count("recovery-begin") == 1


def test_strict_end_leaves_most_of_case_1() -> None:
    """If the run ends at the first blocked step, the results are far from the paper's tables."""
    world = KinematicWorld(CASE_1, MODEL, random.Random(0))
    done = run_plan(world, PaperPlanner(MODEL, PaperOptions(end="blocked_step")), 2000.0)
    assert done.finish_reason is not None
    assert meter(CASE_1).measure(done.poses).coverage.body_free < 0.5


def test_random_bounce_covers_in_time_and_ends() -> None:
    world = KinematicWorld(CASE_1, MODEL, random.Random(3), TYPICAL)
    planner = RandomPlanner(MODEL, random.Random(3), RandomOptions(max_time_s=500.0))
    done = run_plan(world, planner, 2000.0)
    assert done.finish_reason == "time is up: 500 s"
    assert done.duration_s == pytest.approx(500.0, abs=5.0)
    report = meter(CASE_1).measure(done.poses)
    assert report.coverage.mouth_sweepable > 0.6
    assert report.repeat_ratio is not None
    assert report.repeat_ratio > 1.0


def test_equal_seeds_give_equal_runs() -> None:
    first = run_plan(
        KinematicWorld(CASE_2, MODEL, random.Random(4), TYPICAL),
        make_planner("paper", MODEL, random.Random(4)),
        60.0,
    )
    second = run_plan(
        KinematicWorld(CASE_2, MODEL, random.Random(4), TYPICAL),
        make_planner("paper", MODEL, random.Random(4)),
        60.0,
    )
    assert first.poses == second.poses


def test_the_estimate_stays_near_the_truth() -> None:
    assert run(CASE_1, "paper", 0, IDEAL).worst_pose_error_m < 0.02
    assert run(CASE_1, "paper", 0, TYPICAL).worst_pose_error_m < 0.08


def test_every_decision_is_reported_with_its_reason() -> None:
    done = run(CASE_1, "paper", 0, TYPICAL)
    kinds = [e.kind for e in done.events]
    assert kinds[0] == "start"
    assert kinds[-1] == "finish"
    assert {"lane", "blocked", "recovery-begin", "recovery-lane", "recovery-end"} <= set(kinds)
    assert all(e.reason for e in done.events)
