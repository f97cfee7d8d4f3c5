"""Random faults by the hundred: no crash, no unsafe motion, a readable log.

    PYTHONPATH=tests python -m soak.faults --runs 500

Each run is the complete software in virtual time, recorded. The run's seed determines the room, the
planner (on the host or on the device), the supervision, the link (UART or CAN), and one to three
faults of any kind with any values. The true pose, every 40 ms, shows unsafe motion.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.api.robot_parts import planner_number
from bridge.motion.robot_model import RobotModel
from bridge.record.log_writer import RunWriter
from bridge.record.reader import LogReader
from bridge.session.records import RunInfo
from bridge.supervise import SuperviseSettings
from protocol.can.link import CanLink
from protocol.uart.link import Link
from sim_device.faults.kinds import KINDS, parse_fault
from sim_device.faults.spec import FaultSpec, Number
from sim_device.line.line import DEFAULT_BITRATE, LineSettings
from sim_device.rig import WITHOUT_BUS
from soak.watched import Truth
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual
from tools.virtual.summary import summarise

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from sim_device.faults.spec import FaultKind, Value

ROOMS = ("case-1", "case-2", "columns", "l-room", "table-and-chair", "two-rooms")
PLANNERS = ("paper", "recovery", "u-shape", "random")
_LOG_UNIFORM = {"rate", "ppm"}
"""Arguments whose interesting values are orders of magnitude apart."""
_LINKS = ("uart", "uart", "timed-uart", "can")
"""Links of the runs, as likely as they are listed. A plain UART delays each byte by 1 ms."""


@dataclass
class Result:
    """Result of a run."""

    seed: int
    faults: tuple[str, ...] = ()
    outcome: str = ""
    simulated_s: float = 0.0
    messages: int = 0
    bad: list[str] = field(default_factory=list)
    """Failures: crashes, unsafe motion, an unreadable log."""


def draw_fault(kind: FaultKind, rng: random.Random, plan: FloorPlan) -> FaultSpec:
    """Return a fault of a kind with random time and values."""
    values: dict[str, Value] = {}
    for argument in kind.arguments:
        if not isinstance(argument, Number):
            values[argument.name] = rng.choice(argument.choices)
        elif argument.name == "index":
            values[argument.name] = float(rng.randrange(max(len(plan.obstacles), 1)))
        elif argument.name in _LOG_UNIFORM:
            top = min(argument.high, 100.0 * argument.default)
            values[argument.name] = argument.default * (top / argument.default) ** rng.random()
        else:
            span = 4.0 * abs(argument.default) or 0.3 * (argument.high - argument.low)
            low = max(argument.low, argument.default - span)
            values[argument.name] = rng.uniform(low, min(argument.high, argument.default + span))
    lasts_s = rng.choice((0.2, 1.0, 5.0, 20.0, None)) if kind.lasting else None
    spec = FaultSpec(kind, round(rng.uniform(0.0, 40.0), 2), lasts_s, values)
    return parse_fault(spec.text)


def run(seed: int, *, max_s: float = 60.0) -> Result:
    """Run once; never raise an exception."""
    result = Result(seed)
    try:
        _run(result, max_s)
    except Exception:  # noqa: BLE001 - every crash is a finding
        result.bad.append(f"crash: {traceback.format_exc(limit=-3)}")
    return result


def _run(result: Result, max_s: float) -> None:
    rng = random.Random(result.seed)
    plan = load_room(rng.choice(ROOMS))
    planner = rng.choice(PLANNERS)
    kinds = [k for k in KINDS.values() if k.name != "obstacle" or plan.obstacles]
    # The first kind cycles through all kinds, so that five hundred runs have each often enough.
    chosen = [kinds[result.seed % len(kinds)], *rng.sample(kinds, rng.randrange(3))]
    faults = [draw_fault(kind, rng, plan) for kind in chosen]
    result.faults = tuple(spec.text for spec in faults)
    bus_only = any(spec.kind.name in WITHOUT_BUS for spec in faults)
    link = "can" if bus_only else rng.choice(_LINKS)
    onboard = rng.random() < 0.4
    model = RobotModel()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        info = RunInfo(
            "virtual",
            planner,
            result.seed,
            "soak",
            EPOCH_NS,
            EPOCH_NS - HOST_BOOT_NS,
            model,
            "",
            plan,
        )
        writer = RunWriter(path, info)
        truth = Truth(writer)
        finished = run_virtual(
            plan,
            model,
            planner,
            truth,
            seed=result.seed,
            max_time_s=max_s,
            faults=faults,
            line=_line(link),
            link=CanLink if link == "can" else Link,
            onboard=planner_number(planner) if onboard else None,
            supervise=SuperviseSettings() if onboard or rng.random() < 0.5 else None,
            prepare=truth.attach,
        )
        summary = summarise(finished, plan, planner, result.seed, str(path))
        truth.close(summary)
        ending = finished.host.mission.ending
        result.outcome = "none" if ending is None else ending.outcome
        result.bad += [f"unsafe: {text}" for text in truth.unsafe]
        if truth.samples == 0:
            result.bad.append("no truth was seen")
        result.simulated_s = truth.simulated_s
        _read(path, "/raw/can" if link == "can" else "/raw/uart/tx", result)


def _line(link: str) -> LineSettings | None:
    if link == "uart":
        return None
    return LineSettings(bitrate=DEFAULT_BITRATE) if link == "can" else LineSettings()


def _read(path: Path, raw: str, result: Result) -> None:
    """Read the whole log again."""
    reader = LogReader(path)
    topics = Counter(message.topic for message in reader.messages())
    result.messages = sum(topics.values())
    if reader.truncated or reader.problems:
        result.bad.append(f"log: truncated {reader.truncated}, {reader.problems[:2]}")
    if reader.summary is None or not topics["/truth/pose"] or not topics[raw]:
        result.bad.append(f"log: incomplete, topics {sorted(topics)}")


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--first", type=int, default=1, help="seed of the first run")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.runs)
    outcomes: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    bad = 0
    simulated_s, messages = 0.0, 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(run, seeds, chunksize=4):
            outcomes[result.outcome] += 1
            kinds.update(text.partition("@")[0] for text in result.faults)
            simulated_s += result.simulated_s
            messages += result.messages
            for what in result.bad:
                bad += 1
                print(f"seed {result.seed}, {' '.join(result.faults)}: {what}", flush=True)
    print(f"{options.runs} runs, {simulated_s / 3600.0:.2f} simulated hours, {bad} findings")
    print(f"outcomes: {dict(outcomes)}")
    print(
        f"faults: {sum(kinds.values())} of {len(kinds)} kinds, each at least {min(kinds.values())}"
    )
    print(f"messages read back from the logs: {messages}")
    return 1 if bad or len(kinds) < len(KINDS) else 0


if __name__ == "__main__":
    sys.exit(main())
