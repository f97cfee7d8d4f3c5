"""The counts of the planner benchmarks; the measurement must not change the planner."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from bench.decisions import Run, Timed, run
from bench.packed import KEEPINGS, Forgetful, blocks
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, STEP_S, FastRun, run_fast
from support.root import ROOT
from tools.rooms.generator import generate_room

pytestmark = pytest.mark.slow

MODEL, NOISE = RobotModel(), LEVELS["typical"]
ROOM = generate_room(3, np.random.default_rng(3), "turned")


@pytest.fixture(scope="module")
def timed() -> Run:
    """Return a run whose searches are split into many slices."""
    return run(ROOM, Timed(MODEL, RecoveryOptions(slice_cells=1000)), 0, NOISE)


def test_each_call_is_a_part_of_one_decision(timed: Run) -> None:
    planner = timed.planner
    assert sum(decision.cpu_ns for decision in planner.decisions) == sum(planner.calls_ns)
    assert len(planner.decisions) < len(planner.calls_ns)


def test_a_decision_lasts_as_long_as_the_standstill_for_its_search(timed: Run) -> None:
    searched = [decision for decision in timed.planner.decisions if decision.searched]
    handed_over = [decision for decision in timed.planner.decisions if not decision.searched]
    assert len(searched) > 20
    assert max(decision.stood for decision in searched) > 5
    assert all(decision.stood == 0 for decision in handed_over)
    # Each slice of a decision, except the first, comes one control step or more after the slice
    # before.
    slices = len(timed.planner.calls_ns) - len(timed.planner.decisions)
    assert sum(decision.stood for decision in searched) >= slices


def test_every_control_step_is_timed_once(timed: Run) -> None:
    # the world makes its first step before it calls the planner
    steps = round(timed.duration_s / STEP_S) - 1
    assert len(timed.asked_ns) + len(timed.unasked_ns) == steps
    assert len(timed.watch_ns) == len(timed.unasked_ns)
    assert 0 < len(timed.asked_ns) <= len(timed.planner.calls_ns)


def driven(planner: RecoveryPlanner) -> FastRun:
    """Return a run in which the planner tries some targets twice."""
    return run_fast(ROOM, planner, MODEL, seed=1, noise=NOISE)


def test_a_planner_that_keeps_all_is_the_planner() -> None:
    plain = driven(RecoveryPlanner(MODEL))
    assert driven(Forgetful(MODEL, KEEPINGS[0], 1)).poses == plain.poses
    assert driven(Timed(MODEL)).events == plain.events
    forgetful = Forgetful(MODEL, KEEPINGS[1], 1)
    done = driven(forgetful)
    assert done.poses != plain.poses
    assert done.finish_reason == plain.finish_reason
    assert not forgetful.context.evidence_map.attempts.any()


def test_a_block_stores_the_majority_of_its_cells() -> None:
    layer = np.zeros((8, 6), dtype=np.uint8)
    layer[:4, :2] = 1
    layer[4:, 0] = layer[4:7, 1] = 1
    layer[0, 4] = 1
    kept = blocks(layer)
    assert kept.shape == layer.shape
    assert kept[:4, :4].all()
    assert kept.sum() == 16


@pytest.mark.parametrize("bench", ["decisions", "packed"])
def test_the_command_as_documented(bench: str) -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text("utf-8")
    assert f"PYTHONPATH=tests python -m bench.{bench}" in page
    done = subprocess.run(
        [sys.executable, "-m", f"bench.{bench}", "--help"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": "tests"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "toy world" in done.stdout
