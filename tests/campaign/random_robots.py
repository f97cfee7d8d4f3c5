"""Random robots in random rooms: coverage, path, time and holes of the recovery planner.

    PYTHONPATH=tests python -m campaign.random_robots

The robots are within the ranges that the planner is meant for: a footprint of 0.20 to 0.50 m, a
mouth 0.3 to 0.9 of the diameter wide and up to 0.4 of the diameter ahead of the axle. Sensor mounts
and wheel bases vary too. The runs are in the simple world of ``support.fast_world``.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from statistics import fmean, median
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.holes import largest_hole
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast
from tools.rooms.generator import generate_room

if TYPE_CHECKING:
    from collections.abc import Sequence

PAPER = RobotModel()
KINDS = ("box", "turned", "pockets", "columns", "legs", "ell", "corridor", "flat")
HOLE_WIDTHS = 0.25
"""Maximum inradius of a tolerated hole, in widths of the mouth."""


@dataclass(frozen=True, slots=True)
class Run:
    """Results of a run.

    ``hole_m`` is the inradius of the largest hole. Floor that the mouth reaches only when the robot
    turns towards a wall is not a hole: the planner leaves it if it is not worth its time.
    """

    seed: int
    kind: str
    model: RobotModel
    finish_reason: str | None
    mouth_passing: float
    path_ratio: float
    time_ratio: float
    hole_m: float

    @property
    def fine(self) -> bool:
        """Whether all holes are small for this robot."""
        return self.hole_m <= HOLE_WIDTHS * self.model.cleaning_width_m


def random_robot(seed: int) -> RobotModel:
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


def random_run(seed: int) -> Run:
    """Return the results of a random robot in a random room, at typical noise."""
    model, kind = random_robot(seed), KINDS[seed % len(KINDS)]
    plan = generate_room(seed, np.random.default_rng([0x500, seed]), kind, model.radius_m)
    meter = CoverageMeter(plan, model, 0.01)
    limit_s = 8.0 * meter.reference_time_s + 120.0
    planner, noise = RecoveryPlanner(model), LEVELS["typical"]
    run = run_fast(plan, planner, model, seed=seed, noise=noise, max_time_s=limit_s)
    report, regions = meter.measure(run.poses), meter.regions
    unswept = regions.passing & ~np.isfinite(report.first_swept_s)
    return Run(
        seed=seed,
        kind=kind,
        model=model,
        finish_reason=run.finish_reason,
        mouth_passing=report.coverage.mouth_passing,
        path_ratio=report.path_ratio,
        time_ratio=report.time_ratio,
        hole_m=largest_hole(regions.raster, unswept)[1],
    )


def row(name: str, runs: Sequence[Run]) -> str:
    """Return a line of the table."""
    share = [100.0 * run.mouth_passing for run in runs]
    path, time = ([getattr(run, key) for run in runs] for key in ("path_ratio", "time_ratio"))
    return (
        f"| {name} | {len(runs)} | {sum(run.finish_reason is not None for run in runs)} | "
        f"{fmean(share):.2f} | {min(share):.2f} | {median(path):.2f}, {max(path):.2f} | "
        f"{median(time):.2f}, {max(time):.2f} | {sum(not run.fine for run in runs)} |"
    )


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def main() -> int:
    """Run the robots and print the table; after Ctrl-C, the table of the runs that are done."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="robots; their seeds are 0, 1, ...")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args()
    if options.count < 1:
        parser.error("--count must be 1 or more")
    runs: list[Run] = []
    with ProcessPoolExecutor(options.jobs, initializer=_ignore_interrupts) as pool:
        try:
            for run in pool.map(random_run, range(options.count)):
                runs.append(run)
                print(f"\r{len(runs)} of {options.count}", end="", file=sys.stderr)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
    print(file=sys.stderr)
    if not runs:
        return 1
    print("| kind | runs | ended | mean % | worst % | length | time | with a hole |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        if of_kind := [run for run in runs if run.kind == kind]:
            print(row(kind, of_kind))
    print(row("all", runs))
    for run in runs:
        if not run.fine or run.finish_reason is None:
            share = 100.0 * run.mouth_passing
            widths = run.hole_m / run.model.cleaning_width_m
            print(f"seed {run.seed}: {share:.2f} %, hole {widths:.2f} widths, {run.finish_reason}")
    return 0 if len(runs) == options.count else 1


if __name__ == "__main__":
    sys.exit(main())
