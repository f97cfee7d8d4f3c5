"""The page about a whole mutation run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mutation.targets import equivalents

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mutation.run import Tally

_HEAD = """\
# Mutants of the safety code

<!-- Written by `python -m mutation.run --out docs/mutation.md` with tests/ on the path. -->

Every comparison, sum, condition, constant, choice and statement of the code that stops the robot
is changed, one at a time, and the fast tests of that code must notice: a change that no test
notices is behaviour that nobody has checked. `PYTHONPATH=tests python -m mutation.run` does it
again, whole; CI tries a share.

| code | mutants | killed | equivalent | survived |
|---|---|---|---|---|
"""
_LIST = """
An *equivalent* mutant changes nothing that anybody could notice. Each has its proof:

| code | mutant | why nothing changes |
|---|---|---|
"""


def page(tallies: Sequence[Tally]) -> str:
    """The whole page."""
    rows, proofs = [], []
    for tally in tallies:
        target, same, alive = tally.target, len(tally.equivalent), len(tally.survived)
        cells = (f"`{target.module}`", tally.killed + same + alive, tally.killed, same, alive)
        rows.append(_row(cells))
        listed = equivalents().get(target.name, {})
        for mutant in tally.equivalent:
            name = mutant.name.replace("|", "\\|")
            proofs.append(_row((target.name, f"`{name}`", listed[mutant.name])))
    killed, same, alive = (
        sum(counts)
        for counts in zip(
            *((t.killed, len(t.equivalent), len(t.survived)) for t in tallies), strict=True
        )
    )
    rows.append(_row(("*together*", killed + same + alive, killed, same, alive)))
    return _HEAD + "".join(rows) + _LIST + "".join(proofs)


def _row(cells: tuple[object, ...]) -> str:
    return f"| {' | '.join(map(str, cells))} |\n"
