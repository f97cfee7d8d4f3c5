"""Compares the runs of one planner with the runs of every other planner, pair by pair.

A mean can hide rooms in which the planner is worse.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.experiment.compare_tables import display_name
from tools.experiment.curves import MULTIPLES
from tools.experiment.tables import Table, group
from tools.experiment.trials import NOISELESS, TrialKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row

FROM = 1.5
"""Smallest multiple of the reference time or energy (``MULTIPLES``) at which coverage is compared.
At smaller multiples no planner is near its end, and its coverage depends mostly on the order of its
lanes."""
_COLUMNS = tuple(k for k, multiple in enumerate(MULTIPLES) if multiple >= FROM)
_UNITS = {"coverage": "time", "by_energy": "energy"}


def planner_pairs_table(rows: Sequence[Row], curve: str, leader: str) -> Table:
    """Return a table of the pairs in which the leader swept less, and of the leader's worst margin.

    A row is another planner. The margin is the leader's coverage minus the other planner's.

    The coverage is compared at equal time or energy.

    Args:
        rows: runs of all planners.
        curve: ``coverage`` (over time) or ``by_energy``. Runs of the external package zimablue
            have no energy curve.
        leader: planner that is compared with each other planner.

    """
    lines = []
    others = [row for row in rows if row["planner"] != leader and curve in row["curve"]]
    for (planner, noise), pairs in _pairs(rows, others, leader).items():
        shares = [(mine["curve"][curve], theirs["curve"][curve]) for mine, theirs in pairs]
        cells = [_cell([(mine[k], theirs[k]) for mine, theirs in shares]) for k in _COLUMNS]
        lines.append((display_name(planner), noise, str(len(pairs)), *cells))
    unit = _UNITS[curve]
    return Table(
        f"{leader} run by run, at equal {unit}",
        (f"{leader} against", "noise", "pairs", *(f"{MULTIPLES[k]:g}x" for k in _COLUMNS)),
        lines,
        "Pairs of runs in the same room with the same noise and seed. Each cell is the number of "
        f"pairs in which {leader} is behind at this multiple of the reference {unit}; in brackets "
        "its margin in the worst pair, in percentage points of the swept share (negative: behind). "
        "A dash: a run had reached its time limit before."
        + (
            " zimablue's runs have their own noise and are compared with ours of each level."
            if any(row["kind"] == TrialKind.ZIMABLUE for row in others)
            else ""
        ),
    )


def _pairs(
    rows: Sequence[Row], others: Sequence[Row], leader: str
) -> dict[tuple[str, str], list[tuple[Row, Row]]]:
    """Return pairs of runs, grouped by the other planner and by the leader's noise level.

    The first run of a pair is the leader's run.
    """
    found: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    mine = [row for row in rows if row["planner"] == leader]
    for (planner,), theirs in group(others, "planner").items():
        for (noise,), at_level in group(mine, "noise").items():
            by_seed = {(row["room"], row["seed"], row["robot"]): row for row in at_level}
            # without noise there is only one run, because every seed gives an equal run
            once = (
                {(row["room"], row["robot"]): row for row in at_level} if noise in NOISELESS else {}
            )
            for other in theirs:
                run = by_seed.get(
                    (other["room"], other["seed"], other["robot"]),
                    once.get((other["room"], other["robot"])),
                )
                if run is not None and (
                    other["noise"] == noise or other["kind"] == TrialKind.ZIMABLUE
                ):
                    found.setdefault((planner, noise), []).append((run, other))
    return found


def _cell(pairs: Sequence[tuple[float | None, float | None]]) -> str:
    """Return the number of pairs with a smaller first value, and the minimum difference."""
    margins = [mine - theirs for mine, theirs in pairs if mine is not None and theirs is not None]
    if len(margins) < len(pairs):
        return "-"
    return f"{sum(margin < 0.0 for margin in margins)} ({100.0 * min(margins):+.1f})"
