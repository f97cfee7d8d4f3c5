"""CPU time of the recovery planner on a 60 m² flat: its decisions, and each control step.

    PYTHONPATH=tests python -m bench.decisions

The planner runs in the simple world of ``support.fast_world``, where it gets the true pose plus a
seeded error. That world has no estimator, no wire and no device. The planner and its controllers
are the real ones; the session's share of a control step is missing. Times are CPU times of this
thread. They include the reading of its clock (about half a microsecond).

The table has four rows:

- *whole step*: ``PlanRunner.step``, which is all work on one observation: the map, the controllers,
  and the planner when a leg has ended. The longest step must fit into a control period. The table
  shows it with and without the steps that call the planner.
- *watch*: the map's share of a whole step, in steps that do not call the planner.
- *call*: one ``start`` or ``next``, which returns a leg or does one slice of a search.
- *decision*: all calls from the end of a leg to the next leg. During a search the robot stands
  still, and *stood* counts those control steps of 20 ms. Most decisions only return the next leg of
  an earlier choice; the others *search*.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.runner import PlanRunner
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Dwell
from bridge.motion.observation import HALT
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, STEP_S, FastWorld
from tools.rooms.generator import column, rectangle, turned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.coverage.planner import Finish
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.legs import Leg, LegResult
    from bridge.motion.observation import Observation
    from support.fast_world import PoseNoise


def flat() -> FloorPlan:
    """Return a flat of 10 m by 6 m: a hall, five rooms with doors, furniture of every kind."""
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
    perimeter = rectangle(0.0, 0.0, 10.0, 6.0)
    return FloorPlan("flat-60", perimeter, tuple(obstacles), Pose2(5.5, 3.2, 0.3))


@dataclass(slots=True)
class Decision:
    """One decision: from the end of a leg, or the start, to the next leg."""

    begun_s: float
    cpu_ns: int = 0
    stood: int = 0
    """Number of control steps from the end of the leg to the next leg."""
    searched: bool = False


class Timed(RecoveryPlanner):
    """Records the CPU time of each call."""

    def __init__(self, model: RobotModel, options: RecoveryOptions | None = None) -> None:
        super().__init__(model, options)
        self.calls_ns: list[int] = []
        self.watch_ns = 0
        """CPU time of the last call of ``observe``, ns."""
        self.decisions: list[Decision] = []
        self._open: Decision | None = None
        self._searches = 0

    def start(self, obs: Observation) -> Leg | Finish:
        begun = time.thread_time_ns()
        leg = super().start(obs)
        self._take(leg, obs, time.thread_time_ns() - begun)
        return leg

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        begun = time.thread_time_ns()
        leg = super().next(result, obs)
        self._take(leg, obs, time.thread_time_ns() - begun)
        return leg

    def observe(self, obs: Observation) -> bool:
        begun = time.thread_time_ns()
        done = super().observe(obs)
        self.watch_ns = time.thread_time_ns() - begun
        return done

    def _take(self, leg: Leg | Finish, obs: Observation, cpu_ns: int) -> None:
        self.calls_ns.append(cpu_ns)
        decision = self._open or Decision(obs.time_s)
        decision.cpu_ns += cpu_ns
        decision.searched |= self.context.searches > self._searches
        self._searches = self.context.searches
        if isinstance(leg, Dwell) and leg.purpose == "think":
            self._open = decision
            return
        decision.stood = round((obs.time_s - decision.begun_s) / STEP_S)
        self.decisions.append(decision)
        self._open = None


@dataclass(slots=True)
class Run:
    """Times of one run; a list of nanoseconds has one entry for each control step."""

    planner: Timed
    asked_ns: list[int]
    """Times of whole steps in which the planner was called, ns."""
    unasked_ns: list[int]
    watch_ns: list[int]
    """Times of the map in the steps of ``unasked_ns``, ns."""
    duration_s: float
    finish_reason: str | None


def run(plan: FloorPlan, planner: Timed, seed: int, noise: PoseNoise) -> Run:
    """Run a planner to its end, and measure the time of each control step."""
    model = planner.model
    world = FastWorld(plan, model, seed, noise)
    runner = PlanRunner(planner, model)
    asked_ns, unasked_ns, watch_ns = [], [], []
    obs = world.step(HALT)
    while not runner.finished:
        calls = len(planner.calls_ns)
        begun = time.thread_time_ns()
        command = runner.step(obs)
        took_ns = time.thread_time_ns() - begun
        if len(planner.calls_ns) > calls:
            asked_ns.append(took_ns)
        else:
            unasked_ns.append(took_ns)
            watch_ns.append(planner.watch_ns)
        obs = world.step(command)
        runner.drain_events()
    return Run(planner, asked_ns, unasked_ns, watch_ns, world.time_s, runner.finish_reason)


def row(name: str, values: Sequence[float], unit: str) -> str:
    """Return count, median, p99 and maximum."""
    data = np.array(values)
    median, p99 = np.percentile(data, (50, 99))
    return f"{name:42} {len(data):7d} {median:8.2f} {p99:8.2f} {data.max():8.2f}  {unit}"


def report(done: Run) -> None:
    """Print one run's table."""
    planner = done.planner
    searched = [decision for decision in planner.decisions if decision.searched]
    print(f"{'':42} {'how many':>7} {'median':>8} {'p99':>8} {'most':>8}")
    for name, values_ns, unit, in_ns in (
        ("whole step, any", done.asked_ns + done.unasked_ns, "µs", 1e3),
        ("whole step, planner not asked", done.unasked_ns, "µs", 1e3),
        ("  of it, watch (the map)", done.watch_ns, "µs", 1e3),
        ("whole step, planner asked", done.asked_ns, "ms", 1e6),
        ("call (a leg handed over, or one slice)", planner.calls_ns, "ms", 1e6),
        ("decision, any: CPU, slices summed", [d.cpu_ns for d in planner.decisions], "ms", 1e6),
        ("decision that searches: CPU, slices summed", [d.cpu_ns for d in searched], "ms", 1e6),
    ):
        print(row(name, [value / in_ns for value in values_ns], unit))
    print(row("decision that searches: stood", [d.stood for d in searched], "steps of 20 ms"))
    stood_s = STEP_S * sum(decision.stood for decision in searched)
    print(f"stood for searches: {stood_s:.1f} s of {done.duration_s:.0f}")
    memory = planner.context.evidence_map
    print(f"the longest control step: {max(done.asked_ns + done.unasked_ns) / 1e6:.2f} ms of 20")
    print(
        f"map at rest, 2 bits a cell: {memory.packed().size_bytes} B; the layers that the planner"
        f" drives on: {6 * memory.swept.nbytes} B"
    )


def main() -> None:
    """Run the planner once for each seed and print the tables."""
    options = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n")[0],
        epilog="In the quick toy world, the pose with a drawn error; not the virtual sweeper.",
    )
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--noise", choices=list(LEVELS), default="typical")
    given = options.parse_args()
    model = RobotModel()
    plan = flat()
    print(f"{plan.name} in the quick toy world, pose with a drawn error, noise {given.noise}")
    for seed in range(given.seeds):
        gc.collect()
        gc.freeze()
        done = run(plan, Timed(model), seed, LEVELS[given.noise])
        print(f"\nseed {seed}: {done.duration_s:.0f} s, {done.finish_reason}")
        report(done)


if __name__ == "__main__":
    main()
