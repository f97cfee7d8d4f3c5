r"""Compare supervision with the truth: runs with each hazard, and hours of runs without one.

    PYTHONPATH=tests python -m campaign.supervise --out docs/supervise-campaign.md

Every run is the whole stack in virtual time. The rules are wired as in a user's run, but every
reaction is lowered to *report*, so that a run continues after its first alarm. A hazard counts as
caught if a rule that is meant for it raises an alarm while the hazard lasts, or within the grace
time after its end. A run that the device or the session ends because of the hazard is counted
separately. In a run without a hazard, every alarm is false unless the truth confirms it. With
``--keep FILE`` an interrupted campaign continues, as long as rules and hazards are the same.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridge.api.robot_parts import planner_number
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.supervise import Level, SuperviseSettings, settings_from
from campaign.hazards import GRACE_S, HAZARDS, HOST, IN_LANES, ONBOARD, ROOMS, SHORT, STAIRS, Hazard
from campaign.kept import Kept, stored_results
from campaign.outcome import Alarm, Alarms, Job, Outcome
from campaign.supervise_page import page
from protocol.messages.values import StopCause
from sim_device.faults.kinds import parse_fault
from support.liar import let_lie
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def report_only_rules(more: dict[str, object] | None = None) -> SuperviseSettings:
    """Return the default rules with every reaction lowered to reporting."""
    rules = SuperviseSettings()
    table: dict[str, object] = {n: {"reaction": "report", "then": "report"} for n in rules.rules}
    for name, values in (more or {}).items():
        table[name] = {**table[name], **values}  # type: ignore[dict-item]  # tables of one rule each
    settings = settings_from(table)
    assert all(rule.reaction is Level.REPORT for rule in settings.rules.values())
    return settings


def stairs() -> FloorPlan:
    """Return a room with a stairwell on the robot's path."""
    walls = ((0.0, 0.0), (2.6, 0.0), (2.6, 2.0), (0.0, 2.0))
    well = ((1.7, 0.0), (2.2, 0.0), (2.2, 2.0), (1.7, 2.0))
    return FloorPlan(STAIRS, walls, (), Pose2(0.3, 0.3, 0.0), cliffs=(well,))


def run(job: Job) -> Outcome:
    """Run one job."""
    hazard = job.hazard
    plan = stairs() if job.room == STAIRS else load_room(job.room)
    model = RobotModel()
    outcome = Outcome(job)
    faults, max_s = [], job.max_s
    if hazard is not None:
        rng = random.Random(f"{job.seed} {hazard.name} at")
        outcome.at_s = at_s = 0.0 if hazard.there else round(rng.uniform(12.0, 30.0), 1)
        faults = [parse_fault(_timed(text, at_s)) for text in hazard.faults]
        max_s = at_s + hazard.lasts_s + 2.0 * GRACE_S
    sink = Alarms()
    finished = run_virtual(
        plan,
        model,
        job.planner,
        sink,
        seed=job.seed,
        max_time_s=max_s,
        faults=faults,
        onboard=planner_number(job.planner) if job.onboard else None,
        supervise=report_only_rules(hazard.settings if hazard else None),
        prepare=lambda made: (
            let_lie(made.device, hazard.lie, outcome.at_s) if hazard and hazard.lie else None
        ),
    )
    ended = finished.host.mission
    outcome.alarms = sink.found
    if ended.drive_started_s is not None and ended.drive_ended_s is not None:
        outcome.supervised_s = ended.drive_ended_s - ended.drive_started_s
        outcome.ended_s = ended.drive_ended_s - HOST_BOOT_NS * 1e-9
    if ended.ending is not None:
        outcome.ending = ended.ending.reason
        outcome.by_check = ended.ending.cause == StopCause.SUPERVISE
    status = finished.host.state.status
    outcome.by_device = status is not None and status.stop_cause == StopCause.HARDWARE
    return outcome


def _timed(text: str, at_s: float) -> str:
    head, _, rest = text.partition("{t}")
    if rest.startswith("+"):
        plus, _, rest = rest[1:].partition(":")
        return f"{head}{at_s + float(plus):.2f}:{rest}"
    return f"{head}{at_s}{rest}"


def hazard_jobs(seeds: Iterable[int], hazards: Iterable[Hazard] = HAZARDS) -> list[Job]:
    """Return every hazard with every seed, in a room and with a planner that the seed chooses."""
    jobs = []
    for seed in seeds:
        for hazard in hazards:
            rng = random.Random(f"{seed} {hazard.name}")
            planner = rng.choice(hazard.planners)
            rooms = [r for r in hazard.rooms if planner not in IN_LANES or r not in SHORT]
            room = rng.choice(rooms)
            jobs.append(Job(room, planner, seed, hazard.onboard, hazard))
    return jobs


def clean_jobs(seeds: Iterable[int], max_s: float) -> list[Job]:
    """Return every room with every planner, on the device and on the host, without any hazard."""
    return [
        Job(room, planner, seed, onboard, None, max_s)
        for seed in seeds
        for room in ROOMS
        for onboard, planners in ((True, ONBOARD), (False, HOST))
        for planner in planners
    ]


def to_stored(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome without its job, as it is stored."""
    values = asdict(outcome)
    del values["job"]
    return values


def from_stored(job: Job, values: dict[str, Any]) -> Outcome:
    """Return the stored outcome of a job."""
    return Outcome(job, **{**values, "alarms": [Alarm(**alarm) for alarm in values["alarms"]]})


def _stored(job: Job) -> dict[str, Any]:
    return to_stored(run(job))


def outcomes_of(jobs: list[Job], kept: Kept, processes: int) -> Iterator[Outcome]:
    """Yield every job's outcome in order."""
    stored = stored_results(_stored, {job.name: job for job in jobs}, kept, processes)
    for job, values in zip(jobs, stored, strict=True):
        yield from_stored(job, values)


def main() -> int:
    """Run the campaign and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each hazard")
    parser.add_argument("--clean-seeds", type=int, default=2, help="seeds of each room and planner")
    parser.add_argument("--first-seed", type=int, default=201, help="first seed of both")
    parser.add_argument(
        "--clean-s", type=float, default=300.0, help="limit of a run without a hazard, s"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--keep", type=Path, help="outcomes file; its outcomes are not run again")
    parser.add_argument("--out", type=Path, help="write the page")
    options = parser.parse_args()
    first = options.first_seed
    jobs = hazard_jobs(range(first, first + options.seeds))
    jobs += clean_jobs(range(first, first + options.clean_seeds), options.clean_s)
    outcomes = list(outcomes_of(jobs, Kept(options.keep), options.jobs))
    text, good = page(outcomes)
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
