"""The recovery planner in random rooms: it ends, sweeps, and is deterministic."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, FastRun, run_fast
from tools.rooms.generator import generate_room

pytestmark = pytest.mark.slow

MODEL = RobotModel()


def run(seed: int, kind: str, noise: str) -> tuple[FastRun, CoverageMeter]:
    plan = generate_room(seed, np.random.default_rng(seed), kind)
    planner = RecoveryPlanner(MODEL)
    done = run_fast(plan, planner, MODEL, seed=seed, noise=LEVELS[noise], max_time_s=4000.0)
    return done, CoverageMeter(plan, MODEL, 0.01)


@pytest.mark.parametrize("kind", ["box", "turned", "legs", "pockets"])
def test_it_ends_by_itself_and_has_swept_the_room(kind: str) -> None:
    done, meter = run(101, kind, "typical")
    assert done.finish_reason is not None
    report = meter.measure(done.poses)
    assert report.coverage.mouth_sweepable > 0.95
    assert report.hole_inradius_m < 0.08
    assert report.time_ratio < 3.5
    assert done.collisions < 2.0 * meter.sweepable_m2


def test_without_noise_little_is_left() -> None:
    done, meter = run(7, "corridor", "none")
    report = meter.measure(done.poses)
    assert report.coverage.mouth_sweepable > 0.975
    assert report.path_ratio < 1.9


def test_equal_seeds_give_equal_runs() -> None:
    first, _ = run(5, "columns", "typical")
    second, _ = run(5, "columns", "typical")
    assert first.poses == second.poses
    assert first.events == second.events


def test_every_decision_is_reported_with_its_reason() -> None:
    done, _ = run(3, "turned", "none")
    kinds = {event.kind for _, event in done.events}
    assert {"start", "perimeter-begin", "perimeter-end", "lane", "obstacle", "finish"} <= kinds
    assert all(event.reason for _, event in done.events)
