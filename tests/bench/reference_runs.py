"""Fingerprints of whole runs in virtual time; a refactoring must not change them.

    PYTHONPATH=tests python -m bench.reference_runs record before.json
    PYTHONPATH=tests python -m bench.reference_runs compare before.json

``record`` runs every case of the table below and writes a fingerprint of each. ``compare`` runs
the cases again. It names each run that differs, and the first simulated half minute that differs.
It exits with 1 if any run differs.

A fingerprint covers the behaviour of a run, not its names: the velocity setpoints, the estimated
and the true poses, and the times of the planner's decisions, each to the last bit. It keeps the
number of events of each severity, the outcome and the swept share as plain figures, so that a
difference can be read. Names of events, topics and versions are not part of it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import struct
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridge.motion.robot_model import RobotModel
from bridge.session.records import CommandRecord, EventRecord, PoseRecord, TruthRecord
from protocol.can.link import CanLink
from protocol.uart.link import Link
from sim_device.faults.kinds import parse_fault
from tools.cli.rooms import load_room, shipped_rooms
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from bridge.session.records import Record

WINDOW_NS = 30_000_000_000
"""Simulated time between two checkpoints of a fingerprint, ns: short enough to find a difference,
long enough to keep the file small."""
MAX_TIME_S = 400.0
"""Simulated time limit of each run, s: every planner has swept, turned and recovered by then."""
FAULTS = (
    "bit-flips@10:20:rate=0.001",
    "latency@40:5:ms=60",
    "unplug@30:4",
    "wheel-slip@20:6:share=0.5",
    "obstacle@25:index=0,dx=0.3,dy=-0.2",
    "brown-out@35:off=0.5",
)
"""One fault of each kind of cause: damage, delay, loss, motion, the room, the device."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the table."""

    room: str
    planner: str = "recovery"
    noise: str = "typical"
    seed: int = 1
    fault: str | None = None
    can: bool = False

    @property
    def name(self) -> str:
        """The run in words, which is its key in the file."""
        parts = [self.room, self.planner, self.noise, f"seed {self.seed}"]
        return ", ".join([*parts, *([self.fault] if self.fault else []), *(["CAN"] * self.can)])


def cases() -> list[Case]:
    """Return the table: every room and planner, noises, seeds, faults, UART and CAN."""
    rooms = shipped_rooms()
    table = [Case(room) for room in rooms]
    table += [Case(room, planner=p) for room in rooms[:3] for p in ("paper", "u-shape", "random")]
    table += [Case(room, noise=n) for room in rooms[3:6] for n in ("none", "paper", "harsh")]
    table += [Case("case-2", seed=seed, noise="harsh") for seed in range(2, 6)]
    table += [Case("two-rooms", fault=fault) for fault in FAULTS]
    table += [Case("case-1", planner="paper", fault=fault) for fault in FAULTS]
    table += [Case(room, can=True) for room in ("case-1", "l-room", "table-and-chair")]
    return table


@dataclass(slots=True)
class Fingerprint:
    """A sink that hashes the records of one run."""

    digests: dict[str, Any] = field(
        default_factory=lambda: {
            name: hashlib.sha256() for name in ("setpoints", "poses", "truth", "decisions")
        }
    )
    checkpoints: list[str] = field(default_factory=list)
    severities: Counter[str] = field(default_factory=Counter)

    def write(self, record: Record) -> None:
        """Add one record to the fingerprint."""
        while record.log_ns - EPOCH_NS > WINDOW_NS * (len(self.checkpoints) + 1):
            self.checkpoints.append(self._all())
        if isinstance(record, CommandRecord):
            self._add("setpoints", *record)
        elif isinstance(record, PoseRecord):
            self._add("poses", record.log_ns, *record.pose, *record.covariance)
        elif isinstance(record, TruthRecord):
            self._add("truth", record.log_ns, *record.pose)
        elif isinstance(record, EventRecord):
            self.severities[record.severity.value] += 1
            if record.source == "planner":
                self._add("decisions", record.log_ns)

    def close(self, summary: object = None) -> None:
        """Do nothing: the fingerprint is read from the object."""

    def result(self) -> dict[str, Any]:
        """Return everything as JSON values."""
        return {
            **{name: digest.hexdigest()[:16] for name, digest in self.digests.items()},
            "events": dict(sorted(self.severities.items())),
            "checkpoints": self.checkpoints,
        }

    def _add(self, name: str, log_ns: int, *values: float) -> None:
        self.digests[name].update(struct.pack(f"<q{len(values)}d", log_ns, *values))

    def _all(self) -> str:
        whole = hashlib.sha256()
        for digest in self.digests.values():
            whole.update(digest.digest())
        return whole.hexdigest()[:8]


def fingerprint(case: Case) -> tuple[str, dict[str, Any]]:
    """Run one case; return its name and its fingerprint."""
    sink = Fingerprint()
    run = run_virtual(
        load_room(case.room),
        RobotModel(),
        case.planner,
        sink,
        seed=case.seed,
        noise=case.noise,
        max_time_s=MAX_TIME_S,
        faults=[parse_fault(case.fault)] if case.fault else [],
        link=CanLink if case.can else Link,
    )
    ending = run.host.mission.ending
    figures = {
        "outcome": None if ending is None else ending.outcome,
        "path_m": run.host.path_m,
        "collisions": run.device.truth.collisions,
    }
    return case.name, {**figures, **sink.result()}


def record(processes: int) -> dict[str, dict[str, Any]]:
    """Run the whole table; progress goes to stderr."""
    table, done = cases(), {}
    with multiprocessing.Pool(processes) as pool:
        for name, found in pool.imap(fingerprint, table):
            done[name] = found
            sys.stderr.write(f"{len(done)} of {len(table)}: {name}\n")
    return done


def difference(before: dict[str, Any], now: dict[str, Any]) -> str | None:
    """Return the difference between two fingerprints of one run in words, or None."""
    keys = [key for key in before if key != "checkpoints" and before[key] != now.get(key)]
    if not keys:
        return None
    pairs = zip(before["checkpoints"], now["checkpoints"], strict=False)
    same = next((i for i, (a, b) in enumerate(pairs) if a != b), len(before["checkpoints"]))
    plain = [k for k in keys if not isinstance(before[k], str) or k == "outcome"]
    figures = "; ".join(f"{key} {before[key]} -> {now.get(key)}" for key in plain)
    begin_s = same * WINDOW_NS // 1_000_000_000
    return f"{', '.join(keys)} differ from {begin_s} s on{': ' if figures else ''}{figures}"


def main() -> None:
    """Record the table, or compare with a recorded one."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("what", choices=("record", "compare"))
    options.add_argument("file", type=Path)
    options.add_argument("--processes", type=int, default=2)
    asked = options.parse_args()
    now = record(asked.processes)
    if asked.what == "record":
        asked.file.write_text(json.dumps(now, indent=1) + "\n")
        print(f"recorded {len(now)} runs")
        return
    before = json.loads(asked.file.read_text())
    differ = {name: difference(before[name], now[name]) for name in before if name in now}
    for name, text in differ.items():
        if text is not None:
            print(f"{name}: {text}")
    missing = sorted(set(before) ^ set(now))
    print(f"{sum(text is None for text in differ.values())} of {len(before)} runs are the same")
    if missing:
        print(f"in one table only: {'; '.join(missing)}")
    sys.exit(bool(missing or any(differ.values())))


if __name__ == "__main__":
    main()
