"""Supervision held against the truth: every hazard injected, and hours of runs without any.

    PYTHONPATH=tests python -m campaign.supervise --out docs/supervise-campaign.md

Every run is the whole stack in virtual time, the rules wired as in a user's run, but all
reactions lowered to *tell*, so that a run goes on after its first alarm. A hazard counts as
caught where a rule that it is meant for speaks while it lasts or within its time of grace, or
where the device stopped by itself because of it, which is told apart. In a run without hazard
every alarm is a false one.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridge.coverage.floorplan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.onboard_mission import OnboardMission
from bridge.robot_parts import planner_number
from bridge.supervise import Level, SuperviseSettings, settings_from
from bridge.telemetry import EventRecord
from campaign.hazards import GRACE_S, HAZARDS, HOST, ONBOARD, ROOMS, STAIRS, Hazard
from protocol.values import StopCause
from sim_device.faults.kinds import parse_fault
from support.liar import let_lie
from tools.rooms import load_room
from tools.virtual_run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from bridge.telemetry import Record


@dataclass(frozen=True)
class Job:
    """One run."""

    room: str
    planner: str
    seed: int
    onboard: bool = True
    hazard: Hazard | None = None
    max_s: float = 600.0


@dataclass
class Outcome:
    """What came of it."""

    job: Job
    watched_s: float = 0.0
    at_s: float = 0.0
    """When the hazard began."""
    alarms: list[tuple[float, str, str]] = field(default_factory=list)
    """Time (s since boot), rule and text."""
    ending: str = ""
    by_device: bool = False

    @property
    def caught_s(self) -> float | None:
        """How long after its beginning the hazard was found; None: it was not."""
        hazard = self.job.hazard
        assert hazard is not None
        end_s = self.at_s + hazard.lasts_s + GRACE_S
        times = [
            t - self.at_s
            for t, rule, _ in self.alarms
            if rule in hazard.rules and self.at_s <= t <= end_s
        ]
        return min(times, default=None)


class _Alarms:
    """A sink that keeps what the rules said."""

    def __init__(self) -> None:
        self.found: list[tuple[float, str, str]] = []

    def write(self, record: Record) -> None:
        if isinstance(record, EventRecord) and record.source == "supervise":
            self.found.append(((record.log_ns - EPOCH_NS) * 1e-9, record.kind, record.text))

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Nothing is open."""


def telling(more: dict[str, object] | None = None) -> SuperviseSettings:
    """The default rules, every reaction lowered to telling."""
    rules = SuperviseSettings()
    table: dict[str, object] = {n: {"reaction": "tell", "then": "tell"} for n in rules.rules}
    for name, values in (more or {}).items():
        table[name] = {**table[name], **values}  # type: ignore[dict-item]  # tables of one rule each
    settings = settings_from(table)
    assert all(rule.reaction is Level.TELL for rule in settings.rules.values())
    return settings


def stairs() -> FloorPlan:
    """A room with a stairwell along the way."""
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
        dice = random.Random(f"{job.seed} {hazard.name} at")
        early = hazard.settings or job.room == STAIRS
        outcome.at_s = at_s = 6.0 if early else round(dice.uniform(12.0, 30.0), 1)
        faults = [parse_fault(_timed(text, at_s)) for text in hazard.faults]
        max_s = at_s + hazard.lasts_s + 2.0 * GRACE_S
    mission = OnboardMission(planner_number(job.planner), max_time_s=max_s) if job.onboard else None
    sink = _Alarms()
    finished = run_virtual(
        plan,
        model,
        job.planner,
        sink,
        seed=job.seed,
        max_time_s=max_s,
        faults=faults,
        mission=mission,
        supervise=telling(hazard.settings if hazard else None),
        prepare=lambda made: (
            let_lie(made.device, hazard.lie, outcome.at_s) if hazard and hazard.lie else None
        ),
    )
    ended = finished.host.mission
    outcome.alarms = sink.found
    if ended.drive_started_s is not None and ended.drive_ended_s is not None:
        outcome.watched_s = ended.drive_ended_s - ended.drive_started_s
    outcome.ending = "" if ended.ending is None else ended.ending.reason
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
    """Every hazard with every seed, in a room and with a planner that the seed chooses."""
    jobs = []
    for seed in seeds:
        for hazard in hazards:
            dice = random.Random(f"{seed} {hazard.name}")
            room, planner = dice.choice(hazard.rooms), dice.choice(hazard.planners)
            jobs.append(Job(room, planner, seed, hazard.onboard, hazard))
    return jobs


