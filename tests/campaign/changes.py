r"""Measure what the robot detects, reports and sweeps if the world changes during a run.

    PYTHONPATH=tests python -m campaign.changes --out docs/changes-campaign.md

Every run is the whole stack in virtual time with the planner ``recovery`` on the host, without
supervision. With ``--keep FILE`` an interrupted campaign continues, as long as the checks are the
same.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from bridge.coverage.swept_map import SweptMap
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.session.records import EventRecord, TruthRecord
from campaign.changes_page import page
from campaign.kept import Kept, stored_results
from sim_device.body.footing import wheel_over
from sim_device.faults.fault_target import moved_plan
from sim_device.faults.kinds import parse_fault
from sim_device.world.world import World
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from bridge.run.host import Host
    from bridge.session.records import Record
    from tools.virtual.run import VirtualRun

ROOMS = (
    *("case-1", "case-2", "columns", "comprehensive", "empty", "l-room", "studio-flat"),
    *("table-and-chair", "two-rooms"),
)
FURNISHED = tuple(room for room in ROOMS if load_room(room).obstacles)
NEAR_M = 0.06
"""Maximum distance from truly swept floor at which claimed floor counts as swept, m. It covers the
error of the estimate and a cell of the map."""
MODEL = RobotModel()


@dataclass(frozen=True)
class Change:
    """One kind of change."""

    name: str
    rooms: tuple[str, ...] = ROOMS
    noise: str = "typical"
    max_s: float = 3000.0
    stops_within_s: float | None = None
    """Maximum time from the change to the end of the run, s; None: the run may go on."""
    completes: bool = False
    """True if every run must complete, unless furniture holds the robot."""
    is_reported: bool = False
    """True if every run must report that the walls do not fit the room."""


CHANGES = (
    Change("none", completes=True),
    Change("none, harsh", noise="harsh", completes=True),
    Change("wheels spin freely", stops_within_s=10.0),
    Change("one wheel spins freely", stops_within_s=10.0),
    Change("started elsewhere", max_s=400.0, is_reported=True),
    Change("cliff, harsh", ("pit",), "harsh", completes=True),
    Change("lifted, put down elsewhere", stops_within_s=10.0),
    Change("displaced, unfelt"),
    Change("furniture moved", FURNISHED),
    Change("a person walks by", completes=True),
)


@dataclass(frozen=True)
class Job:
    """One run."""

    change: Change
    seed: int

    @property
    def room(self) -> str:
        """The room, which the seed chooses."""
        return self.change.rooms[self.seed % len(self.change.rooms)]

    @property
    def name(self) -> str:
        """Unique name of the run."""
        return f"{self.change.name} {self.room} {self.seed}"


@dataclass
class Result:
    """Result of the run."""

    outcome: str = ""
    reason: str = ""
    fault: str = ""
    at_s: float = math.inf
    """Time of the change since the first move, s."""
    ended_s: float = 0.0
    """End of the drive since the first move, s."""
    events: list[str] = field(default_factory=list)
    """Kinds of the events of the room checks."""
    claimed_wrongly_m2: float = 0.0
    """Area that the final map wrongly shows as swept, m²."""
    coverage: float = 0.0
    """Swept share of the floor that the mouth can reach both before and after the change."""
    collisions_per_m2: float = 0.0
    start_error_m: float | None = None
    """Error of the reported distance to the room's start, m."""
    fell: bool = False
    held: bool = False
    """True if the moved furniture was put on the robot and held it."""


