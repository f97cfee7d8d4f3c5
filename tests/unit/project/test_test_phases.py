"""The test runner runs all phases of the tests and adds up their results."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

CONFTEST = """
from support import fairly, hold_up, needs

def pytest_addoption(parser):
    fairly.add_options(parser)
    needs.add_options(parser)

def pytest_configure(config):
    fairly.configure(config, Measured)
    needs.configure(config)
    for name in ("alone", "nightly", "realtime", "slow"):
        config.addinivalue_line("markers", name)

class Measured(hold_up.Busy):
    share = {share}
"""
QUICK = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": "xdist.plugin"}
"""Environment without other plugins, to save time: each run starts pytest three times."""
PASSES, FAILS, BREAKS = "assert True", "assert False", "import os; os._exit(3)"
FAILS_BESIDE_OTHERS = "import sys; assert '--alone' in ' '.join(sys.argv)"


def run(
    folder: Path, virtual: str, real: str, selection: str = "test", share: float = 0.0
) -> tuple[int, str]:
    """Run the phases on a suite with one test of each kind; return exit status and output."""
    (folder / "conftest.py").write_text(CONFTEST.format(share=share), encoding="utf-8")
    (folder / "tests").mkdir()
    (folder / "tests" / "test_them.py").write_text(
        "import pytest\n"
        f"def test_virtual():\n    {virtual}\n"
        f"@pytest.mark.realtime\ndef test_real():\n    {real}\n"
        "@pytest.mark.nightly\ndef test_nightly():\n    assert False\n"
        "@pytest.mark.slow\ndef test_slow():\n    assert True\n"
        '@pytest.mark.realtime\n@pytest.mark.skip(reason="why")\ndef test_skipped(): ...\n',
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "support.phases", selection, "-p", "no:cacheprovider", "-n0"],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), str(ROOT)]),
            **QUICK,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


@pytest.mark.parametrize(
    ("virtual", "real", "status", "closing"),
    [
        (PASSES, PASSES, 0, "3 passed, 0 failed, 1 skipped"),
        (FAILS, PASSES, 1, "2 passed, 1 failed, 1 skipped"),
        (PASSES, FAILS, 1, "2 passed, 1 failed, 1 skipped"),
        (FAILS, FAILS, 1, "1 passed, 2 failed, 1 skipped"),
    ],
)
def test_all_run_and_are_added_up(
    tmp_path: Path, virtual: str, real: str, status: int, closing: str
) -> None:
    ended, printed = run(tmp_path, virtual, real)
    assert ended == status, printed
    assert printed.splitlines()[-1] == closing


def test_a_phase_that_breaks_off_is_named_and_fails_the_run(tmp_path: Path) -> None:
    ended, printed = run(tmp_path, PASSES, BREAKS)
    assert ended == 1
    assert printed.splitlines()[-2:] == [
        "tests in real time, 4 at a time: ended with status 3",
        "2 passed, 0 failed, 0 skipped",
    ]


@pytest.mark.parametrize(
    ("real", "status", "closing"),
    [
        (FAILS_BESIDE_OTHERS, 0, "3 passed, 0 failed, 1 skipped"),
        (FAILS, 1, "2 passed, 1 failed, 1 skipped"),
    ],
)
def test_a_failure_on_a_busy_machine_is_run_again_alone_and_counted_once(
    tmp_path: Path, real: str, status: int, closing: str
) -> None:
    ended, printed = run(tmp_path, PASSES, real, share=1.0)
    assert ended == status, printed
    assert printed.splitlines()[-1] == closing


@pytest.mark.parametrize(
    ("selection", "status", "closing"),
    [
        ("check", 0, "1 passed, 0 failed, 0 skipped"),
        ("nightly", 1, "0 passed, 1 failed, 0 skipped"),
    ],
)
def test_each_target_has_its_marks(
    tmp_path: Path, selection: str, status: int, closing: str
) -> None:
    ended, printed = run(tmp_path, PASSES, FAILS, selection)
    assert ended == status, printed
    assert printed.splitlines()[-1] == closing
