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

This page shows that the tests of the safety code notice every small change to it.

A *mutant* is the code with one change: a comparison, a sum, a condition, a constant, a choice or a
statement. The fast tests of the module run against each mutant. If a test fails, the mutant is
*killed*. If all tests pass, it has *survived*, and the tests miss that behaviour.

`PYTHONPATH=tests python -m mutation.run` repeats the whole run. CI runs a share of it.

| module | mutants | killed | equivalent | survived |
|---|---|---|---|---|
"""
_LIST = """
## Equivalent mutants

An *equivalent* mutant does not change what the module does, so no test can kill it. The proof for
each:
"""


def page(tallies: Sequence[Tally]) -> str:
    """Return the whole page."""
    rows, proofs = [], []
    for tally in tallies:
        target, same, alive = tally.target, len(tally.equivalent), len(tally.survived)
        cells = (f"`{target.module}`", tally.killed + same + alive, tally.killed, same, alive)
        rows.append(_row(cells))
        listed = equivalents().get(target.name, {})
        proofs += _proofs(target.module, [(m.name, listed[m.name]) for m in tally.equivalent])
    killed, same, alive = (
        sum(counts)
        for counts in zip(
            *((t.killed, len(t.equivalent), len(t.survived)) for t in tallies), strict=True
        )
    )
    rows.append(_row(("*together*", killed + same + alive, killed, same, alive)))
    return _HEAD + "".join(rows) + _LIST + "".join(proofs)


def _proofs(module: str, proofs: Sequence[tuple[str, str]]) -> list[str]:
    """Return a module's equivalent mutants as a list, grouped by proof."""
    if not proofs:
        return []
    by_proof: dict[str, list[str]] = {}
    for name, proof in proofs:
        by_proof.setdefault(proof, []).append(name)
    lines = [f"\n### `{module}`\n\n"]
    for proof, names in by_proof.items():
        mutants = [f"- `{name}`\n" for name in names]
        lines += [proof, "\n\n", *mutants, "\n"]
    return lines[:-1]


def _row(cells: tuple[object, ...]) -> str:
    return f"| {' | '.join(map(str, cells))} |\n"
