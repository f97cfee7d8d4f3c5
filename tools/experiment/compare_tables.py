"""Side by side with other people's planners, and where our own lose."""

from __future__ import annotations

from statistics import fmean, median
from typing import TYPE_CHECKING

from tools.experiment.curves import MULTIPLES
from tools.experiment.limits import CAUSES
from tools.experiment.tables import Table, at_multiples, group, number, outcomes, percent, values
from tools.experiment.trials import Kind
from tools.experiment.zimablue_run import LONGEST, PLANNERS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row


def shared(rows: Sequence[Row]) -> list[Row]:
    """The runs of rooms and seeds that both sides have."""
    theirs = {(row["room"], row["seed"]) for row in rows if row["kind"] == Kind.ZIMABLUE}
    ours = {(row["room"], row["seed"]) for row in rows if row["kind"] != Kind.ZIMABLUE}
    both = theirs & ours
    return [row for row in rows if (row["room"], row["seed"]) in both]


def display_name(planner: str) -> str:
    """Of a planner, in tables and figures."""
    package, _, name = planner.partition(" ")
    return f"{PLANNERS[name]} (zimablue)" if package == "zimablue" else planner


def zimablue_table(rows: Sequence[Row], curve: str) -> Table:
    """Coverage at multiples of each robot's own reference: ``coverage`` (time), ``by_path``."""
    lines = [
        (display_name(planner), noise, str(len(runs)), *at_multiples(runs, curve), outcomes(runs))
        for (planner, noise), runs in group(shared(rows), "planner", "noise").items()
    ]
    scale = next((row["scale"] for row in rows if row["kind"] == Kind.ZIMABLUE), 1.0)
    unit = "time" if curve == "coverage" else "path"
    return Table(
        f"Side by side with zimablue, against {unit}",
        ("planner", "noise", "runs", *(f"{m:g}x" for m in MULTIPLES), "ended"),
        lines,
        "Mouth % of what each robot's mouth can reach, at multiples of its own reference: that "
        + (
            "area / (width of its mouth · its cruise speed). "
            if curve == "coverage"
            else "area / width of its mouth, whatever its speed. "
        )
        + "Same rooms, same starts, same number of seeds. zimablue's robot, sensors, noise and "
        f"speeds are its own; the rooms are {scale:.2f} times as large for it, the ratio of the "
        "two bodies, so that every door and gap is as tight for it as for ours. A dash: a run was "
        f"ended before, theirs at {LONGEST:g} times the reference time, random at "
        f"{MULTIPLES[-1]:g}.",
    )


def limit_table(rows: Sequence[Row]) -> Table:
    """The remaining loss by cause, at each level of knowledge."""
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
        "What limits it: the loss by cause",
        ("planner", "sensors", "runs", "mouth, mean %", "worst %", *CAUSES, "time ratio", "ended"),
        lines,
        "Losses in points of the sweepable floor, mean over runs; with the mouth's mean they add "
        "up to 100. Perfect: ranges without noise and the true pose. "
        + " ".join(f"{cause.capitalize()}: {what}." for cause, what in CAUSES.items())
        + " The first that holds, in this order, is a cell's cause.",
    )


def limit_room_table(rows: Sequence[Row], noise: str) -> Table:
    """The same for each room."""
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
    return Table(f"The loss by room, {noise}", ("room", "planner", "mouth, mean %", *CAUSES), lines)
