"""Differences of runs pair by pair, with confidence intervals: of two versions, or two values.

Pairs are runs in the same room with the same robot, planner, noise level and seed. Differences of
pairs vary much less than the runs themselves.
"""

from __future__ import annotations

import math
from statistics import fmean, stdev
from typing import TYPE_CHECKING, NamedTuple

from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tools.experiment.store import Row

Pair = tuple["Row", "Row"]
"""Results of a run with the first version or value, and of the same run with the second."""
_SAME = (
    *("kind", "room", "planner", "noise", "seed", "max_time_s"),
    *("room_hash", "robot_hash", "options"),
)
"""Parameters that are equal in both runs of a pair. Files are compared by their content."""


class PairedDifference(NamedTuple):
    """Mean difference of pairs, after minus before."""

    mean: float
    margin: float
    """Half the width of its 95 % confidence interval; infinite for one pair."""

    @property
    def certain(self) -> bool:
        """True if the interval does not contain 0. Equal differences have no interval."""
        return abs(self.mean) > self.margin > 0.0

    def text(self, scale: float = 1.0, digits: int = 2) -> str:
        """Return the difference with its margin; a star if it is certain."""
        if math.isinf(self.margin):
            return f"{scale * self.mean:+.{digits}f}"
        mean = f"{scale * self.mean:+.{digits}f}"
        star = " *" if self.certain and float(mean) else ""
        return f"{mean} ± {scale * self.margin:.{digits}f}{star}"


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
