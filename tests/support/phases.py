"""Runs the tests in two phases and adds their results up: exit 1 where either has failed.

    PYTHONPATH=tests python -m support.phases SELECTION [pytest's options]

SELECTION is an expression of marks. First what lives in virtual time, on all cores; then what is
marked ``realtime``, one by one, even if the first phase failed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from support.needs import block

OK, FAILED, INTERRUPTED, NO_TESTS = 0, 1, 2, 5
"""pytest's exit statuses."""


class Phase(NamedTuple):
    """One run of pytest."""

    title: str
    marks: str
    options: tuple[str, ...]


PHASES = (
    Phase("tests in virtual time, on all cores", "not realtime", ("-n", "auto", "--dist=loadfile")),
    Phase("tests in real time, one by one", "realtime", ()),
)


class Totals:
    """What the phases have counted."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.not_run: Counter[tuple[str, ...]] = Counter()
        self.broken: list[str] = []
        """Phases that ended without a count of their own, each with its exit status."""
        self.failed = False

    def add(self, title: str, status: int, results: Path) -> None:
        """Add one phase."""
        self.failed |= status not in {OK, NO_TESTS}
        try:
            counted = json.loads(results.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            counted = None
        if counted is None or status not in {OK, FAILED, NO_TESTS}:
            self.broken.append(f"{title}: ended with status {status}")
        if counted is not None:
            self.not_run += Counter({tuple(names): n for names, n in counted.pop("not_run")})
            self.counts += Counter(counted)

    def lines(self) -> list[str]:
        """The closing lines."""
        counts = (f"{self.counts[name]} {name}" for name in ("passed", "failed", "skipped"))
        return [*block(self.not_run), "", *self.broken, ", ".join(counts)]


def main(arguments: list[str]) -> int:
    """Run both phases; 1 where either failed."""
    selection, *options = arguments
    totals = Totals()
    with tempfile.TemporaryDirectory() as folder:
        for number, phase in enumerate(PHASES):
            print(f"== {phase.title}", flush=True)
            results = Path(folder, f"{number}.json")
            marks = f"({selection}) and ({phase.marks})" if selection else phase.marks
            pytest = [sys.executable, "-m", "pytest", "-q", "-m", marks, f"--results={results}"]
            status = subprocess.run([*pytest, *phase.options, *options], check=False).returncode
            totals.add(phase.title, status, results)
            if status == INTERRUPTED:
                break
    print("\n".join(totals.lines()))
    return FAILED if totals.failed else OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
