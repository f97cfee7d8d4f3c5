"""Small logs of artificial runs, for tests of the library of runs."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bridge.record.log_writer import RunWriter
from support.synthetic_run import EPOCH_NS, run_info, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path

RECORDS = 30
COVERAGES = ("mouth_sweepable", "mouth_free", "body_reachable", "body_free", "eq8")


def write_log(  # noqa: PLR0913 - the columns of a list of runs
    path: Path,
    *,
    seed: int = 0,
    planner: str = "paper",
    coverage: float | None = 0.9,
    at_s: int = 0,
    port: str = "memory",
    records: int = RECORDS,
    ends: bool = True,
    extra: dict[str, str] | None = None,
) -> Path:
    """Write the log of an artificial run that began ``at_s`` seconds after ``EPOCH_NS``."""
    info = replace(
        run_info(),
        seed=seed,
        planner=planner,
        port=port,
        opened_unix_ns=EPOCH_NS + at_s * 1_000_000_000,
        extra=extra or {},
    )
    writer = RunWriter(path, info)
    for record in itertools.islice(synthetic_run(), records):
        writer.write(record)
    writer.close(summary_of(planner, seed, coverage) if ends else None)
    return path


def summary_of(planner: str, seed: int, coverage: float | None) -> dict[str, Any]:
    """Return the final summary of an artificial run."""
    return {
        "room": "synthetic",
        "planner": planner,
        "seed": seed,
        "outcome": "complete",
        "reason": "all done",
        "duration_s": 100.0 + seed,
        "path_m": 20.0,
        "turns": 12,
        "collisions": seed % 3,
        "contact_s": 0.5,
        "energy_wh": 0.25,
        "t90_s": 80.0,
        "t99_s": None,
        "largest_hole_cm2": 40.0,
        "hole_inradius_m": 0.02,
        "repeat_ratio": 0.1,
        "pose_error_m": {"end": 0.01, "max": 0.02},
        "coverage": dict.fromkeys(COVERAGES, coverage),
        "wire": {
            "frames": {"rx": 10, "tx": 5},
            "bytes": {"rx": 100, "tx": 50},
            "lost": 2,
            "crc_errors": 1,
        },
        "events": {"supervise": 3, "device_faults": 1},
        "log": None,
    }
