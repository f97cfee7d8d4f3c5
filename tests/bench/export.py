"""Messages per second that ``sweepctl export`` writes, compared with Rerun's own reader.

``python -m bench.export [FILE]`` exports a log, or ten minutes of a synthetic run. It measures CPU
time, which a busy machine changes little.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from bridge.convert.export import export
from bridge.record.log_writer import RunWriter
from support.synthetic_run import EPOCH_NS, run_info, synthetic_run

ROUNDS = 3
TIMES = 10
"""Number of repetitions of the synthetic run, which takes a minute."""


def made(path: Path) -> Path:
    """Write a log that repeats the synthetic run."""
    records = list(synthetic_run())
    span_ns = records[-1].log_ns - EPOCH_NS + 20_000_000
    writer = RunWriter(path, run_info())
    for turn in range(TIMES):
        for record in records:
            writer.write(record._replace(log_ns=record.log_ns + turn * span_ns))
    writer.close()
    return path


def rerun_rate(path: Path, messages: int) -> float:
    """Return the messages per second of CPU with which Rerun's reader reads a log."""
    from rerun.chunk import McapReader  # noqa: PLC0415 - loaded for this line of the table

    best = 0.0
    for _ in range(ROUNDS):
        begun = time.process_time()
        for _chunk in McapReader(str(path)).stream():
            pass
        best = max(best, messages / (time.process_time() - begun))
    return best


def rate(path: Path, folder: Path, file_format: str) -> tuple[float, float, int]:
    """Return the messages per second of CPU and of wall-clock time, the best of some rounds."""
    best = wall = 0.0
    messages = 0
    for _ in range(ROUNDS):
        cpu, begun = time.process_time(), time.perf_counter()
        messages = export(path, folder, file_format=file_format, force=True).messages
        best = max(best, messages / (time.process_time() - cpu))
        wall = max(wall, messages / (time.perf_counter() - begun))
    return best, wall, messages


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        path = Path(sys.argv[1]) if len(sys.argv) > 1 else made(place / "run.mcap")
        messages = 0
        for file_format in ("parquet", "csv"):
            cpu, wall, messages = rate(path, place / file_format, file_format)
            print(f"{file_format:<8}{cpu:>12,.0f} /s of CPU{wall:>12,.0f} /s by the clock")
        print(f"{'McapReader':<8}{rerun_rate(path, messages):>10,.0f} /s of CPU (reading alone)")
        print(f"{messages} messages, {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