def clean_jobs(seeds: Iterable[int], max_s: float) -> list[Job]:
    """Every room with every planner, on the device and on the host, without any hazard."""
    return [
        Job(room, planner, seed, onboard, None, max_s)
        for seed in seeds
        for room in ROOMS
        for onboard, planners in ((True, ONBOARD), (False, HOST))
        for planner in planners
    ]


def report(outcomes: list[Outcome]) -> tuple[str, bool]:
    """The tables, and whether what is demanded holds."""
    clean = [o for o in outcomes if o.job.hazard is None]
    hours = sum(o.watched_s for o in clean) / 3600.0
    alarms = Counter(rule for o in clean for _, rule, _ in o.alarms)
    total = sum(alarms.values())
    per_hour = total / hours if hours else 0.0
    lines = [
        "# Supervision held against the truth",
        "",
        "<!-- Written by `python -m campaign.supervise` in tests/. -->",
        "",
        "Every run is the whole stack in virtual time at noise `typical`: the device's planner, or",
        "the host's, in the rooms that ship; the rules at their defaults, every reaction lowered",
        "to *tell* so that a run goes on after an alarm.",
        "",
        "## False alarms",
        "",
        f"{len(clean)} runs without any hazard, {hours:.1f} simulated hours of driving:",
        f"**{total} alarms, {per_hour:.2f} per hour** (at most 1 is allowed).",
        "",
    ]
    if alarms:
        lines += ["| rule | alarms | per hour |", "|---|---|---|"]
        lines += [
            f"| {rule} | {count} | {count / hours:.2f} |" for rule, count in alarms.most_common()
        ]
        lines.append("")
    lines += [
        "## Hazards",
        "",
        "*By the device*: it stopped by itself, cause `hardware`, before a rule of the host spoke.",
        "Time is from the hazard's beginning to the first alarm of a rule that is meant for it;",
        "where a hazard can only show later (a lane must end, a wall must be ahead), it is long.",
        "",
        "| hazard | meant for | runs | caught | by the device | missed | time, median | longest |",
        "|---|---|---|---|---|---|---|---|",
    ]
    missed_in_all = 0
    by_name: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.job.hazard is not None:
            by_name.setdefault(outcome.job.hazard.name, []).append(outcome)
    for name, runs in by_name.items():
        times = sorted(t for o in runs if (t := o.caught_s) is not None)
        device = sum(o.caught_s is None and o.by_device for o in runs)
        missed = len(runs) - len(times) - device
        missed_in_all += missed
        rules = ", ".join(sorted(runs[0].job.hazard.rules)) if runs[0].job.hazard else ""
        middle = f"{times[len(times) // 2]:.1f} s" if times else ""
        longest = f"{times[-1]:.1f} s" if times else ""
        cells = (name, rules, len(runs), len(times), device, missed, middle, longest)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    ran = sum(map(len, by_name.values()))
    lines += ["", f"{ran} hazards, {missed_in_all} missed.", ""]
    return "\n".join(lines), missed_in_all == 0 and per_hour <= 1.0


def main() -> int:
    """Run the campaign and write its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=8, help="of each hazard")
    parser.add_argument("--clean-seeds", type=int, default=3, help="of each room and planner")
    parser.add_argument("--clean-s", type=float, default=600.0, help="longest clean run")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    jobs = hazard_jobs(range(1, options.seeds + 1))
    jobs += clean_jobs(range(101, 101 + options.clean_seeds), options.clean_s)
    with ProcessPoolExecutor(options.jobs) as pool:
        outcomes = list(pool.map(run, jobs))
    for outcome in outcomes:
        _tell(outcome)
    text, good = report(outcomes)
    if options.out is not None:
        options.out.write_text(text)
    print(text)
    return 0 if good else 1


def _tell(outcome: Outcome) -> None:
    """What is not as it should be, for whoever looks into it."""
    job = outcome.job
    where = f"{job.room} {job.planner} seed {job.seed} {'device' if job.onboard else 'host'}"
    if job.hazard is None:
        for at_s, rule, text in outcome.alarms:
            print(f"false alarm in {where} at {at_s:.1f} s: {rule}: {text}", file=sys.stderr)
    elif outcome.caught_s is None and not outcome.by_device:
        print(
            f"missed {job.hazard.name} at {outcome.at_s} s in {where}; ended: {outcome.ending}; "
            f"alarms {[(round(t, 1), r) for t, r, _ in outcome.alarms]}",
            file=sys.stderr,
        )


if __name__ == "__main__":
    sys.exit(main())
