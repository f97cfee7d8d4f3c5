"""The gate of the safety code: required coverage, and allowed number of surviving mutants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from mutation.covered import measure
from mutation.mutator import Mutant, mutants
from mutation.run import Tally
from mutation.targets import TARGETS, Target
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

MODULE = """
def sign(value):
    if value < 0:
        return -1
    return 1
"""
HALF = "from guarded import sign\n\ndef test_up():\n    assert sign(3) == 1\n"
ALL = f"{HALF}\ndef test_down():\n    assert sign(-3) == -1\n"


@pytest.mark.parametrize(
    ("tests", "gate", "holds", "missing"),
    [(ALL, 100.0, True, []), (HALF, 100.0, False, [3, 4]), (HALF, 60.0, True, [3, 4])],
    ids=["all", "below the gate", "above a lower gate"],
)
def test_a_branch_that_no_test_takes_is_below_the_gate(
    tmp_path: Path, tests: str, gate: float, missing: list[int], *, holds: bool
) -> None:
    (tmp_path / "guarded.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "test_guarded.py").write_text(tests, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\npythonpath = .\n", encoding="utf-8")
    target = Target("guarded", "guarded", ("test_guarded.py",), covered=gate)
    (found,) = measure((target,), tmp_path)
    assert found.holds is holds
    assert found.missing == missing


def test_every_target_has_a_gate_and_its_tests_exist() -> None:
    modules = {target.module for target in TARGETS}
    assert {
        "bridge.run.dead_man_switch",
        "bridge.io.stopping",
        "bridge.run.host",
        "sim_device.device.latch",
        "sim_device.device.freshness",
        "sim_device.device.watchdog",
    } <= modules
    for target in TARGETS:
        assert target.path.is_file()
        assert all((ROOT / test).is_file() for test in target.tests), target.name
        assert target.covered >= 95.0


def survivors(count: int) -> list[Mutant]:
    return mutants(MODULE)[:count]


@pytest.mark.parametrize(
    ("granted", "survived", "whole", "passes"),
    [
        (0, 0, True, True),
        (0, 1, True, False),
        (0, 1, False, False),
        (2, 2, True, True),
        (2, 3, True, False),
        (2, 3, False, True),  # a share of the mutants does not show the total
    ],
)
def test_more_survivors_than_are_granted_fail_the_run(
    granted: int, survived: int, *, whole: bool, passes: bool
) -> None:
    tally = Tally(Target("a", "b", (), unexamined=granted), survived=survivors(survived))
    assert tally.passes(whole=whole) is passes
    tally.stale = ["listed, and killed"]
    assert not tally.passes(whole=whole)
