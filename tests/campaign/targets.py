r"""Compare the firmware model in Python with the C core in paired closed-loop runs.

    PYTHONPATH=tests nice python -m campaign.targets --keep build/targets.jsonl \
        --page docs/two-firmwares.md

Both runs of a pair clean a shipped room with the same planner, seed and noise; only the firmware
differs. The command prints the mean of each figure with the model. It also prints the mean
difference, core minus model, with its 95 % interval (Student's t over the pairs). With ``--page``
it replaces the part between two marks of a page. With ``--keep FILE`` an interrupted
campaign continues, as long as the code is the same.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from campaign.kept import Kept, stored_results
from sim_device.core.core_sweeper import CoreSweeper
from sim_device.sweeper import VirtualSweeper
from tools.cli.rooms import load_room, shipped_rooms
from tools.experiment.paired_differences import difference
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Iterable

DEVICES = {"python": VirtualSweeper, "core": CoreSweeper}
MAX_TIME_S = 1800.0
"""Simulated time limit of a run, s: several times the time for the largest room."""
BEGIN, END = "<!-- campaign.targets: begin -->", "<!-- campaign.targets: end -->"
"""Marks around the generated part of a page."""


class Figure(NamedTuple):
    """A measured figure of a run."""

    name: str
    """Key in the results."""
    title: str
    scale: float
    digits: int


FIGURES = (
    Figure("mouth_sweepable", "swept, % of the sweepable floor", 100.0, 3),
    Figure("path_m", "path, m", 1.0, 2),
    Figure("duration_s", "time, s", 1.0, 1),
    Figure("collisions", "collisions", 1.0, 2),
)


class Case(NamedTuple):
    """One run."""

    room: str
    seed: int
    noise: str
    target: str

    @property
    def name(self) -> str:
        """The name under which the result is stored."""
        return " ".join(map(str, self))


def cases(rooms: Iterable[str], seeds: Iterable[int], noise: str) -> list[Case]:
    """Return both runs of every pair, one after the other."""
    return [
        Case(room, seed, noise, target) for seed in seeds for room in rooms for target in DEVICES
    ]


def measure(case: Case) -> dict[str, Any]:
    """Run one case."""
    plan, model = load_room(case.room), RobotModel()
    device = DEVICES[case.target](plan, model, seed=case.seed, noise=case.noise)
    run = run_virtual(
        plan,
        model,
        "recovery",
        NullSink(),
        seed=case.seed,
        noise=case.noise,
        max_time_s=MAX_TIME_S,
        device=device,
    )
    mission, report = run.host.mission, run.track.report(None)
    began_s, ended_s = mission.drive_started_s, mission.drive_ended_s
    return {
        "outcome": "none" if mission.ending is None else mission.ending.outcome,
        "mouth_sweepable": report.coverage.mouth_sweepable,
        "path_m": report.path_m,
        "duration_s": None if began_s is None or ended_s is None else ended_s - began_s,
        "collisions": device.truth.collisions,
    }


def table(results: dict[Case, dict[str, Any]]) -> str:
    """Return the means, the differences and the outcomes as Markdown."""
    pairs = {
        case: (results[case], results[case._replace(target="core")])
        for case in results
        if case.target == "python" and case._replace(target="core") in results
    }
    both = list(pairs.values())
    lines = ["| figure | Python, mean | core less Python | 95 % interval |", "|---|---|---|---|"]
    for figure in FIGURES:
        mean = sum(model[figure.name] for model, _ in both) / len(both)
        found = difference(both, figure.name)
        low, middle, high = (
            f"{figure.scale * value:+.{figure.digits}f}".replace("-", "−")
            for value in (found.mean - found.margin, found.mean, found.mean + found.margin)
        )
        lines.append(
            f"| {figure.title} | {figure.scale * mean:.{figure.digits}f} | {middle} "
            f"| {low} to {high} |"
        )
    rooms: dict[str, list[tuple[dict[str, Any], dict[str, Any]]]] = {
        case.room: [] for case in pairs
    }
    for case, pair in pairs.items():
        rooms[case.room].append(pair)
    lines += ["", "| room | pairs | swept, Python | swept, core | difference |"]
    lines.append("|---|---|---|---|---|")
    for room, own in sorted(rooms.items()):
        model, core = (
            100.0 * sum(pair[side]["mouth_sweepable"] for pair in own) / len(own) for side in (0, 1)
        )
        gap = f"{core - model:+.2f}".replace("-", "−")
        lines.append(f"| {room} | {len(own)} | {model:.2f} | {core:.2f} | {gap} |")
    other = [
        f"{case.name}: {result['outcome']}"
        for case, result in results.items()
        if result["outcome"] != "complete"
    ]
    summary = f"All of the {2 * len(both)} runs were complete." if not other else "; ".join(other)
    return "\n".join([*lines, "", summary])


def on_page(page: str, text: str) -> str:
    """Return a page with this text between its marks."""
    head, _, rest = page.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n\n{text}\n\n{END}{tail}"


def main() -> None:
    """Run the missing cases, and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rooms", default=",".join(shipped_rooms()))
    parser.add_argument("--seeds", type=int, default=2, help="pairs in each room")
    parser.add_argument("--noise", default="typical")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="file of the runs")
    parser.add_argument("--page", type=Path, help="page whose marked part is replaced")
    asked = parser.parse_args()
    wanted = cases(asked.rooms.split(","), range(asked.seeds), asked.noise)
    named = {case.name: case for case in wanted}
    stored = stored_results(measure, named, Kept(asked.keep), asked.jobs)
    text = table(dict(zip(wanted, stored, strict=True)))
    print(text)
    if asked.page is not None:
        asked.page.write_text(on_page(asked.page.read_text("utf-8"), text), "utf-8")


if __name__ == "__main__":
    main()
