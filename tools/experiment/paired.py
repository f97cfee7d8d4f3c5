"""One planner against each other one, run by run: what a mean may hide."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.experiment.compare_tables import display_name
from tools.experiment.curves import MULTIPLES
from tools.experiment.tables import Table, group
from tools.experiment.trials import NOISELESS, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row

FROM = 1.5
"""Multiple of the reference; before, no planner is near done and the order of its ways decides."""
_COLUMNS = tuple(k for k, multiple in enumerate(MULTIPLES) if multiple >= FROM)
_UNITS = {"coverage": "time", "by_energy": "energy"}


def paired_table(rows: Sequence[Row], curve: str, leader: str) -> Table:
    """In how many pairs of runs the leader is behind at equal time or energy, and how far.

    Args:
        rows: runs of all planners.
        curve: ``coverage`` (time) or ``by_energy``, which zimablue's runs have not.
        leader: the planner that is held against each other one.

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
        f"Pairs of runs in the same room, at the same noise, with the same seed: in how many "
        f"{leader} is behind at so many times the reference {unit}, and in brackets its margin in "
        "the worst pair, in points of the mouth's share (below 0: behind). A dash: a run was ended "
        "before."
        + (
            " zimablue's runs, with their own noise, stand beside ours of each level."
            if any(row["kind"] == Kind.ZIMABLUE for row in others)
            else ""
        ),
    )


def _pairs(
    rows: Sequence[Row], others: Sequence[Row], leader: str
) -> dict[tuple[str, str], list[tuple[Row, Row]]]:
    """The leader's run and the other's, by the other's planner and the leader's noise."""
    found: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    mine = [row for row in rows if row["planner"] == leader]
    for (planner,), theirs in group(others, "planner").items():
        for (noise,), at_level in group(mine, "noise").items():
            by_seed = {(row["room"], row["seed"]): row for row in at_level}
            # run once, for it is the same for every seed
            once = {row["room"]: row for row in at_level} if noise in NOISELESS else {}
            for other in theirs:
                run = by_seed.get((other["room"], other["seed"]), once.get(other["room"]))
                if run is not None and (other["noise"] == noise or other["kind"] == Kind.ZIMABLUE):
                    found.setdefault((planner, noise), []).append((run, other))
    return found


def _cell(pairs: Sequence[tuple[float | None, float | None]]) -> str:
    """How often the first is less than the second, and the least of first less second."""
    margins = [mine - theirs for mine, theirs in pairs if mine is not None and theirs is not None]
    if len(margins) < len(pairs):
        return "-"
    return f"{sum(margin < 0.0 for margin in margins)} ({100.0 * min(margins):+.1f})"
