"""Comparison of two versions of the code, run by run (`--against`)."""

from __future__ import annotations

import json
from statistics import fmean, median
from typing import TYPE_CHECKING

from tools.experiment.paired_differences import difference
from tools.experiment.store import LINES, ExperimentFolderError
from tools.experiment.tables import Table, group
from tools.experiment.trials import robot_label

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from tools.experiment.paired_differences import Pair
    from tools.experiment.store import Row

EQUAL = 1e-4
"""Difference of the swept share below which two runs are equal."""
_LOSSES = 10
"""Number of pairs in the table of the largest losses."""


def read_rows(folder: Path) -> list[Row]:
    """Read the results of an experiment, from any version of the code.

    Raises:
        ExperimentFolderError: the folder contains no results.

    """
    path = folder / LINES
    try:
        lines = path.read_text("utf-8").splitlines()
    except OSError as error:
        raise ExperimentFolderError(f"cannot read {path}: {error.strerror}") from None
    rows = []
    for line in lines:
        try:
            row = json.loads(line)
        except ValueError:
            continue  # an incomplete line of a killed writer
        if isinstance(row, dict) and "key" in row:
            rows.append(row)
    if not rows:
        raise ExperimentFolderError(f"{path} has no results")
    return rows


def version_of(rows: Iterable[Row]) -> str:
    """Return the version of the code that produced the rows."""
    return ", ".join(dict.fromkeys(str(row.get("version", "?")) for row in rows))


def versions_table(pairs: Sequence[Pair], was: str, now: str) -> Table:
    """Return the differences of each planner, noise level and robot."""
    lines = []
    afters = [after for _, after in pairs]
    by_after = {id(after): before for before, after in pairs}
    for (planner, noise, robot), rows in group(afters, "planner", "noise", "robot").items():
        mine = [(by_after[id(row)], row) for row in rows]
        shares = [after["mouth_sweepable"] - before["mouth_sweepable"] for before, after in mine]
        lines.append(
            (
                planner,
                noise,
                robot_label(robot),
                str(len(mine)),
                f"{100 * fmean(b['mouth_sweepable'] for b, _ in mine):.2f}",
                difference(mine, "mouth_sweepable").text(100.0),
                f"{100 * min(shares):+.2f}",
                f"{sum(s > EQUAL for s in shares)} / {sum(s < -EQUAL for s in shares)}",
                f"{median(b['time_ratio'] for b, _ in mine):.2f}",
                difference(mine, "time_ratio").text(),
                difference(mine, "path_ratio").text(),
                difference(mine, "collisions").text(),
                _outcomes(mine),
            )
        )
    return Table(
        f"{now} against {was}, run by run",
        (
            *("planner", "noise", "robot", "pairs", "mouth before, %", "difference", "worst"),
            *("better / worse", "time ratio before", "difference", "path ratio"),
            "collisions per run",
            "ends changed",
        ),
        lines,
        "Pairs of runs in the same room with the same robot, planner, noise and seed. Differences "
        "are after less before, with the 95 % confidence interval of the mean; a star: it does not "
        "contain 0. Mouth in percentage points.",
    )


def _outcomes(pairs: Sequence[Pair]) -> str:
    changed = [
        f"{before['outcome']} to {after['outcome']}"
        for before, after in pairs
        if before["outcome"] != after["outcome"]
    ]
    return ", ".join(f"{changed.count(each)} {each}" for each in dict.fromkeys(changed)) or "-"


def losses_table(pairs: Sequence[Pair]) -> Table:
    """Return the pairs with the largest loss of coverage, and the pairs with a longer time."""
    ordered = sorted(
        pairs,
        key=lambda pair: (
            pair[1]["mouth_sweepable"] - pair[0]["mouth_sweepable"],
            pair[0]["time_ratio"] - pair[1]["time_ratio"],
        ),
    )
    lines = [
        (
            after["room"],
            after["planner"],
            after["noise"],
            str(after["seed"]),
            robot_label(after["robot"]),
            f"{100 * before['mouth_sweepable']:.2f} to {100 * after['mouth_sweepable']:.2f}",
            f"{before['time_ratio']:.2f} to {after['time_ratio']:.2f}",
            after["outcome"],
        )
        for before, after in ordered[:_LOSSES]
    ]
    head = ("room", "planner", "noise", "seed", "robot", "mouth, %", "time ratio", "ended")
    return Table("Pairs with the largest loss", head, lines)


def versions_tables(pairs: Sequence[Pair], was: str, now: str) -> list[Table]:
    """Return the tables of two versions, or a note in a table if they have no run in common."""
    if not pairs:
        note = "No room, robot, planner, noise and seed is in both results."
        return [Table(f"{now} against {was}, run by run", ("pairs",), [("0",)], note)]
    return [versions_table(pairs, was, now), losses_table(pairs)]
