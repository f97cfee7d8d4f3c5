"""Tables of the results: planners, rooms, curves, energy and the worst runs."""

from __future__ import annotations

import math
import shlex
from collections import defaultdict
from dataclasses import dataclass
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from tools.experiment.curves import MULTIPLES
from tools.experiment.trials import PERFECT, RANDOM, is_made, robot_label

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from tools.experiment.store import Row

_FINE_INRADIUS_M = 0.04
"""Radius of the largest hole below which a run counts as complete, m."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text with a title and a note."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""


def group(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Group rows by the values of some columns, in the order of the rows."""
    groups: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[tuple(row[key] for key in keys)].append(row)
    return dict(groups)


def planner_table(rows: Sequence[Row]) -> Table:
    """Return the figures of each planner at each noise level, over all rooms."""
    lines = [
        (
            planner,
            noise,
            str(len(runs)),
            percent(values(runs, "mouth_sweepable"), fmean),
            percent(values(runs, "mouth_sweepable"), min),
            number(values(runs, "path_ratio"), median),
            number(values(runs, "time_ratio"), median),
            number(values(runs, "time_ratio"), max),
            number([100 * r for r in values(runs, "hole_inradius_m")], max, 1),
            _fine_share(runs),
            number(_per_area(runs), max),
            outcomes(runs),
        )
        for (planner, noise), runs in group(rows, "planner", "noise").items()
    ]
    return Table(
        "Planners",
        (
            "planner",
            "noise",
            "runs",
            "mouth, mean %",
            "worst %",
            "path ratio, median",
            "time ratio, median",
            "worst",
            "deepest hole, cm",
            "runs with holes < 4 cm, %",
            "collisions per m², worst",
            "ended",
        ),
        lines,
        "Path ratio: path / (sweepable area / W). Time ratio: time / time to sweep the sweepable "
        "area once at cruise speed. The depth of a hole is the radius of the largest disc that "
        "fits into the floor that was not swept. Timeout: at the time limit; random, which never "
        f"ends by itself, after {MULTIPLES[-1]:g} times the reference time and energy.",
    )


def robot_table(rows: Sequence[Row]) -> Table:
    """Return the figures of each planner with each robot file; no line for the default robot."""
    named = rows if any(row["robot"] for row in rows) else []
    lines = [
        (
            robot_label(robot),
            planner,
            noise,
            str(len(runs)),
            percent(values(runs, "mouth_passing"), fmean),
            percent(values(runs, "mouth_passing"), min),
            percent(values(runs, "mouth_sweepable"), fmean),
            number(values(runs, "path_ratio"), median),
            number(values(runs, "time_ratio"), median),
            number(values(runs, "time_ratio"), max),
            number([run["hole_inradius_m"] / run["width_m"] for run in runs], max),
            number(_per_area(runs), max),
            outcomes(runs),
        )
        for (robot, planner, noise), runs in group(named, "robot", "planner", "noise").items()
    ]
    return Table(
        "Robots",
        (
            "robot",
            "planner",
            "noise",
            "runs",
            "mouth in passing, mean %",
            "worst %",
            "mouth, mean %",
            "path ratio, median",
            "time ratio, median",
            "worst",
            "deepest hole, W",
            "collisions per m², worst",
            "ended",
        ),
        lines,
        "In passing: of what the mouth reaches with any heading along the robot's motion. A mouth "
        "ahead of the axle reaches more by turning towards walls. The depth of a hole is the "
        "radius of the largest disc that fits into the unswept floor, in widths of the mouth.",
    )


def room_table(rows: Sequence[Row], noise: str) -> Table:
    """Return the coverage and time ratio of each planner in each room, mean over seeds."""
    planners = list(dict.fromkeys(row["planner"] for row in rows))
    lines = []
    at_level = [row for row in rows if row["noise"] == noise]
    for (room,), runs in group(at_level, "room").items():
        cells = [room, f"{runs[0]['sweepable_m2']:.2f}"]
        for planner in planners:
            mine = [run for run in runs if run["planner"] == planner]
            share = percent(values(mine, "mouth_sweepable"), fmean)
            ratio = number(values(mine, "time_ratio"), fmean)
            cells.append(f"{share} at {ratio}" if mine else "")
        lines.append(tuple(cells))
    return Table(
        f"Rooms, noise {noise}",
        ("room", "sweepable m²", *planners),
        lines,
        "Mean over seeds: swept share of the sweepable floor, %, and the run's time ratio.",
    )


