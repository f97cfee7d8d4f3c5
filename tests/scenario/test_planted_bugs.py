"""Deliberate bugs in a copy of the C core: the tests of the safety chain must find each bug."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.core_build import FIRMWARE, LIBRARY, compile_core
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

DEVICE = "tests/unit/sim_device/device"
BUGS = {
    "the latch does not latch": (
        "latch.h",
        "    latch->cause = sp_latched_cause(held, cause);",
        "    (void)cause;",
        [f"{DEVICE}/test_latching.py"],
    ),
    "the watchdog is twice too long": (
        "watchdog.c",
        "arrived_us + left / FRESHNESS_STEPS_PER_US;",
        "arrived_us + 2 * left / FRESHNESS_STEPS_PER_US;",
        [f"{DEVICE}/test_resets.py"],
    ),
}


def built(folder: Path, file: str = "", correct: str = "", wrong: str = "") -> Path:
    """Return a library built from a copy of the core with a replaced text in one file."""
    core = folder / "core"
    shutil.copytree(FIRMWARE / "core", core)
    if file:
        source = (core / file).read_text()
        assert source.count(correct) == 1, file
        (core / file).write_text(source.replace(correct, wrong))
    flags = ("-O0", "-fPIC", "-shared", "-fvisibility=hidden", "-Wno-unused-variable")
    return compile_core(
        folder / "firmware.so", FIRMWARE / "protocol", LIBRARY, flags=flags, core=core
    )


def failures(library: Path, tests: list[str]) -> set[str]:
    """Return the names of the tests that fail with this library as the core."""
    options = ["-q", "-p", "no:cacheprovider", "--tb=no", "-rf", "-k", "core"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "--core-library", library, *tests],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode in {0, 1}, done.stdout + done.stderr
    assert " passed" in done.stdout
    return set(re.findall(r"^FAILED \S+::(\w+)", done.stdout, re.MULTILINE))


def test_the_copy_without_a_bug_passes(tmp_path: Path) -> None:
    assert failures(built(tmp_path), [f"{DEVICE}/test_latching.py"]) == set()


@pytest.mark.parametrize("bug", BUGS)
def test_a_bug_is_found(bug: str, tmp_path: Path) -> None:
    *change, tests = BUGS[bug]
    assert failures(built(tmp_path, *change), tests)