class Observer:
    """Sink for the records of a run."""

    def __init__(self) -> None:
        """Begin without records."""
        self.events: list[EventRecord] = []
        self.truth: list[tuple[int, Pose2]] = []

    def write(self, record: Record) -> None:
        """Store the events of the room checks, and the true path."""
        if isinstance(record, TruthRecord):
            self.truth.append((record.log_ns, record.pose))
        elif isinstance(record, EventRecord) and record.source == "room":
            self.events.append(record)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Do nothing: no file is open."""


def pit(rng: random.Random) -> FloorPlan:
    """Draw a room with a pit."""
    width, depth = rng.uniform(2.2, 3.5), rng.uniform(2.0, 3.0)
    x, y = rng.uniform(0.9, width - 0.9), rng.uniform(0.9, depth - 0.9)
    dx, dy = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6)
    hole = ((x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy))
    walls = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    return FloorPlan("pit", walls, (), Pose2(0.3, 0.3, rng.uniform(-3.0, 3.0)), cliffs=(hole,))


def fault_of(job: Job, plan: FloorPlan, rng: random.Random) -> str:
    """Draw the fault of a change; an empty text means no fault."""
    at_s = round(rng.uniform(15.0, 100.0), 1)
    dx, dy = _free_shift(plan, rng) if "started" in job.change.name else _shift(rng)
    to = f"dx={dx:.2f},dy={dy:.2f},turn={rng.choice((0.0, rng.uniform(-180.0, 180.0))):.0f}"
    index, side = rng.randrange(len(plan.obstacles) or 1), rng.choice(("left", "right"))
    person = f"ahead={rng.uniform(0.5, 1.2):.2f},speed={rng.uniform(0.3, 1.2):.2f}"
    return {
        "wheels spin freely": f"wheel-slip@{at_s}:share=1",
        "one wheel spins freely": f"wheel-slip@{at_s}:side={side},share=1",
        "started elsewhere": f"displaced@0:{to}",
        "lifted, put down elsewhere": f"carried@{at_s}:{rng.uniform(1.0, 6.0):.1f}:{to}",
        "displaced, unfelt": f"displaced@{at_s}:{to}",
        "furniture moved": f"obstacle@{at_s}:index={index},dx={dx:.2f},dy={dy:.2f}",
        "a person walks by": f"person@{at_s}:40:{person}",
    }.get(job.change.name, "")


def _shift(rng: random.Random) -> tuple[float, float]:
    dx, dy = (rng.choice((-1.0, 1.0)) * rng.uniform(0.15, 0.9) for _ in range(2))
    return dx, dy


def _free_shift(plan: FloorPlan, rng: random.Random) -> tuple[float, float]:
    """Draw a shift of the start to a free place."""
    world = World(plan, MODEL)
    while True:
        dx, dy = _shift(rng)
        x_m, y_m = plan.start.x_m + dx, plan.start.y_m + dy
        if world.is_floor(x_m, y_m) and world.clearance_m(x_m, y_m) > 0.0:
            return dx, dy


def run(job: Job, fault: str | None = None) -> Result:
    """Run one job, with a fault that its seed determines or with ``fault``."""
    rng = random.Random(job.name)
    plan = pit(rng) if job.room == "pit" else load_room(job.room)
    result = Result(fault=fault_of(job, plan, rng) if fault is None else fault)
    observer = Observer()
    made: list[VirtualRun] = []

    def look(t_s: float, host: Host) -> None:
        del t_s, host
        plant = made[0].device.plant
        result.fell |= wheel_over(plant.pose, 0.5 * MODEL.wheel_base_m, plan.cliffs)
        result.held |= plant.held

    done = run_virtual(
        plan,
        MODEL,
        "recovery",
        observer,
        seed=job.seed,
        noise=job.change.noise,
        max_time_s=job.change.max_s,
        faults=[parse_fault(result.fault)] if result.fault else [],
        progress=look,
        prepare=made.append,
    )
    result.held |= done.device.plant.held
    mission = done.host.mission
    assert mission.ending is not None
    result.outcome, result.reason = mission.ending.outcome, mission.ending.reason
    result.events = [str(event.kind) for event in observer.events]
    if mission.drive_started_s is not None and mission.drive_ended_s is not None:
        result.ended_s = mission.drive_ended_s - mission.drive_started_s
        boot_s = HOST_BOOT_NS * 1e-9
        if result.fault:
            at_s = parse_fault(result.fault).at_s or 0.0
            result.at_s = at_s + boot_s - mission.drive_started_s
    result.coverage, area_m2 = _coverage(done, plan, result.fault)
    result.collisions_per_m2 = done.device.truth.collisions / area_m2
    fit = done.host.plausibility.fit
    if job.change.name == "started elsewhere":
        if fit is not None and fit.start is not None:
            result.start_error_m = fit.start.distance_m(observer.truth[0][1])
    else:
        result.claimed_wrongly_m2 = _claimed_wrongly(done.host.swept, observer.truth)
    return result


def _coverage(done: VirtualRun, plan: FloorPlan, fault: str) -> tuple[float, float]:
    """Return the swept share of the floor that is reachable before and after, and its area, m²."""
    before = CoverageMeter(plan, MODEL)
    report = done.track.report(None)
    if not fault.startswith("obstacle"):
        return report.coverage.mouth_sweepable, before.sweepable_m2
    values = parse_fault(fault).values
    shift = (float(values["dx"]), float(values["dy"]))
    after = CoverageMeter(
        replace(moved_plan(plan, {round(float(values["index"])): shift}), start=plan.start),
        MODEL,
    )
    swept = np.isfinite(report.first_swept_s)
    both = before.regions.sweepable & after.regions.sweepable
    area_m2 = after.regions.raster.area_m2(both)
    return float((swept & both).sum() / max(both.sum(), 1)), area_m2


def _claimed_wrongly(claimed: SweptMap, truth: list[tuple[int, Pose2]]) -> float:
    """Return the area shown as swept farther than ``NEAR_M`` from truly swept floor, m²."""
    true = SweptMap(MODEL)
    for _, pose in truth:
        true.update(pose)
    ours, theirs = claimed.to_occupancy(), true.to_occupancy()
    cell_m = ours.resolution_m
    near = ndimage.distance_transform_edt(theirs.cells < 0) * cell_m <= NEAR_M
    rows, columns = np.nonzero(ours.cells >= 0)
    i = rows + round((ours.origin_y_m - theirs.origin_y_m) / cell_m)
    j = columns + round((ours.origin_x_m - theirs.origin_x_m) / cell_m)
    inside = (i >= 0) & (j >= 0) & (i < near.shape[0]) & (j < near.shape[1])
    right = np.zeros(len(i), dtype=bool)
    right[inside] = near[i[inside], j[inside]]
    return float((~right).sum() * cell_m**2)


def jobs_of(seeds: Iterable[int], changes: Iterable[Change] = CHANGES) -> list[Job]:
    """Return a job for every change with every seed."""
    return [Job(change, seed) for change in changes for seed in seeds]


def _stored(job: Job) -> dict[str, Any]:
    return asdict(run(job))


def results_of(jobs: list[Job], kept: Kept, processes: int) -> Iterator[tuple[Job, Result]]:
    """Yield every job with its result, in order."""
    stored = stored_results(_stored, {job.name: job for job in jobs}, kept, processes)
    for job, values in zip(jobs, stored, strict=True):
        yield job, Result(**values)


def violations(job: Job, result: Result) -> list[str]:
    """Return what a run must not do after its change, each as a line; empty: all is right."""
    change, found = job.change, []
    limit_s, took_s = change.stops_within_s, result.ended_s - result.at_s
    if limit_s is not None and not (result.outcome == "stopped" and took_s <= limit_s):
        found.append(f"not stopped within {limit_s:g} s: {result.outcome}")
    if change.is_reported and "start" not in result.events:
        found.append("the wrong start was not reported")
    if change.completes and not result.held and result.outcome != "complete":
        found.append(f"{result.outcome}: {result.reason}")
    if result.fell:
        found.append("a wheel was driven over a pit")
    return [f"{job.name}: {text}" for text in found]


def main() -> int:
    """Run the campaign and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=54, help="runs of each change")
    parser.add_argument("--first-seed", type=int, default=900, help="first seed")
    parser.add_argument("--changes", help="names of changes, separated by semicolons; default: all")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--keep", type=Path, help="results file; its results are not run again")
    parser.add_argument("--out", type=Path, help="write the page")
    options = parser.parse_args()
    wanted = None if options.changes is None else options.changes.split(";")
    names = [change.name for change in CHANGES]
    unknown = [] if wanted is None else [name for name in wanted if name not in names]
    if unknown:
        parser.error(f"no change {unknown[0]!r}: give one of {'; '.join(names)}")
    changes = [change for change in CHANGES if wanted is None or change.name in wanted]
    jobs = jobs_of(range(options.first_seed, options.first_seed + options.seeds), changes)
    results = list(results_of(jobs, Kept(options.keep), options.jobs))
    text = page([(job.change.name, result) for job, result in results], options.first_seed)
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    print(text)
    wrong = [text for job, result in results for text in violations(job, result)]
    print("\n".join(wrong), file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
