"""The recovery planner ends and rarely leaves a large hole, for random robots in random rooms.

The planner is meant for footprints of 0.20 to 0.50 m. The mouth is 0.3 to 0.9 of the diameter wide
and up to 0.4 of the diameter ahead of the axle. Sensor mounts and wheel bases vary too.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.holes import largest_hole
from bridge.evaluation.metrics import CoverageMeter, CoverageReport
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast
from tools.experiment.room_generator import generate_room

pytestmark = pytest.mark.slow

PAPER = RobotModel()
KINDS = ("box", "turned", "pockets", "columns", "legs", "ell", "corridor", "flat")
HOLE_WIDTHS = 0.25
"""Maximum inradius of a tolerated hole, in widths of the mouth. Floor that the mouth reaches only
when the robot turns towards a wall is not a hole: the planner leaves it if it is not worth its
time."""
FINE_SHARE = 0.9
"""Minimum share of runs without a larger hole."""


def robot(seed: int) -> RobotModel:
    """Return a random robot: mouth inside the footprint, infrared sensors inside the hull."""
    rng = np.random.default_rng([0xB07, seed])
    diameter_m = float(rng.uniform(0.20, 0.50))
    radius_m = 0.5 * diameter_m
    width_m = diameter_m * float(rng.uniform(0.3, 0.9))
    farthest_m = math.sqrt(radius_m**2 - (0.5 * width_m) ** 2)
    ahead_m = min(diameter_m * float(rng.choice([0.0, rng.uniform(0.0, 0.4)])), farthest_m)
    side_x_m = radius_m * float(rng.uniform(0.0, 0.5))
    side_y_m = math.sqrt(radius_m**2 - side_x_m**2) - float(rng.uniform(0.045, 0.07))
    return replace(
        PAPER,
        robot_diameter_m=diameter_m,
        cleaning_width_m=width_m,
        mouth_offset_m=ahead_m,
        wheel_base_m=diameter_m * float(rng.uniform(0.5, 0.9)),
        ultrasonic=replace(PAPER.ultrasonic, x_m=radius_m * float(rng.uniform(0.4, 0.95))),
        infrared_left=replace(PAPER.infrared_left, x_m=side_x_m, y_m=side_y_m),
        infrared_right=replace(PAPER.infrared_right, x_m=side_x_m, y_m=-side_y_m),
    )


def swept(seed: int) -> tuple[RobotModel, str | None, CoverageReport, float]:
    """Return the results of a run, and the inradius of its largest hole, m."""
    model, kind = robot(seed), KINDS[seed % len(KINDS)]
    plan = generate_room(seed, np.random.default_rng([0x500, seed]), kind, model.radius_m)
    meter = CoverageMeter(plan, model, 0.01)
    limit_s = 8.0 * meter.reference_time_s + 120.0
    planner, noise = RecoveryPlanner(model), LEVELS["typical"]
    run = run_fast(plan, planner, model, seed=seed, noise=noise, max_time_s=limit_s)
    report, regions = meter.measure(run.poses), meter.regions
    unswept = regions.passing & ~np.isfinite(report.first_swept_s)
    return model, run.finish_reason, report, largest_hole(regions.raster, unswept)[1]


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [10, pytest.param(200, marks=pytest.mark.nightly)])
def test_every_robot_ends_by_itself_and_few_leave_a_hole(count: int) -> None:
    fine = 0
    for seed in range(count):
        model, reason, report, hole_m = swept(seed)
        assert reason is not None, f"seed {seed} did not end by itself"
        assert "enclosed" not in reason, f"seed {seed}: {reason}"
        share = report.coverage.mouth_passing
        assert share > 0.9, f"seed {seed}: {share:.3f} of the floor"
        fine += hole_m <= HOLE_WIDTHS * model.cleaning_width_m
    assert fine >= FINE_SHARE * count, f"{fine} of {count} without a large hole"
