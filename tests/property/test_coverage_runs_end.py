"""Every run ends by itself, in any room."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.coverage.registry import make_planner
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.kinematic_world import TYPICAL, KinematicWorld, run_plan

MODEL = RobotModel()


@st.composite
def rooms(draw: st.DrawFn) -> FloorPlan:
    width = draw(st.floats(0.9, 2.2))
    depth = draw(st.floats(0.9, 2.2))
    boxes = []
    for _ in range(draw(st.integers(0, 2))):
        x = draw(st.floats(0.5, width - 0.1))
        y = draw(st.floats(0.5, depth - 0.1))
        dx = draw(st.floats(0.05, 0.5))
        dy = draw(st.floats(0.05, 0.5))
        boxes.append(((x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy)))
    start = Pose2(0.2, 0.2, draw(st.floats(-3.1, 3.1)))
    walls = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    return FloorPlan("drawn", walls, tuple(boxes), start)


@settings(max_examples=12)
@given(rooms(), st.sampled_from(["paper", "u-shape"]), st.integers(0, 1000))
def test_lane_planners_end_by_themselves(plan: FloorPlan, name: str, seed: int) -> None:
    world = KinematicWorld(plan, MODEL, random.Random(seed), TYPICAL)
    done = run_plan(world, make_planner(name, MODEL, random.Random(seed)), 3000.0)
    assert done.finish_reason
    report = CoverageMeter(plan, MODEL, 0.01).measure(done.poses)
    coverage = report.coverage
    assert 0.0 < coverage.body_free <= coverage.body_reachable + 0.02 <= 1.02
    assert coverage.mouth_free <= coverage.body_free
    assert 0.0 <= coverage.mouth_sweepable <= 1.0
