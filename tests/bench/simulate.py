"""Speed of a simulated run relative to real time: the whole process, with recording.

    PYTHONPATH=tests python -m bench.simulate
    PYTHONPATH=tests python -m bench.simulate --target python --target core --target library

Several targets are measured in turn: the firmware's model in Python, the C core in the simulator's
process, and the core as a library in a process of its own.

The budget of 75 times real time is for a machine that makes ten million additions in a Python loop
in 0.7 s. Each round also times that loop. The last line has the speed on such a machine.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from support.core_build import LIBRARY, library

REFERENCE_S = 0.7
"""Time of the loop on the machine of the budget, s."""


def additions_s() -> float:
    """Return the time of ten million additions in a loop at module level, s."""
    begun_s = time.perf_counter()
    exec("total = 0\nfor each in range(10_000_000):\n    total += each", {})  # noqa: S102 - a module's names are slower than a function's
    return time.perf_counter() - begun_s


def ratio_of(target: str, planner: str, log: Path) -> float:
    """Return simulated over real time of one run; ``library`` is the core in its own process."""
    command = [sys.executable, "-m", "tools.sweepctl", "simulate", "case-1", "--force"]
    command += ["--planner", planner, "--json", "--out", str(log)]
    if target == "library":
        command += ["--target", "core", "--firmware", str(library(*LIBRARY, optimised=True))]
    else:
        command += ["--target", target]
    begun_s = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    took_s = time.perf_counter() - begun_s
    if not done.stdout:
        raise SystemExit(done.stderr)
    simulated_s: float = json.loads(done.stdout)["duration_s"]
    return simulated_s / took_s


def main() -> None:
    """Run the command several times; print the ratio of simulated to real time."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--planner", default="recovery")
    options.add_argument("--target", action="append", choices=["python", "core", "library"])
    asked = options.parse_args()
    targets = asked.target or ["python"]
    ratios: dict[str, list[float]] = {target: [] for target in targets}
    loops_s = []
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "run.mcap")
        for target in targets * asked.rounds:
            ratios[target].append(ratio_of(target, asked.planner, log))
            print(f"{target}: {ratios[target][-1]:.0f}x real time")
            loops_s.append(additions_s())
    loop_s = statistics.median(loops_s)
    print(f"ten million additions in {loop_s:.2f} s")
    for target, measured in ratios.items():
        ratio = statistics.median(measured)
        of_budget = ratio * loop_s / REFERENCE_S
        print(
            f"{target}: median {ratio:.0f}x real time; "
            f"on the machine of the budget: {of_budget:.0f}x"
        )


if __name__ == "__main__":
    main()
