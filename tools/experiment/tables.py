"""What the runs amount to, next to the paper's figures and the aims."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from tools.experiment.worker import MULTIPLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from tools.experiment.store import Row

TABLE_2_M2 = (3.659, 3.588, 3.686, 3.621, 3.607)
"""Table 2: area covered in the five tests of case 1, of 3.837 m²."""
TABLE_2_FLOOR_M2 = 3.837
PAPER_SHARES = {
    "case-1": (fmean(TABLE_2_M2) / TABLE_2_FLOOR_M2, "Table 2, mean of five by division"),
    "case-2": (0.94, "section 5.2: “fluctuated around 94 %”"),
    "comprehensive": (0.9461, "section 5.3"),
}
_FINE_INRADIUS_M = 0.04


@dataclass(frozen=True, slots=True)
class Table:
    """A titled table of text."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""


def group(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values of some columns, in order of first sight."""
    groups: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[tuple(row[key] for key in keys)].append(row)
    return dict(groups)


def paper_table(rows: Sequence[Row]) -> Table:
    """The paper's three experiments: its figure, and ours by its formula (eq. 9)."""
    lines = []
    for (room, planner, noise), runs in group(rows, "room", "planner", "noise").items():
        if room not in PAPER_SHARES or planner != "paper":
            continue
        share, source = PAPER_SHARES[room]
        bodies = [run["body_free"] for run in runs if run["body_free"] is not None]
        lines.append(
            (
                room,
                planner,
                noise,
                f"{100 * share:.2f}",
                _percent(bodies, fmean),
                _spread(bodies),
                _percent(_values(runs, "mouth_sweepable"), fmean),
                _outcomes(runs),
                source,
            )
        )
    return Table(
        "The paper's experiments",
        (
            "room",
            "planner",
            "noise",
            "paper %",
            "body, mean %",
            "min to max",
            "mouth, mean %",
            "ended",
            "the paper's figure",
        ),
        lines,
        "Body: eq. (9) over the footprint, as we read the paper's figure. Mouth: of the floor "
        "that the mouth can reach, which is what is felt underfoot.",
    )


def planner_table(rows: Sequence[Row]) -> Table:
    """Each planner at each level over all rooms."""
    lines = [
        (
            planner,
            noise,
            str(len(runs)),
            _percent(_values(runs, "mouth_sweepable"), fmean),
            _percent(_values(runs, "mouth_sweepable"), min),
            _number(_values(runs, "path_ratio"), median),
            _number(_values(runs, "time_ratio"), median),
            _number(_values(runs, "time_ratio"), max),
            _number([100 * r for r in _values(runs, "hole_inradius_m")], max, 1),
            _fine_share(runs),
            _number(_per_area(runs), max),
            _outcomes(runs),
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
        "Path ratio: path over sweepable area / W. Time ratio: time over the time to sweep the "
        "sweepable area once at cruise speed. A hole's depth is the radius of the largest disc "
        "that fits into what was left.",
    )


def room_table(rows: Sequence[Row], noise: str) -> Table:
    """Each room with each planner, mean over seeds: mouth % at time ratio."""
    planners = list(dict.fromkeys(row["planner"] for row in rows))
    lines = []
    at_level = [row for row in rows if row["noise"] == noise]
    for (room,), runs in group(at_level, "room").items():
        cells = [room, f"{runs[0]['sweepable_m2']:.2f}"]
        for planner in planners:
            mine = [run for run in runs if run["planner"] == planner]
            share = _percent(_values(mine, "mouth_sweepable"), fmean)
            ratio = _number(_values(mine, "time_ratio"), fmean)
            cells.append(f"{share} at {ratio}" if mine else "")
        lines.append(tuple(cells))
    return Table(
        f"Rooms, noise {noise}",
        ("room", "sweepable m²", *planners),
        lines,
        "Mean over seeds: mouth % of sweepable, at the run's time ratio.",
    )


def curve_table(rows: Sequence[Row]) -> Table:
    """Coverage at multiples of the lower-bound time, mean over all runs of a planner."""
    lines = []
    for (planner, noise), runs in group(rows, "planner", "noise").items():
        means = [100 * fmean(run["curve"]["coverage"][k] for run in runs) for k in _COLUMNS]
        lines.append((planner, noise, *(f"{value:.1f}" for value in means)))
    return Table(
        "Coverage against time",
        ("planner", "noise", *(f"{MULTIPLES[k]:g}x" for k in _COLUMNS)),
        lines,
        "Mouth % of sweepable at multiples of the time to sweep the sweepable area once.",
    )


_COLUMNS = range(len(MULTIPLES))


def energy_table(rows: Sequence[Row], shares: Sequence[float] = (0.5, 0.8, 0.9, 0.95)) -> Table:
    """Energy per sweepable square metre until a share was reached: median, and how many did."""
    lines = []
    for (planner, noise), runs in group(rows, "planner", "noise").items():
        cells = [planner, noise]
        for share in shares:
            drawn = [e for run in runs if (e := _energy_to(run, share)) is not None]
            cells.append(
                f"{median(drawn):.1f} ({100 * len(drawn) / len(runs):.0f} %)" if drawn else "never"
            )
        lines.append(tuple(cells))
    return Table(
        "Energy to a share",
        ("planner", "noise", *(f"{100 * share:.0f} %" for share in shares)),
        lines,
        "Median mWh per sweepable square metre, over the runs that reached the share (how many "
        "did, in brackets); between the curve's points by straight lines.",
    )


def _energy_to(run: Row, share: float) -> float | None:
    before_share, before_wh = 0.0, 0.0
    curve = run["curve"]
    for now_share, now_wh in zip(curve["coverage"], curve["energy_wh"], strict=True):
        if now_share >= share:
            part = (share - before_share) / max(now_share - before_share, 1e-9)
            drawn_wh = before_wh + part * (now_wh - before_wh)
            return float(1000.0 * drawn_wh / run["sweepable_m2"])
        before_share, before_wh = now_share, now_wh
    return None


def _values(runs: Sequence[Row], key: str) -> list[float]:
    return [run[key] for run in runs if run.get(key) is not None]


def _percent(values: Sequence[float], figure: Callable[[Sequence[float]], float]) -> str:
    return f"{100 * figure(values):.2f}" if values else ""


def _number(
    values: Sequence[float], figure: Callable[[Sequence[float]], float], digits: int = 2
) -> str:
    return f"{figure(values):.{digits}f}" if values else ""


def _spread(values: Sequence[float]) -> str:
    return f"{100 * min(values):.2f} to {100 * max(values):.2f}" if values else ""


def _per_area(runs: Sequence[Row]) -> list[float]:
    return [
        run["collisions"] / run["sweepable_m2"]
        for run in runs
        if run["collisions"] is not None and run["sweepable_m2"]
    ]


def _fine_share(runs: Sequence[Row]) -> str:
    depths = _values(runs, "hole_inradius_m")
    fine = sum(depth < _FINE_INRADIUS_M for depth in depths)
    return f"{100 * fine / len(depths):.0f}" if depths else ""


def _outcomes(runs: Sequence[Row]) -> str:
    counts: dict[str, int] = defaultdict(int)
    for run in runs:
        counts[run["outcome"]] += 1
    return ", ".join(f"{count} {outcome}" for outcome, count in sorted(counts.items()))
