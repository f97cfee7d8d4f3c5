"""Simulate a day of work with random faults in one process; check the memory and the logs.

    PYTHONPATH=tests python -m soak.day --hours 24

One run follows another, each with its own faults (:mod:`soak.faults`), until the simulated hours
have passed. The memory is measured after each run; steady growth is a leak.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import threading
import time
from pathlib import Path

from soak.faults import run

WARM = 0.15
"""Share of the day in which the caches fill."""
GROWTH_MB = 24.0
"""Maximum growth of the memory after that share of the day, MB."""


def resident_mb() -> float:
    """Return the memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    """Work for a day, or until Ctrl-C."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--seed", type=int, default=10_000)
    parser.add_argument("--longest-s", type=float, default=600.0, help="of one run")
    options = parser.parse_args()
    seed, bad = options.seed, 0
    begun_s = time.process_time()
    curve = [(0.0, resident_mb())]
    threads, files = threading.active_count(), open_files()
    try:
        while curve[-1][0] < options.hours:
            result = run(seed, max_s=options.longest_s)
            seed += 1
            for what in result.bad:
                bad += 1
                print(f"seed {result.seed}, {' '.join(result.faults)}: {what}", flush=True)
            gc.collect()
            hours = curve[-1][0] + max(result.simulated_s, 1.0) / 3600.0
            if int(hours) > int(curve[-1][0]):
                print(
                    f"hour {int(hours)}, {seed - options.seed} runs, {resident_mb():.0f} MB, "
                    f"{len(gc.get_objects())} objects"
                )
                sys.stdout.flush()
            curve.append((hours, resident_mb()))
    except KeyboardInterrupt:
        print(f"ended early, at {curve[-1][0]:.1f} of {options.hours:g} hours")
    warm = next(mb for hours, mb in curve if hours >= WARM * curve[-1][0])
    grown = curve[-1][1] - warm
    print(
        f"{curve[-1][0]:.1f} simulated hours in {seed - options.seed} runs, "
        f"{time.process_time() - begun_s:.0f} s of processor time, {bad} findings"
    )
    print(f"memory {warm:.0f} MB once warm, {curve[-1][1]:.0f} MB at the end: {grown:+.1f} MB")
    left = threading.active_count() - threads, open_files() - files
    print(f"threads and files left open: {left[0]}, {left[1]}")
    whole = curve[-1][0] >= options.hours
    return 0 if whole and not bad and grown <= GROWTH_MB and not any(left) else 1


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


if __name__ == "__main__":
    sys.exit(main())