def curve_table(rows: Sequence[Row], curve: str = "coverage") -> Table:
    """Return the coverage at multiples of a reference, mean over all runs of a planner.

    Args:
        rows: the runs.
        curve: ``coverage`` for the reference time, ``by_energy`` for the reference energy.

    """
    lines = [
        (planner, noise, str(len(runs)), *at_multiples(runs, curve))
        for (planner, noise), runs in group(rows, "planner", "noise").items()
    ]
    by_time = curve == "coverage"
    return Table(
        f"Coverage against {'time' if by_time else 'energy'}",
        ("planner", "noise", "runs", *(f"{MULTIPLES[k]:g}x" for k in _COLUMNS)),
        lines,
        "Swept share of the sweepable floor, %, mean over all runs, at multiples of the "
        + ("time" if by_time else "energy")
        + " to sweep the sweepable area once, straight ahead at cruise speed"
        + ("." if by_time else f": {_unit_mwh_m2(rows)} mWh/m².")
        + " After the end of its planner a run keeps its share. A dash: a run had reached its time "
        "limit before.",
    )


def _unit_mwh_m2(rows: Sequence[Row]) -> str:
    """Return the reference energy, mWh/m²: power / (speed · W), the same for all rooms."""
    return number(
        [1000.0 * row["reference_energy_wh"] / row["sweepable_m2"] for row in rows], median, 1
    )


def at_multiples(runs: Sequence[Row], curve: str) -> list[str]:
    """Return the mean of a curve, %, at each multiple; a dash if a run was ended earlier."""
    cells = []
    for k in _COLUMNS:
        shares = [run["curve"][curve][k] for run in runs]
        known = [share for share in shares if share is not None]
        cells.append(f"{100 * fmean(known):.1f}" if len(known) == len(shares) else "-")
    return cells


_COLUMNS = range(len(MULTIPLES))


def energy_table(rows: Sequence[Row], shares: Sequence[float] = (0.5, 0.8, 0.9, 0.95)) -> Table:
    """Return the median energy per sweepable square metre to reach each share of the floor.

    The median is over all runs. If a run never reached the share, its energy counts as infinite.
    Otherwise a planner that fails in the rooms with the highest energy would have a better median.
    """
    lines = [
        (planner, noise, str(len(runs)), *(_median_energy(runs, share) for share in shares))
        for (planner, noise), runs in group(rows, "planner", "noise").items()
    ]
    return Table(
        "Energy to a share",
        ("planner", "noise", "runs", *(f"{100 * share:.0f} %" for share in shares)),
        lines,
        "Median energy in mWh per sweepable square metre to reach the share, over all runs; in "
        f"brackets the percentage of runs that reached it within {MULTIPLES[-1]:g} times the "
        "reference time. A dash: the median run did not. Linear interpolation between the points "
        "of the curve.",
    )


def _median_energy(runs: Sequence[Row], share: float) -> str:
    drawn = [_energy_to(run, share) for run in runs]
    middle = median(math.inf if energy is None else energy for energy in drawn)
    reached = 100 * sum(energy is not None for energy in drawn) / len(runs)
    return f"{f'{middle:.1f}' if math.isfinite(middle) else '-'} ({reached:.0f} %)"


def _energy_to(run: Row, share: float) -> float | None:
    before_share, before_wh = 0.0, 0.0
    curve = run["curve"]
    for now_share, now_wh in zip(curve["coverage"], curve["energy_wh"], strict=True):
        if now_share is None:
            return None
        if now_share >= share:
            part = (share - before_share) / max(now_share - before_share, 1e-9)
            drawn_wh = before_wh + part * (now_wh - before_wh)
            return float(1000.0 * drawn_wh / run["sweepable_m2"])
        before_share, before_wh = now_share, now_wh
    return None


