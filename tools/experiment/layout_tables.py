"""Tables of the paper's algorithm in the layouts in which it fails, and with range noise."""

from __future__ import annotations

from statistics import fmean
from typing import TYPE_CHECKING

from tools.experiment.paper_trials import RANGE_LEVEL, STRICT_END, TOLERANCES
from tools.experiment.tables import Table, group, percent, spread, values
from tools.experiment.trials import TrialKind
from tools.rooms.layouts import LAYOUT, LAYOUTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row

_NOTED_COST = 8.0
"""Loss of coverage that was expected from 1 cm of range noise with 1 cm of tolerance, percentage
points. The value was computed before the runs."""


def layout_table(rows: Sequence[Row]) -> Table:
    """Return the coverage in each layout: expected, two variants of ``paper``, and ``recovery``."""
    lines = []
    for (room,), runs in group(_of(rows, TrialKind.LAYOUT), "room").items():
        layout = LAYOUTS[room.removeprefix(LAYOUT)]
        shares = [
            percent(values([run for run in runs if run["planner"] == planner], _SHARE), fmean)
            for planner in ("paper", STRICT_END, "recovery")
        ]
        lines.append((room.removeprefix(LAYOUT), layout.what, layout.expected, *shares))
    return Table(
        "Layouts where the paper's algorithm fails",
        ("layout", "what it is", "expected %", "paper", STRICT_END, "recovery"),
        lines,
        "Swept share, %, of the floor that the mouth can reach, noise none, one seed. Expected: "
        "computed beforehand for the paper's algorithm in layouts of the same kind, whose sizes "
        "are not known. The sizes here, with sides of 3 to 5 m, are our choice and not fitted to "
        "those figures: compare the failure, not the number. Strict end: the run ends at the first "
        "blocked side step, which is another reading of the paper.",
    )


def range_table(rows: Sequence[Row]) -> Table:
    """Return the loss by 1 cm of range noise, for two ways to count T and two tolerances."""
    lines = []
    for (planner,), runs in group(_of(rows, TrialKind.RANGES), "planner").items():
        options, counting = TOLERANCES[planner]
        without, noisy = (
            values([run for run in runs if run["noise"] == noise], _SHARE)
            for noise in ("none", RANGE_LEVEL.name)
        )
        cost = f"{100 * (fmean(without) - fmean(noisy)):.2f}" if without and noisy else ""
        lines.append(
            (
                counting,
                f"{100 * options.equal_tolerance_m:g} cm",
                percent(without, fmean),
                percent(noisy, fmean),
                spread(noisy),
                cost,
            )
        )
    return Table(
        "Case 1 with 1 cm of range noise",
        (
            "T counted",
            "tolerance",
            "without noise %",
            "1 cm, mean %",
            "min to max",
            "cost, points",
        ),
        lines,
        "Swept share, %, of the floor that the mouth can reach; the expected cost was "
        f"{_NOTED_COST:g} points. Noise: none, except a standard deviation of 1 cm in every "
        "ultrasonic range. The tolerance is that of D = Prev-D. It matters only if T is counted "
        "by equal lanes; the default counts whole steps.",
    )


_SHARE = "mouth_sweepable"


def _of(rows: Sequence[Row], kind: TrialKind) -> list[Row]:
    return [row for row in rows if row["kind"] == kind]
