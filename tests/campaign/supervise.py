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
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.api.robot_parts import planner_number
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.supervise import Level, SuperviseSettings, settings_from
from campaign.hazards import GRACE_S, HAZARDS, HOST, IN_LANES, ONBOARD, ROOMS, SHORT, STAIRS, Hazard
from campaign.kept import Kept
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


def kept_at(path: Path | None) -> Kept:
    """Return the stored outcomes of the present rules and hazards."""
    return Kept(path)


def recalled(job: Job, kept: Kept) -> Outcome | None:
    """Return the stored outcome of a job, or None."""
    reported = kept.of(job.name)
    if reported is None:
        return None
    return Outcome(job, **{**reported, "alarms": [Alarm(**alarm) for alarm in reported["alarms"]]})


def keep(outcome: Outcome, kept: Kept) -> None:
    """Store the outcome of a job."""
    reported = asdict(outcome)
    del reported["job"]
    kept.add(outcome.job.name, reported)


def outcomes_of(jobs: list[Job], kept: Kept, processes: int) -> Iterator[Outcome]:
    """Yield every job's outcome in order; jobs with a stored outcome are not run again."""
    waiting = [job for job in jobs if kept.of(job.name) is None]
    with ProcessPoolExecutor(processes, initializer=os.nice, initargs=(10,)) as pool:
        found = pool.map(run, waiting)
        for number, job in enumerate(jobs, 1):
            outcome = recalled(job, kept)
            if outcome is None:
                outcome = next(found)
                keep(outcome, kept)
                print(f"{number} of {len(jobs)}: {reported(outcome)}", file=sys.stderr, flush=True)
            yield outcome


def reported(outcome: Outcome) -> str:
    """Return an outcome in one line."""
    job = outcome.job
    alarms = "; ".join(
        f"{a.at_s:.1f} s {a.rule}{' (true)' if a.true else ''}: {a.text}"
        for a in outcome.alarms[:4]
    )
    if job.hazard is None:
        return f"{job.name}, {outcome.supervised_s:.0f} s: {alarms or 'no alarm'}"
    caught_s = outcome.caught_s
    how = f"caught after {caught_s:.1f} s" if caught_s is not None else "MISSED"
    if caught_s is None and outcome.ended_it:
        how = "it has ended the run"
    return f"{job.name}, at {outcome.at_s} s: {how}; {outcome.ending}; {alarms}"


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
    outcomes = list(outcomes_of(jobs, kept_at(options.keep), options.jobs))
    text, good = page(outcomes)
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
