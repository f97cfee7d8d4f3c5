"""Consistency of the pose's covariance: NEES of whole runs, by room and noise.

    PYTHONPATH=tests python -m bench.consistency

The ideal value is 3 for x, y and yaw together, and 1 for the yaw alone. Below the ideal value the
filter is conservative, above it over-confident. Each run counts as one value; ± is the 95 %
interval from the spread between runs. The same seeds give the same table.
"""

from __future__ import annotations

import argparse
import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from support.estimate_errors import anees, estimate_errors, share_inside, yaw_anees
from tools.experiment.trials import room_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from support.estimate_errors import Reported

ROOMS = ("case-1", "case-2", "generated:columns:3")
LEVELS = ("typical", "harsh")


def row(room: str, noise: str, runs: Sequence[Sequence[Reported]]) -> str:
    """Return one line of the table."""
    reported = [sample for run in runs for sample in run]
    error = np.sqrt(np.mean([t.error**2 for t in reported], axis=0))
    sigma = np.sqrt(np.mean([np.diag(t.covariance) for t in reported], axis=0))
    place = f"{1000 * math.hypot(*error[:2]):.0f} of {1000 * math.hypot(*sigma[:2]):.0f} mm"
    yaw = f"{math.degrees(error[2]):.2f} of {math.degrees(sigma[2]):.2f}°"
    return (
        f"| {room} | {noise} | {len(runs)}, {len(reported)} | {anees(runs)} | {yaw_anees(runs)} | "
        f"{100 * share_inside(runs):.0f} % | {place} | {yaw} |"
    )


def main() -> None:
    """Run each room at each level and print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rooms", default=",".join(ROOMS))
    options.add_argument("--noise", default=",".join(LEVELS))
    options.add_argument("--seeds", type=int, default=12, help="2 or more")
    options.add_argument("--planner", default="recovery")
    given = options.parse_args()
    if given.seeds < 2:
        options.error("--seeds must be 2 or more")
    print(
        "| room | noise | runs, samples | NEES (3) | yaw (1) | in 95 % | place, of σ | yaw, of σ |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for room, noise in itertools.product(given.rooms.split(","), given.noise.split(",")):
        plan = room_of(room)
        runs = [
            estimate_errors(plan, noise, seed, planner=given.planner) for seed in range(given.seeds)
        ]
        print(row(room, noise, runs), flush=True)


if __name__ == "__main__":
    main()
