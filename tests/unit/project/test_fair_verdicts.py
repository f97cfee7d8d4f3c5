"""A failed real-time test runs again only if the machine was busy."""

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

def pytest_addoption(parser):
    fairly.add_options(parser)

def pytest_configure(config):
    config.addinivalue_line("markers", "realtime: by the wall clock")
    config.addinivalue_line("markers", "alone(reason): beside nothing else")
    fairly.configure(config, Measured)
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
PARALLEL = """
import os
import pytest

pytestmark = pytest.mark.realtime

@pytest.fixture(scope="module")
def shared():
    with open("made", "a") as file:
        print(os.getpid(), file=file)

@pytest.mark.parametrize("number", range(6))
def test_has_a_share(shared, number):
    pass

def test_wrong():
    assert False

def test_starved():
    assert "PYTEST_XDIST_WORKER" not in os.environ

@pytest.fixture(scope="module")
def starved():
    assert "PYTEST_XDIST_WORKER" not in os.environ

def test_is_set_up_late(starved):
    pass

def test_right():
    pass

@pytest.mark.alone("why")
def test_alone():
    assert "PYTEST_XDIST_WORKER" not in os.environ
"""


@pytest.fixture(autouse=True)
def _our_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests"), str(ROOT)]))
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)


@pytest.mark.parametrize(
    ("share", "mark", "tries"),
    [(BUSY + 0.1, REALTIME, 3), (BUSY - 0.1, REALTIME, 1), (BUSY + 0.1, "", 1)],
    ids=["busy", "idle", "virtual time"],
)
def test_only_a_busy_machine_gives_another_try(
    pytester: pytest.Pytester, share: float, mark: str, tries: int
) -> None:
    passed = int(tries > 1)
    pytester.makeconftest(CONFTEST.format(share=share))
    pytester.makepyfile(SUITE.format(mark=mark))
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=passed, failed=2 - passed)
    result.stdout.fnmatch_lines([f"*AssertionError: try {tries}"])
    reported = [line for line in result.outlines if "of the time a task waited" in line]
    assert len(reported) == (3 if tries > 1 else 0), "each ignored try is reported"


@pytest.mark.parametrize("share", [BUSY + 0.1, BUSY - 0.1], ids=["busy", "idle"])
def test_a_failure_beside_others_on_a_busy_machine_is_repeated_alone(
    pytester: pytest.Pytester, share: float
) -> None:
    pytester.makeconftest(CONFTEST.format(share=share))
    pytester.makepyfile(PARALLEL)
    options = ("-p", "no:cacheprovider")
    together = ("-n2", "--dist=loadscope", "--put-off=put-off", "-m", "not alone")
    first = pytester.runpytest_subprocess(*options, *together)
    busy = share > BUSY
    first.assert_outcomes(passed=7, failed=0 if busy else 2, errors=0 if busy else 1)
    assert first.ret == (0 if busy else 1)
    made = Path("made").read_text(encoding="ascii")
    assert len(made.splitlines()) == 1, "all tests of a shared fixture run in one worker"
    second = pytester.runpytest_subprocess(*options, "--alone=put-off")
    if not busy:
        second.assert_outcomes(passed=1, deselected=10)
        return
    first.stdout.fnmatch_lines(["*test_wrong: 40 % of the time a task waited; *assert False*"])
    second.assert_outcomes(passed=3, failed=1, deselected=7)
    second.stdout.fnmatch_lines(["FAILED *::test_wrong*"])


def test_more_work_than_cores_is_measured() -> None:
    busy = Busy()
    spin = "import time; t = time.monotonic() + 0.7\nwhile time.monotonic() < t: pass"
    count = (os.cpu_count() or 1) + 2
    before_ns = waited_ns()
    children = [subprocess.Popen([sys.executable, "-c", spin]) for _ in range(count)]
    while any(child.poll() is None for child in children):
        sum(range(100_000))  # this process uses a core as well
    assert busy.excuses is PRESSURE.exists(), "only the kernel's pressure file excuses a failure"
    assert (waited_ns() > before_ns) is Path("/proc/self/schedstat").exists()
