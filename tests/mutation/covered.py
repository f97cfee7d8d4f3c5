"""Branch coverage of the safety code by its own fast tests; exits with 1 below the gate.

    PYTHONPATH=tests python -m mutation.covered

``mutation.targets`` defines the modules, their tests and the gate of each. A mutant in code that no
test reaches cannot be killed, so this check comes before the mutants.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from mutation.targets import TARGETS, Target
from support.root import ROOT


class Covered(NamedTuple):
    """One module's coverage."""

    target: Target
    percent: float
    """Coverage of its lines and branches, percent."""
    missing: list[int]
    """Lines that no test runs, and lines from which an untaken branch starts."""

    @property
    def holds(self) -> bool:
        """Return whether the coverage, rounded to 0.01 %, reaches the gate."""
        return round(self.percent, 2) >= self.target.covered


def measure(targets: tuple[Target, ...], root: Path = ROOT) -> list[Covered]:
    """Run the tests of the targets once, all together.

    Raises:
        subprocess.CalledProcessError: a test fails.

    """
    tests = sorted({test for target in targets for test in target.tests})
    with tempfile.TemporaryDirectory() as folder:
        data, report = Path(folder, "data"), Path(folder, "report.json")
        coverage = [sys.executable, "-m", "coverage"]
        include = ",".join(str(root / target.relative) for target in targets)
        options = ["--branch", f"--data-file={data}", f"--include={include}"]
        pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        subprocess.run([*coverage, "run", *options, *pytest], cwd=root, check=True)
        written = [*coverage, "json", "-q", f"--data-file={data}", "-o", str(report)]
        subprocess.run(written, cwd=root, check=True)
        files = json.loads(report.read_text(encoding="utf-8"))["files"]
    found = []
    for target in targets:
        file = files.get(target.relative.as_posix())
        if file is None:
            found.append(Covered(target, 0.0, []))
            continue
        lines = {*file["missing_lines"], *(abs(source) for source, _ in file["missing_branches"])}
        found.append(Covered(target, file["summary"]["percent_covered"], sorted(lines)))
    return found


def main() -> int:
    """Measure, print a line for each module, and compare with the gate."""
    found = measure(TARGETS)
    for one in found:
        verdict = "" if one.holds else f"  BELOW THE GATE of {one.target.covered:g} %"
        lines = f"  lines {', '.join(map(str, one.missing))}" if one.missing else ""
        print(f"{one.percent:6.2f} %  {one.target.relative}{verdict}{lines}")
    return 0 if all(one.holds for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
