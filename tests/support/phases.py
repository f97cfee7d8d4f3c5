"""Runs the tests in phases and adds the results; exits with 1 if a phase failed.

    PYTHONPATH=tests python -m support.phases test|check|nightly [pytest's options]

There are three phases. The first phase runs the tests in virtual time, on all cores. The second
phase runs the tests marked ``realtime``, a few in parallel. The third phase runs, one by one, the
tests marked ``alone`` and the tests without a verdict in the second phase. Each phase runs even if
an earlier phase failed. `make check` has only the first phase.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from support.needs import block

if TYPE_CHECKING:
    from collections.abc import Callable

OK, FAILED, INTERRUPTED, NO_TESTS = 0, 1, 2, 5
"""pytest's exit statuses."""


SLOW_S = 3.0
"""Minimum duration of a file that requires the mark ``slow``, s of one core. `make check` runs two
hundred shorter files in a minute and a half.
"""
WORKERS = 4
"""Number of real-time tests in parallel. Most of them wait, so four tests keep two cores busy."""


class Phase(NamedTuple):
    """One run of pytest."""

    title: str
    marks: str
    options: tuple[str, ...]
    files: Callable[[], list[str]] = list
    """Returns the files with the tests of the phase; an empty list means all files."""


def realtime_files() -> list[str]:
    """Return the files with real-time tests.

    Only these files are loaded, because each worker would need seconds to load all files.
    """
    return [
        str(path)
        for path in sorted(Path("tests").rglob("test_*.py"))
        if "conformance" in path.parts or "mark.realtime" in path.read_text(encoding="utf-8")
    ]


PUT_OFF = "{folder}/put-off"
"""File in which the second phase lists the tests that the third phase runs again."""
VIRTUAL = Phase(
    "tests in virtual time, on all cores",
    "not realtime",
    ("-n", "auto", "--dist=loadfile", "--no-loadscope-reorder"),
)
TOGETHER = Phase(
    f"tests in real time, {WORKERS} at a time",
    "realtime and not alone",
    ("-n", str(WORKERS), "--dist=loadscope", f"--put-off={PUT_OFF}"),
    realtime_files,
)
ALONE = Phase("tests in real time, one by one", "realtime", (f"--alone={PUT_OFF}",), realtime_files)
SELECTIONS = {
    "check": ("not slow and not nightly", (VIRTUAL,)),
    "test": ("not nightly", (VIRTUAL, TOGETHER, ALONE)),
    "nightly": ("nightly", (VIRTUAL, TOGETHER, ALONE)),
}
"""Marks and phases of each target of the Makefile."""


class Totals:
    """Sums of the counts of all phases."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.not_run: Counter[tuple[str, ...]] = Counter()
        self.broken: list[str] = []
        """Phases that ended without a count, each with its exit status."""
        self.seconds: dict[str, float] = {}
        self.failed = False

    def add(self, title: str, status: int, results: Path) -> None:
        """Add the counts of one phase."""
        self.failed |= status not in {OK, NO_TESTS}
        try:
            counted = json.loads(results.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            counted = None
        if counted is None or status not in {OK, FAILED, NO_TESTS}:
            self.broken.append(f"{title}: ended with status {status}")
        if counted is not None:
            self.not_run += Counter({tuple(names): n for names, n in counted.pop("not_run")})
            self.seconds |= counted.pop("seconds")
            self.counts += Counter(counted)

    def lines(self) -> list[str]:
        """Return the lines of the final summary."""
        counts = (f"{self.counts[name]} {name}" for name in ("passed", "failed", "skipped"))
        return [*block(self.not_run), "", *self.broken, ", ".join(counts)]


def unmarked(seconds: dict[str, float]) -> list[str]:
    """Return advice on slow files of `make check`.

    It is only advice, because the machine may be busy.
    """
    by_time = sorted(seconds.items(), key=lambda item: -item[1])
    found = [f"  {took:5.1f} s  {name}" for name, took in by_time if took > SLOW_S]
    return [f"above {SLOW_S:g} s, and without the mark slow:", *found] if found else []


def main(arguments: list[str]) -> int:
    """Run the phases; return 1 if one failed."""
    name, *options = arguments
    selection, phases = SELECTIONS[name]
    totals = Totals()
    with tempfile.TemporaryDirectory() as folder:
        Path(PUT_OFF.format(folder=folder)).touch()
        for number, phase in enumerate(phases):
            print(f"== {phase.title}", flush=True)
            results = Path(folder, f"{number}.json")
            marks = f"{selection} and {phase.marks}"
            own = [option.format(folder=folder) for option in phase.options]
            pytest = [sys.executable, "-m", "pytest", "-q", "-m", marks, f"--results={results}"]
            command = [*pytest, *own, *options, *phase.files()]
            status = subprocess.run(command, check=False).returncode
            totals.add(phase.title, status, results)
            if status == INTERRUPTED:
                break
    if name == "check":
        print("\n".join(unmarked(totals.seconds)))
    print("\n".join(totals.lines()))
    return FAILED if totals.failed else OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