def values(runs: Sequence[Row], key: str) -> list[float]:
    """Return the values of a column that are not None."""
    return [run[key] for run in runs if run.get(key) is not None]


def percent(values: Sequence[float], figure: Callable[[Sequence[float]], float]) -> str:
    """Format a statistic of shares as a percentage; empty without values."""
    return f"{100 * figure(values):.2f}" if values else ""


def number(
    values: Sequence[float], figure: Callable[[Sequence[float]], float], digits: int = 2
) -> str:
    """Format a statistic of numbers; empty without values."""
    return f"{figure(values):.{digits}f}" if values else ""


def spread(values: Sequence[float]) -> str:
    """Format minimum and maximum of shares, %."""
    return f"{100 * min(values):.2f} to {100 * max(values):.2f}" if values else ""


def room_file(room: str, robot: str, robot_hash: str) -> str:
    """Return the file name of a generated room; the start of the room may depend on the robot."""
    of_robot = f"-{robot_label(robot)}-{robot_hash}" if robot else ""
    return f"{room.replace(':', '-')}{of_robot}.json"


def _per_area(runs: Sequence[Row]) -> list[float]:
    return [
        run["collisions"] / run["sweepable_m2"]
        for run in runs
        if run["collisions"] is not None and run["sweepable_m2"]
    ]


def _fine_share(runs: Sequence[Row]) -> str:
    depths = values(runs, "hole_inradius_m")
    fine = sum(depth < _FINE_INRADIUS_M for depth in depths)
    return f"{100 * fine / len(depths):.0f}" if depths else ""


def outcomes(runs: Sequence[Row]) -> str:
    """Return the number of runs by outcome."""
    counts: dict[str, int] = defaultdict(int)
    for run in runs:
        counts[run["outcome"]] += 1
    return ", ".join(f"{count} {outcome}" for outcome, count in sorted(counts.items()))


WORST_BY: tuple[tuple[str, bool, str, Callable[[float], str]], ...] = (
    ("mouth_sweepable", False, "mouth share", "{:.4f}".format),
    ("largest_hole_cm2", True, "largest hole, cm²", "{:.0f}".format),
    ("time_ratio", True, "time ratio", "{:.2f}".format),
)
"""Figures by which the worst runs are listed: column, whether a higher value is worse, name,
format."""


def worst_table(rows: Sequence[Row], rooms_folder: str, count: int = 10) -> Table:
    """Return the worst runs by three figures, each with the command that repeats the run."""
    lines = []
    for key, more_is_worse, name, form in WORST_BY:
        known = [row for row in rows if row.get(key) is not None and row["noise"] != PERFECT]
        known.sort(key=lambda row: row[key], reverse=more_is_worse)
        lines += [
            (name, form(row[key]), row["room"], row["planner"], row["noise"], str(row["seed"]),
             row["outcome"], repeat_command(row, rooms_folder))
            for row in known[:count]
        ]  # fmt: skip
    return Table(
        "The worst runs",
        ("by", "figure", "room", "planner", "noise", "seed", "ended", "command"),
        lines,
        f"The {count} worst runs by each figure, without runs with a perfect pose, which no "
        "command can repeat.",
    )


def repeat_command(row: Row, rooms_folder: str) -> str:
    """Return the command line that repeats a run and records it."""
    room, robot = row["room"], row["robot"]
    if is_made(room):
        room = f"{rooms_folder}/{room_file(room, robot, row['robot_hash'])}"
    longest_s, further = row["limit_s"], f" --robot {shlex.quote(robot)}" if robot else ""
    if row["planner"] == RANDOM:  # an experiment removes this planner's own time limit
        longest_s = row["duration_s"]
        further += " --planner-option max_time_s=1e6"
    return (
        f"sweepctl simulate {shlex.quote(room)} --planner {row['planner']}{further} "
        f"--noise {row['noise']} --seed {row['seed']} --max-time {longest_s:.9g}"
    )
