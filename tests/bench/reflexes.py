"""Coverage with the device's reflexes on and off: the same rooms, seeds and noise.

    PYTHONPATH=tests nice python -m bench.reflexes --out build/reflexes.jsonl
    PYTHONPATH=tests python -m bench.reflexes --table build/reflexes.jsonl

The device's parameters ``cliff_reflex`` and ``bumper_reflex`` switch the reflexes; nothing else
differs. The first form runs all pairs and writes one line of JSON for each run. It continues the
file of an earlier call. Both forms print the table of the pairs: the share of the sweepable floor
that the mouth swept, by the plant's truth, and the mean difference with its 95 % interval.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from protocol.messages.values import ParameterKind
from sim_device.body.footing import wheel_over
from tools.cli.rooms import load_room
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.run.host import Host
    from tools.virtual.run import VirtualRun

ROOMS = ("case-1", "case-2", "columns", "l-room", "table-and-chair", "two-rooms")
PITS = {
    "pit in the middle": [[1.0, 0.9], [1.4, 0.9], [1.4, 1.3], [1.0, 1.3]],
    "pit at a wall": [[1.2, 0.0], [1.7, 0.0], [1.7, 0.35], [1.2, 0.35]],
    "stairs down": [[2.0, 0.0], [2.4, 0.0], [2.4, 2.2], [2.0, 2.2]],
}
"""Areas without floor in a room of 2.4 m by 2.2 m."""
PIT_WALLS = [[0.0, 0.0], [2.4, 0.0], [2.4, 2.2], [0.0, 2.2]]
SEEDS = (1, 2, 3)
NOISES = ("typical", "harsh")
MAX_TIME_S = 900.0
"""Simulated time limit of each run, s: three times the time for the largest of these rooms."""
_COLUMNS = (
    *("room", "noise", "seed", "swept, off", "swept, on", "difference", "time, off", "time, on"),
    *("outcome, off", "outcome, on"),
)
DRAWS = 10_000
"""Number of resamples of the pairs for the interval of their mean."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run."""

    room: str
    seed: int
    noise: str
    reflexes: bool


def cases() -> list[Case]:
    """Return both runs of every pair, one after the other."""
    return [
        Case(room, seed, noise, reflexes)
        for seed in SEEDS
        for noise in NOISES
        for room in (*ROOMS, *PITS)
        for reflexes in (True, False)
    ]


def floor_plan(room: str) -> FloorPlan:
    """Return a shipped room, or one with a pit."""
    if room not in PITS:
        return load_room(room)
    content = {"name": room, "walls": PIT_WALLS, "obstacles": [], "start": [0.3, 0.3, 0.2]}
    return parse_floorplan(json.dumps({**content, "cliffs": [PITS[room]]}))


def measure(case: Case) -> dict[str, Any]:
    """Run one case."""
    plan, model = floor_plan(case.room), RobotModel()
    runs: list[VirtualRun] = []
    fell: list[float] = []

    def prepare(run: VirtualRun) -> None:
        runs.append(run)
        firmware = run.device.firmware
        for number, parameter in enumerate(firmware.parameters.parameters):
            if parameter.name in {"cliff_reflex", "bumper_reflex"}:
                firmware.parameters.set(number, ParameterKind.U32, int(case.reflexes))
        firmware.control.apply_parameters()

    def look(t_s: float, host: Host) -> None:
        del host
        if wheel_over(runs[0].device.plant.pose, 0.5 * model.wheel_base_m, plan.cliffs):
            fell.append(t_s)

    run = run_virtual(
        plan,
        model,
        "recovery",
        NullSink(),
        seed=case.seed,
        noise=case.noise,
        max_time_s=MAX_TIME_S,
        progress=look,
        prepare=prepare,
    )
    ending, report = run.host.mission.ending, run.track.report(None)
    return {
        **asdict(case),
        "outcome": "time limit" if ending is None else ending.outcome,
        "cause": int(run.device.firmware.latch.cause),
        "swept": report.coverage.mouth_sweepable,
        "duration_s": run.device.plant.tick_ms / 1000.0,
        "collisions": run.device.truth.collisions,
        "fell": bool(fell),
    }


def table(results: list[dict[str, Any]]) -> str:
    """Return a table of the pairs, and their mean."""
    by_case = {Case(r["room"], r["seed"], r["noise"], r["reflexes"]): r for r in results}
    lines = [
        f"| {' | '.join(_COLUMNS)} |",
        f"|{'---|' * len(_COLUMNS)}",
    ]
    found: dict[str, list[tuple[float, float]]] = {}
    for case, on in by_case.items():
        off = by_case.get(Case(case.room, case.seed, case.noise, reflexes=False))
        if not case.reflexes or off is None:
            continue
        difference = on["swept"] - off["swept"]
        ratio = on["duration_s"] / off["duration_s"]
        for group in ("all", case.noise, "pits" if case.room in PITS else "no pits"):
            found.setdefault(group, []).append((difference, ratio))
        lines.append(
            f"| {case.room} | {case.noise} | {case.seed} | {100 * off['swept']:.2f} % | "
            f"{100 * on['swept']:.2f} % | {100 * difference:+.2f} % | {off['duration_s']:.0f} s | "
            f"{on['duration_s']:.0f} s | {_how(off)} | {_how(on)} |"
        )
    lines += ["", "| pairs | number | mean difference | 95 % interval | time, on over off |"]
    lines.append("|---|---|---|---|---|")
    for group, pairs in found.items():
        differences = np.array([d for d, _ in pairs])
        low, high = interval(differences)
        ratio = math.exp(np.log([r for _, r in pairs]).mean())
        lines.append(
            f"| {group} | {len(pairs)} | {100 * differences.mean():+.3f} % | "
            f"{100 * low:+.3f} to {100 * high:+.3f} % | {ratio:.3f} |"
        )
    return "\n".join(lines)


def _how(result: dict[str, Any]) -> str:
    return f"{result['outcome']}{', fell' if result['fell'] else ''}"


def interval(differences: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of the mean, by resampling the pairs."""
    rng = np.random.default_rng(0)
    drawn = rng.choice(differences, (DRAWS, len(differences))).mean(axis=1)
    low, high = np.percentile(drawn, (2.5, 97.5))
    return float(low), float(high)


def main() -> None:
    """Run the missing cases, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="file of the runs; an earlier one is continued")
    parser.add_argument("--table", type=Path, help="only print the table of this file")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options = parser.parse_args()
    path: Path | None = options.table or options.out
    if path is None:
        parser.error("--out FILE or --table FILE is needed")
    results = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    if options.out is not None:
        done = {Case(r["room"], r["seed"], r["noise"], r["reflexes"]) for r in results}
        waiting = [case for case in cases() if case not in done]
        with multiprocessing.Pool(options.jobs) as pool, path.open("a") as out:
            for result in pool.imap(measure, waiting):
                results.append(result)
                out.write(json.dumps(result) + "\n")
                out.flush()
                sys.stderr.write(f"{len(results)} of {len(cases())}\n")
    print(table(results))


if __name__ == "__main__":
    main()
