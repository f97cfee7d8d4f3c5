"""Memory of a simulated run of one hour with recording: it must not grow with the run.

PYTHONPATH=tests python -m bench.memory
"""

from __future__ import annotations

import argparse
import random
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.config import load_robot
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.runner import PlanRunner
from bridge.record.log_writer import RunWriter
from bridge.session.records import RunInfo
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from bridge.run.host import Host

_EVERY_S = 600.0


def resident_mb() -> float:
    """Return the memory that this process uses now, shared libraries included, MB (Linux)."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return int(line.split()[1]) / 1024.0


def main() -> None:
    """Drive at random for the given time, and print the memory every ten minutes."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--seconds", type=float, default=3600.0, help="simulated")
    seconds = options.parse_args().seconds
    plan = load_room("case-1")
    model, robot_toml = load_robot(None)
    clock_ns = EPOCH_NS - HOST_BOOT_NS
    info = RunInfo("virtual", "random", 0, "bench", EPOCH_NS, clock_ns, model, robot_toml, plan)
    used: list[tuple[float, float]] = []

    def watch(time_s: float, _host: Host) -> None:
        # The first minute still imports, compiles and fills bounded buffers.
        if time_s >= 60.0 and (not used or time_s - used[-1][0] >= _EVERY_S):
            used.append((time_s, resident_mb()))
            print(f"after {time_s:5.0f} simulated seconds: {used[-1][1]:6.1f} MB")

    with tempfile.TemporaryDirectory() as folder:
        writer = RunWriter(Path(folder) / "run.mcap", info)
        # By default the random planner ends after half an hour.
        planner = RandomPlanner(model, random.Random(0), RandomOptions(max_time_s=seconds))
        runner, max_s = PlanRunner(planner, model), 2.0 * seconds
        run = run_virtual(
            plan, model, "random", writer, progress=watch, runner=runner, max_time_s=max_s
        )
        ending = run.host.mission.ending
        writer.close()
    (first_s, first_mb), last_mb = used[0], resident_mb()
    driven_s = run.device.plant.tick_ms / 1000.0 - first_s
    growth_mb = (last_mb - first_mb) * 3600.0 / driven_s
    print(f"after {first_s + driven_s:5.0f} simulated seconds: {last_mb:6.1f} MB")
    print(f"growth {growth_mb:.1f} MB a simulated hour, driving")
    print(f"the run's end: {ending.reason if ending else 'none'}")


if __name__ == "__main__":
    main()
