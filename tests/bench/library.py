"""Time that ``sweepctl runs`` needs to list a library of 10 000 logs and to make its index.

``python -m bench.library [COUNT]`` makes small synthetic logs in a temporary folder. It compares
the time of the index with the time to read the same bytes. The listing is the whole command,
including the start of Python. CPU time is shown beside wall-clock time, because a busy machine
changes it little.
"""

from __future__ import annotations

import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bridge.library.library import Library
from bridge.record.log_writer import RunWriter
from support.processes import COMMAND, environment
from support.synthetic_run import run_info, summary, synthetic_run

if TYPE_CHECKING:
    from collections.abc import Callable

COUNT, ROUNDS = 10_000, 5
RECORDS = 40
"""Number of records in a log. With its attachments, a log has 60 kB."""
PLANNERS = ("recovery", "paper", "u-shape", "random")


def make_logs(folder: Path, count: int) -> int:
    """Write ``count`` logs; return their size, bytes."""
    records = list(itertools.islice(synthetic_run(), RECORDS))
    size = 0
    for number in range(count):
        path = folder / f"20260101T000000Z-{number:05d}.mcap"
        planner = PLANNERS[number % len(PLANNERS)]
        opened_ns = run_info().opened_unix_ns + number * 1_000_000_000
        info = replace(run_info(), seed=number, planner=planner, opened_unix_ns=opened_ns)
        writer = RunWriter(path, info, force=True)
        for record in records:
            writer.write(record)
        found = {"mouth_sweepable": 0.8 + number % 200 / 1000}
        writer.close({**summary(), "planner": planner, "seed": number, "coverage": found})
        size += path.stat().st_size
    return size


class Took(NamedTuple):
    """Duration of a piece of work, s."""

    cpu: float
    wall: float

    def text(self) -> str:
        """Return both times for a line of the table."""
        return f"{self.cpu:8.3f} s of CPU{self.wall:9.3f} s by the clock"


def took(work: Callable[[], object], rounds: int = 1) -> Took:
    """Repeat a piece of work; return the medians, including the time of child processes."""
    spent = []
    for _ in range(rounds):
        before, begun = os.times(), time.perf_counter()
        work()
        wall, after = time.perf_counter() - begun, os.times()
        spent.append(Took(sum(after[:4]) - sum(before[:4]), wall))
    return Took(*(statistics.median(column) for column in zip(*spent, strict=True)))


def read_all(folder: Path) -> None:
    """Read each byte of each log."""
    for path in sorted(folder.glob("*.mcap")):
        path.read_bytes()


def refresh(folder: Path) -> None:
    """Update the index and load it."""
    Library([folder]).refresh()


def command(folder: Path, *options: str) -> None:
    """Run the whole command."""
    subprocess.run(
        [*COMMAND, "runs", str(folder), *options],
        env=environment(),
        stdout=subprocess.DEVNULL,
        check=True,
    )


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    where = "coverage > 0.9 AND planner = 'paper'"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = make_logs(folder, count)
        print(f"{count} logs, {size / 1e6:.0f} MB")
        rows = {
            "reading all bytes": took(lambda: read_all(folder), ROUNDS),
            "first index": took(lambda: refresh(folder)),
            "nothing new": took(lambda: refresh(folder), ROUNDS),
            "runs": took(lambda: command(folder), ROUNDS),
            "runs --json": took(lambda: command(folder, "--json"), ROUNDS),
            "runs --where": took(lambda: command(folder, "--where", where), ROUNDS),
            "runs --last 20": took(lambda: command(folder, "--last", "20"), ROUNDS),
        }
        make_logs(folder, 1)
        rows["one log changed"] = took(lambda: refresh(folder))
    for label, spent in rows.items():
        print(f"{label:<18}{spent.text()}")
    first = rows["first index"]
    print(f"first index: {1e3 * first.cpu / count:.3f} ms of CPU a log")


if __name__ == "__main__":
    main()
