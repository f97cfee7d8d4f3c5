"""Run a large experiment on a Dask cluster of two local workers, and kill one of them half-way.

    PYTHONPATH=tests python -m campaign.cluster [--seeds 100] [--max-time 30]

It prints whether each run has exactly one result, the time with one and with two workers, and
figures to estimate the cost of a larger campaign. Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq

from support.cluster import Cluster
from support.processes import COMMAND, environment
from support.waiting import until
from tools.experiment.parts import FOLDER
from tools.experiment.store import LINES

ROOMS = ("case-1", "case-2", "columns", "empty", "l-room")
PLANNERS = ("paper", "u-shape")
SCALING_SEEDS = 6
"""Seeds of the two campaigns with one and with two workers."""
TINY_S = 1.0
"""Simulated time of a run whose cost is nearly only its start and its transfer, s."""


class Campaign(NamedTuple):
    """A finished campaign."""

    status: int
    rows: int
    """Number of rows of the Parquet dataset."""
    keys: int
    """Number of different runs in the rows."""
    first_s: float
    """Time from the start of the command to the first result, s."""
    rest_s: float
    """Time from the first result to the end of the command, s."""
    parquet_bytes: int
    json_bytes: int
    command_s: float
    """Processor time of the command after the first result, s."""
    scheduler_s: float
    """Processor time of the scheduler after the first result, s."""

    @property
    def runs_per_s(self) -> float:
        """Rate of the results after the first, 1/s."""
        return (self.rows - 1) / self.rest_s


def lines_in(out: Path) -> int:
    """Return the number of results so far."""
    path = out / LINES
    return path.read_bytes().count(b"\n") if path.exists() else 0


def campaign(
    out: Path, workers: int, seeds: int, max_time_s: float, *, kill: bool = False
) -> Campaign:
    """Run a campaign on a new cluster; ``kill`` a worker when half of the results are written."""
    expected = len(ROOMS) * len(PLANNERS) * seeds
    with Cluster(workers) as cluster, out.with_suffix(".log").open("w") as log:
        begun_s = time.perf_counter()
        process = subprocess.Popen(
            [
                *(*COMMAND, "experiment", "compare", "--rooms", ",".join(ROOMS)),
                *("--planners", ",".join(PLANNERS), "--seeds", str(seeds)),
                *("--max-time", str(max_time_s), "--scheduler", cluster.address),
                *("--out", str(out)),
            ],
            env=environment(),
            stdout=log,
            stderr=log,
        )
        wait_for(process, out, 1)
        first_s = time.perf_counter() - begun_s
        before = processor_s(process.pid), processor_s(cluster.scheduler)
        if kill:
            wait_for(process, out, expected // 2)
            os.kill(cluster.workers[0], signal.SIGKILL)
        wait_for(process, out, expected)
        rest_s = time.perf_counter() - begun_s - first_s
        after = processor_s(process.pid), processor_s(cluster.scheduler)
        process.wait()
    table = pq.read_table(out / FOLDER, columns=["key"])
    return Campaign(
        process.returncode,
        table.num_rows,
        len(set(table["key"].to_pylist())),
        first_s,
        rest_s,
        sum(path.stat().st_size for path in (out / FOLDER).iterdir()),
        (out / LINES).stat().st_size,
        after[0] - before[0],
        after[1] - before[1],
    )


def processor_s(pid: int) -> float:
    """Return the processor time that a process has used, s (Linux, proc_pid_stat(5))."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for(process: subprocess.Popen[bytes], out: Path, count: int) -> None:
    """Wait for a number of results or for the end of the process."""
    until(
        lambda: lines_in(out) >= count or process.poll() is not None,
        within_s=36_000.0,
        what=f"{count} results",
    )


def main() -> int:
    """Print the figures; return 1 if a run has no result or two results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--max-time", type=float, default=30.0)
    asked = parser.parse_args()
    expected = len(ROOMS) * len(PLANNERS) * asked.seeds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        large = campaign(folder / "large", 2, asked.seeds, asked.max_time, kill=True)
        print(
            f"{expected} runs, one of two workers killed after {expected // 2}:"
            f" exit status {large.status}, {large.rows} rows, {large.keys} different runs,"
            f" {large.first_s + large.rest_s:.0f} s"
        )
        one, two = (campaign(folder / f"{n}", n, SCALING_SEEDS, asked.max_time) for n in (1, 2))
        for label, found in (("1 worker", one), ("2 workers", two)):
            rate = found.runs_per_s
            print(f"{label}: first result after {found.first_s:.1f} s, then {rate:.2f} runs/s")
        print(f"2 workers are {two.runs_per_s / one.runs_per_s:.2f} times as fast as 1")
        tiny = campaign(folder / "tiny", 2, 2 * SCALING_SEEDS, TINY_S)
        print(f"runs of {TINY_S:g} simulated second, 2 workers: {tiny.runs_per_s:.1f} runs/s")
        rest = tiny.rows - 1
        print(
            f"processor time of a result: {1e3 * tiny.command_s / rest:.1f} ms in the command,"
            f" {1e3 * tiny.scheduler_s / rest:.1f} ms in the scheduler"
        )
        print(
            f"a result: {large.json_bytes / large.rows:.0f} bytes as JSON,"
            f" {large.parquet_bytes / large.rows:.0f} bytes in Parquet"
        )
    return 0 if (large.status, large.rows, large.keys) == (0, expected, expected) else 1


if __name__ == "__main__":
    sys.exit(main())
