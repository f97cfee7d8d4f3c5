"""Comparison of runs pair by pair: two versions of the code, or two values of a constant.

Pairs are runs in the same room with the same robot, planner, noise level and seed. Differences of
pairs vary much less than the runs themselves.
"""

from __future__ import annotations

import json
import math
from statistics import fmean, median, stdev
from typing import TYPE_CHECKING, NamedTuple

from scipy import stats

from tools.experiment.store import LINES, ExperimentFolderError
from tools.experiment.tables import Table, group
from tools.experiment.trials import robot_label

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from tools.experiment.store import Row

Pair = tuple["Row", "Row"]
"""Results of a run with the first version or value, and of the same run with the second."""
_SAME = ("kind", "room", "planner", "noise", "seed", "robot_hash", "options")
"""Parameters that are equal in both runs of a pair. A robot file is compared by its content."""
EQUAL = 1e-4
"""Difference of the swept share below which two runs are equal."""
_LOSSES = 10
"""Number of pairs in the table of the largest losses."""


class PairedDifference(NamedTuple):
    """Mean difference of pairs, after minus before."""

    mean: float
    margin: float
    """Half the width of its 95 % confidence interval; infinite for one pair."""

    @property
    def certain(self) -> bool:
        """True if the interval does not contain 0."""
        return abs(self.mean) > self.margin

    def text(self, scale: float = 1.0, digits: int = 2) -> str:
        """Return the difference with its margin; a star if it is certain."""
        if math.isinf(self.margin):
            return f"{scale * self.mean:+.{digits}f}"
        star = " *" if self.certain else ""
        return f"{scale * self.mean:+.{digits}f} ± {scale * self.margin:.{digits}f}{star}"


def difference(pairs: Sequence[Pair], figure: str) -> PairedDifference:
    """Return the mean difference of a figure; runs without this figure are ignored."""
    found = [
        after[figure] - before[figure]
        for before, after in pairs
        if before.get(figure) is not None and after.get(figure) is not None
    ]
    if not found:
        return PairedDifference(0.0, math.inf)
    if len(found) == 1:
        return PairedDifference(found[0], math.inf)
    factor = float(stats.t.ppf(0.975, len(found) - 1))
    return PairedDifference(fmean(found), factor * stdev(found) / math.sqrt(len(found)))


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


def matched(before: Iterable[Row], after: Iterable[Row]) -> list[Pair]:
    """Return the pairs of runs that are in both lists, in the order of ``after``."""
    known = {_identity(row): row for row in before if "mouth_sweepable" in row}
    return [
        (known[_identity(row)], row)
        for row in after
        if "mouth_sweepable" in row and _identity(row) in known
    ]


def _identity(row: Row) -> tuple[object, ...]:
    return tuple(row.get(name) or (0 if name == "seed" else "") for name in _SAME)


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
            *("better / worse", "time ratio before", "difference", "path ratio", "collisions"),
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
