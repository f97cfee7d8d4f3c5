"""Tables of our results and the paper's: Table 2, the other rooms, section 5.3 and Fig. 15."""

from __future__ import annotations

from statistics import fmean, median, quantiles
from typing import TYPE_CHECKING

from tools.experiment.curves import MULTIPLES
from tools.experiment.cycles import PAPER_END_MM
from tools.experiment.paper_trials import COMPREHENSIVE
from tools.experiment.tables import Table, group, number, outcomes, percent, spread, values
from tools.experiment.trials import TrialKind
from tools.experiment.u_cycles import PAPER_CYCLES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row

TABLE_2_M2 = (3.659, 3.588, 3.686, 3.621, 3.607)
"""Area covered in the five tests of case 1, m², of 3.837 m²: Table 2 of the paper."""
TABLE_2_FLOOR_M2 = 3.837
"""Floor area of case 1, m²: Table 2 of the paper."""
PAPER_SHARES = {
    "case-1": (fmean(TABLE_2_M2) / TABLE_2_FLOOR_M2, "Table 2, mean of five by division"),
    "case-2": (0.94, "section 5.2: “fluctuated around 94 %”"),
    COMPREHENSIVE: (0.9461, "section 5.3"),
}
"""Coverage in the paper, 0 to 1, and the place in the paper, by room."""


def paper_table(rows: Sequence[Row]) -> Table:
    """Return the coverage in the paper's three experiments: the paper's, and ours by equation 9."""
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
                percent(bodies, fmean),
                spread(bodies),
                percent(values(runs, "mouth_sweepable"), fmean),
                outcomes(runs),
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
        "Body: eq. (9) over the footprint, which is our reading of the paper's figure. Mouth: "
        "swept share of the floor that the mouth can reach, which is what a user notices.",
    )


def beside_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the runs to compare in the comprehensive room; empty without other planners."""
    others = [row for row in rows if row["kind"] == TrialKind.BESIDE]
    levels = {row["noise"] for row in others}
    papers = [
        row
        for row in rows
        if (row["kind"], row["room"], row["planner"]) == (TrialKind.RUN, COMPREHENSIVE, "paper")
        and row["noise"] in levels
    ]
    return papers + others


def beside_table(rows: Sequence[Row]) -> Table:
    """Return the comparison of section 5.3: paper's algorithm, U-shaped path, random path, ours."""
    lines = []
    for (planner,), runs in group(beside_rows(rows), "planner").items():
        bodies = values(runs, "body_free")
        share = PAPER_SHARES[COMPREHENSIVE][0]
        lines.append(
            (
                planner,
                f"{100 * share:.2f}" if planner == "paper" else "not given",
                percent(bodies, fmean),
                spread(bodies),
                percent(values(runs, "mouth_sweepable"), fmean),
                number(values(runs, "duration_s"), fmean, 0),
                number(values(runs, "path_m"), fmean, 1),
                number(values(runs, "repeat_ratio"), fmean),
                number(values(runs, "energy_wh"), fmean),
                outcomes(runs),
            )
        )
    return Table(
        "Section 5.3: planners compared in the comprehensive room",
        (
            "planner",
            "paper %",
            "body, mean %",
            "min to max",
            "mouth, mean %",
            "time, mean s",
            "path, mean m",
            "repeated, mean",
            "energy, mean Wh",
            "ended",
        ),
        lines,
        "Noise paper. The paper compares with the U-shaped path, and in its conclusions with the "
        "random path, without figures; the room is our reading of its Fig. 18. Repeated: path · W "
        "/ swept area, minus 1. The random planner does not detect its end: its run is ended after "
        f"{MULTIPLES[-1]:g} times the reference time and energy.",
    )


def cycle_spread(rows: Sequence[Row], key: str = "offset_mm") -> list[tuple[float, float, float]]:
    """Return first quartile, median and third quartile over the runs, after each cycle."""
    found = []
    for at_cycle in zip(*(row["offsets"] for row in rows), strict=False):
        points = [point[key] for point in at_cycle]
        low, _, high = quantiles(points, n=4, method="inclusive") if len(points) > 1 else points * 3
        found.append((low, median(points), high))
    return found


def cycle_table(rows: Sequence[Row]) -> Table:
    """Return the table for Fig. 15: the offset at the end of each U-shaped cycle."""
    offsets = cycle_spread(rows)
    along, across = cycle_spread(rows, "along_mm"), cycle_spread(rows, "across_mm")
    lines = [
        (
            str(cycle),
            f"{middle:.1f}",
            f"{low:.1f} to {high:.1f}",
            f"{along[cycle - 1][1]:+.1f}",
            f"{across[cycle - 1][1]:+.1f}",
            f"{PAPER_END_MM:g}" if cycle == PAPER_CYCLES else "",
        )
        for cycle, (low, middle, high) in enumerate(offsets, 1)
    ]
    return Table(
        "Fig. 15: offset after each U-shaped cycle",
        (
            "cycle",
            "offset, median mm",
            "quartiles mm",
            "along the lanes, median mm",
            "across, median mm",
            "paper mm",
        ),
        lines,
        f"{len(rows)} seeds with noise paper on an open floor, where no wall corrects the "
        f"estimate: seven cycles of {rows[0]['path_m'] if rows else 0:g} m in all, with the whole "
        "stack. The offset is the true position minus the planned one.",
    )
