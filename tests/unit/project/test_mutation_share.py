"""The mutation tester on a module of a few lines, and on a part of the real safety code."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from mutation.mutator import mutants
from mutation.run import Kept
from mutation.targets import TARGETS, equivalents
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

FRESHNESS = next(target for target in TARGETS if target.name == "freshness")
SOURCE = '''
"""Text is left alone."""
LIMIT = 250
def late(us: int, *, now: int = 3) -> bool:
    """So is this."""
    left = max(0, us - now)
    return left > LIMIT and not now
'''


def test_changed_and_unchanged_code() -> None:
    found = {mutant.name for mutant in mutants(SOURCE)}
    assert {
        "module: 250 -> 251",
        "module: 250 -> 125",
        "module: LIMIT = 250 -> pass",
        "late: us - now -> us + now",
        "late: max(0, us - now) -> min(0, us - now)",
        "late: left > LIMIT -> left >= LIMIT",
        "late: left > LIMIT -> left <= LIMIT",
        "late: left > LIMIT and (not now) -> left > LIMIT or not now",
        "late: not now -> now",
    } <= found
    assert not any("Text" in name or "3 ->" in name for name in found)
    assert mutants(SOURCE, frozenset({"late"})) == mutants(SOURCE)[:3]


def test_each_mutant_is_one_change_with_a_unique_name() -> None:
    made = mutants(FRESHNESS.path.read_text(), FRESHNESS.exclude)
    assert len({mutant.name for mutant in made}) == len(made) > 20
    few = made[::8]
    assert len({mutant.source for mutant in (*few, *made[1::8])}) == 2 * len(few)


def test_every_listed_equivalent_is_a_mutant_with_a_proof() -> None:
    listed = equivalents()
    assert listed.keys() <= {target.name for target in TARGETS}
    for target in TARGETS:
        proofs = listed.get(target.name, {})
        if proofs:
            names = {mutant.name for mutant in mutants(target.path.read_text(), target.exclude)}
            assert proofs.keys() <= names
            assert all(len(proof) > 30 for proof in proofs.values())


def test_the_lines_of_a_change_are_those_of_its_statement_or_of_its_head() -> None:
    source = "def f(a, b):\n    if (a\n            < b):\n        return (a +\n                b)\n"
    lines = {mutant.before: mutant.lines for mutant in mutants(source)}
    assert lines == {"a < b": range(2, 4), "return a + b": range(4, 6), "a + b": range(4, 6)}


def test_an_interrupted_run_continues(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    Kept(path).add(FRESHNESS, "0123", "late: a -> b", killed=False)
    assert Kept(path).of(FRESHNESS, "0123") == {"late: a -> b": False}
    assert Kept(path).of(FRESHNESS, "4567") == {}, "results of other sources are not used"
    assert Kept(None).of(FRESHNESS, "0123") == {}


def test_a_share_of_the_mutants_is_killed_except_equivalents() -> None:
    # A separate process, because this process has imported the target.
    made = [mutant.name for mutant in mutants(FRESHNESS.path.read_text(), FRESHNESS.exclude)]
    share = 5
    same = next(name for name in equivalents()["freshness"] if name in made)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "mutation.run", "--target", "freshness"),
            *("--share", f"{share}", "--offset", f"{made.index(same) % share}"),
        ],
        cwd=ROOT / "tests",
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"freshness +[4-6] killed +[1-3] equivalent +0 survived", done.stdout)
