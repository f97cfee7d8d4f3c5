"""CPU time of the recovery planner's decisions on a 60 m² flat, and of a step without one.

PYTHONPATH=tests python -m bench.decisions
"""

from __future__ import annotations

import argparse
import gc
import itertools
import time
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.floorplan import FloorPlan
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.recovery.rehearse import rehearse
from bridge.coverage.room_generator import column, rectangle, turned
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast

if TYPE_CHECKING:
    from bridge.coverage.planner import Finish
    from bridge.motion.legs import Leg, LegResult
    from bridge.motion.observation import Observation


def flat() -> FloorPlan:
    """A flat of 10 m by 6 m: a hall, five rooms with doors, furniture of every kind."""
    wall = 0.1
    hall = (2.6, 3.8)
    obstacles = []
    for low, cuts in ((hall[1], (0.0, 3.3, 6.6, 10.0)), (hall[0] - wall, (0.0, 5.0, 10.0))):
        for x0, x1 in itertools.pairwise(cuts):
            door = x0 + 0.4 * (x1 - x0)
            obstacles.append(rectangle(x0, low, door, low + wall))
            obstacles.append(rectangle(door + 0.8, low, x1, low + wall))
    obstacles += [
        rectangle(x - 0.05, y0, x + 0.05, y1)
        for x, y0, y1 in ((3.3, 3.9, 6.0), (6.6, 3.9, 6.0), (5.0, 0.0, 2.5))
    ]
    obstacles += [
        rectangle(0.0, 0.0, 2.0, 0.9),
        rectangle(4.0, 0.0, 4.95, 0.5),
        rectangle(0.0, 5.2, 1.6, 6.0),
        rectangle(7.6, 4.8, 8.6, 5.5),
        turned(8.0, 1.2, 1.4, 0.8, 0.5),
        column(4.4, 5.0, 0.25),
        column(9.3, 3.2, 0.15),
    ]
    obstacles += [turned(x, y, 0.04, 0.04, 0.1) for x in (1.9, 2.9) for y in (1.3, 2.0)]
    outline = rectangle(0.0, 0.0, 10.0, 6.0)
    return FloorPlan("flat-60", outline, tuple(obstacles), Pose2(5.5, 3.2, 0.3))


class Timed(RecoveryPlanner):
    """Keeps the CPU time of each call."""

    def __init__(self, model: RobotModel) -> None:
        super().__init__(model)
        self.decisions_ns: list[int] = []
        self.steps_ns: list[int] = []
        self.packed = 0

    def start(self, obs: Observation) -> Leg | Finish:
        begun = time.thread_time_ns()
        leg = super().start(obs)
        self.decisions_ns.append(time.thread_time_ns() - begun)
        return leg

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        begun = time.thread_time_ns()
        leg = super().next(result, obs)
        self.decisions_ns.append(time.thread_time_ns() - begun)
        return leg

    def watch(self, obs: Observation) -> bool:
        begun = time.thread_time_ns()
        done = super().watch(obs)
        self.steps_ns.append(time.thread_time_ns() - begun)
        return done


def main() -> None:
    """Run it once for each seed and print the spread."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--noise", choices=list(LEVELS), default="typical")
    given = options.parse_args()
    model = RobotModel()
    rehearse(model)
    plan = flat()
    print("seed  decisions  median ms    p99  worst | steps  median us    p99 | packed map B")
    for seed in range(given.seeds):
        planner = Timed(model)
        gc.collect()
        gc.freeze()
        done = run_fast(plan, planner, model, seed=seed, noise=LEVELS[given.noise])
        ms = np.array(planner.decisions_ns) / 1e6
        us = np.array(planner.steps_ns) / 1e3
        print(
            f"{seed:4d} {len(ms):10d} {np.median(ms):10.2f} {np.percentile(ms, 99):6.2f} "
            f"{ms.max():6.2f} | {len(us):6d} {np.median(us):6.1f} {np.percentile(us, 99):6.1f}"
            f" | {len(planner.memory.packed()):6d}   {done.duration_s:.0f} s, {done.finish_reason}"
        )


if __name__ == "__main__":
    main()
