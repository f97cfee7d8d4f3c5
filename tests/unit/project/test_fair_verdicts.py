"""Real-time tests run again where the machine was busy, and only there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.hold_up import BUSY, PRESSURE, Busy, waited_ns
from support.root import ROOT

CONFTEST = """
from support import fairly, hold_up

class Measured(hold_up.Busy):
    share = {share}

def pytest_configure(config):
    config.addinivalue_line("markers", "realtime: by the wall clock")
    config.pluginmanager.register(fairly.Fairly(Measured))
"""
SUITE = """
import pytest

tries = {{"first": 0, "always": 0}}

{mark}
def test_fails_at_first(request):
    tries["first"] += 1
    assert tries["first"] > 1

{mark}
def test_fails_always():
    tries["always"] += 1
    assert False, f"try {{tries['always']}}"
"""
REALTIME = "@pytest.mark.realtime"


@pytest.mark.parametrize(
    ("share", "mark", "tries"),
    [(BUSY + 0.1, REALTIME, 3), (BUSY - 0.1, REALTIME, 1), (BUSY + 0.1, "", 1)],
    ids=["busy", "idle", "virtual time"],
)
def test_only_a_busy_machine_gives_another_try(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, share: float, mark: str, tries: int
) -> None:
    passed = int(tries > 1)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests"), str(ROOT)]))
    pytester.makeconftest(CONFTEST.format(share=share))
    pytester.makepyfile(SUITE.format(mark=mark))
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=passed, failed=2 - passed)
    result.stdout.fnmatch_lines([f"*AssertionError: try {tries}"])
    told = [line for line in result.outlines if "of the time a task waited" in line]
    assert len(told) == (3 if tries > 1 else 0), "each try that did not count is named"


def test_more_work_than_cores_is_measured() -> None:
    busy = Busy()
    spin = "import time; t = time.monotonic() + 0.7\nwhile time.monotonic() < t: pass"
    count = (os.cpu_count() or 1) + 2
    before_ns = waited_ns()
    children = [subprocess.Popen([sys.executable, "-c", spin]) for _ in range(count)]
    while any(child.poll() is None for child in children):
        sum(range(100_000))  # this process wants a core as well
    assert busy.excuses is PRESSURE.exists(), "without the kernel's account nothing is excused"
    assert (waited_ns() > before_ns) is Path("/proc/self/schedstat").exists()
