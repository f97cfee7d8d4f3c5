"""Tables of the comparison with zimablue, and of the causes of lost coverage."""

from __future__ import annotations

from statistics import fmean, median
from typing import TYPE_CHECKING

from tools.experiment.curves import MULTIPLES
from tools.experiment.tables import Table, at_multiples, group, number, outcomes, percent, values
from tools.experiment.trials import TrialKind
from tools.experiment.unswept_causes import CAUSES
from tools.experiment.zimablue_run import LONGEST, PLANNERS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row


def shared(rows: Sequence[Row]) -> list[Row]:
    """Return the runs with a room and seed for which zimablue and our planners have results."""
    theirs = {(row["room"], row["seed"]) for row in rows if row["kind"] == TrialKind.ZIMABLUE}
    ours = {(row["room"], row["seed"]) for row in rows if row["kind"] != TrialKind.ZIMABLUE}
    both = theirs & ours
    return [row for row in rows if (row["room"], row["seed"]) in both]


def display_name(planner: str) -> str:
    """Return the name of a planner in tables and figures."""
    package, _, name = planner.partition(" ")
    return f"{PLANNERS[name]} (zimablue)" if package == "zimablue" else planner


def zimablue_table(rows: Sequence[Row], curve: str) -> Table:
    """Return the coverage at multiples of each robot's own reference.

    Args:
        rows: runs of all planners.
        curve: ``coverage`` (against time) or ``by_path``.

    """
    lines = [
        (display_name(planner), noise, str(len(runs)), *at_multiples(runs, curve), outcomes(runs))
        for (planner, noise), runs in group(shared(rows), "planner", "noise").items()
    ]
    scale = next((row["scale"] for row in rows if row["kind"] == TrialKind.ZIMABLUE), 1.0)
    unit = "time" if curve == "coverage" else "path"
    return Table(
        f"Comparison with zimablue, against {unit}",
        ("planner", "noise", "runs", *(f"{m:g}x" for m in MULTIPLES), "ended"),
        lines,
        "Swept share, %, of the floor that each robot's mouth can reach, at multiples of the "
        "robot's own reference. The reference is that area / "
        + (
            "(width of the mouth · cruise speed). "
            if curve == "coverage"
            else "width of the mouth, at any speed. "
        )
        + "Rooms, starts and number of seeds are the same. zimablue has its own robot, sensors, "
        f"noise and speeds; its rooms are {scale:.2f} times as large, the ratio of the two "
        "bodies, so that every door and gap is equally tight for both. A dash: a run had reached "
        f"its time limit; zimablue's runs end at {LONGEST:g} times the reference time, random at "
        f"{MULTIPLES[-1]:g}.",
    )


def limit_table(rows: Sequence[Row]) -> Table:
    """Return the lost coverage by cause, for each planner and noise level."""
    lines = [
        (
            planner,
            noise,
            str(len(runs)),
            percent(values(runs, "mouth_sweepable"), fmean),
            percent(values(runs, "mouth_sweepable"), min),
            *(percent([run["loss"][cause] for run in runs], fmean) for cause in CAUSES),
            number(values(runs, "time_ratio"), median),
            outcomes(runs),
        )
        for (planner, noise), runs in group(rows, "planner", "noise").items()
    ]
    return Table(
        "Lost coverage by cause",
        ("planner", "sensors", "runs", "mouth, mean %", "worst %", *CAUSES, "time ratio", "ended"),
        lines,
        "Losses in percentage points of the sweepable floor, mean over runs; with the mouth's mean "
        "they add up to 100. Perfect: ranges without noise, and the true pose. "
        + " ".join(f"{cause.capitalize()}: {what}." for cause, what in CAUSES.items())
        + " The cause of a cell is the first in this order that applies.",
    )


def limit_room_table(rows: Sequence[Row], noise: str) -> Table:
    """Return the lost coverage by cause, for each room at one noise level."""
    at_level = [row for row in rows if row["noise"] == noise]
    lines = [
        (
            room,
            planner,
            percent(values(runs, "mouth_sweepable"), fmean),
            *(percent([run["loss"][cause] for run in runs], fmean) for cause in CAUSES),
        )
        for (room, planner), runs in group(at_level, "room", "planner").items()
    ]
    title = f"Lost coverage by room, {noise}"
    return Table(title, ("room", "planner", "mouth, mean %", *CAUSES), lines)
