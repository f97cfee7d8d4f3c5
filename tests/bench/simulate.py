"""Speed of a simulated run relative to real time: the whole process, with recording.

    PYTHONPATH=tests python -m bench.simulate

The budget, 75 times real time, is for a machine that makes ten million additions in a Python loop
in 0.7 s. Each round times that loop too; the last line has the speed on such a machine.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time

REFERENCE_S = 0.7
"""Time of the loop on the machine of the budget, s."""


def additions_s() -> float:
    """Time of ten million additions in a loop of a module, s."""
    begun_s = time.perf_counter()
    exec("total = 0\nfor each in range(10_000_000):\n    total += each", {})  # noqa: S102 - a module's names are slower than a function's
    return time.perf_counter() - begun_s


def main() -> None:
    """Run the command several times; print the ratio of simulated to real time."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--planner", default="recovery")
    asked = options.parse_args()
    ratios, loops_s = [], []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(asked.rounds):
            command = [sys.executable, "-m", "tools.sweepctl", "simulate", "case-1"]
            command += ["--planner", asked.planner, "--json", "--out", f"{folder}/{index}.mcap"]
            begun_s = time.perf_counter()
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            took_s = time.perf_counter() - begun_s
            if not done.stdout:
                raise SystemExit(done.stderr)
            simulated_s = json.loads(done.stdout)["duration_s"]
            ratios.append(simulated_s / took_s)
            print(f"simulated {simulated_s:.0f} s in {took_s:.1f} s: {ratios[-1]:.0f}x real time")
            loops_s.append(additions_s())
    ratio, loop_s = statistics.median(ratios), statistics.median(loops_s)
    print(f"median {ratio:.0f}x real time; ten million additions in {loop_s:.2f} s")
    print(f"on the machine of the budget: {ratio * loop_s / REFERENCE_S:.0f}x")


if __name__ == "__main__":
    main()
