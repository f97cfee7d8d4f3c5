"""Speed of a simulated run relative to real time: the whole process, with recording.

PYTHONPATH=tests python -m bench.simulate
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time


def main() -> None:
    """Run the command several times; print the ratio of simulated to real time."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=3)
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(options.parse_args().rounds):
            command = [sys.executable, "-m", "tools.sweepctl", "simulate", "case-1"]
            command += ["--planner", "paper", "--json", "--out", f"{folder}/{index}.mcap"]
            begun_s = time.perf_counter()
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            took_s = time.perf_counter() - begun_s
            if not done.stdout:
                raise SystemExit(done.stderr)
            simulated_s = json.loads(done.stdout)["duration_s"]
            ratios.append(simulated_s / took_s)
            print(f"simulated {simulated_s:.0f} s in {took_s:.1f} s: {ratios[-1]:.0f}x real time")
    print(f"median {statistics.median(ratios):.0f}x real time")


if __name__ == "__main__":
    main()
