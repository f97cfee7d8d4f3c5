"""Compile what is compiled, once: ``python -m tools.dev.warm``, as installation does.

The kernels are compiled at their first call and kept beside their modules. A short simulated
run over every kind of floor calls each of them, so that nobody's first run waits for it.
"""

from __future__ import annotations

import time  # noqa: TID251 - says how long it took
from typing import TYPE_CHECKING

from tools.cli.console import flush, write_line

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.compiled import Kernel

_SIMULATED_S = {"paper": 20.0, "recovery": 120.0}
"""The robot stands for the gyro's sake at first; the recovery planner then needs some decisions."""


def room() -> FloorPlan:
    """A room with one of everything that a kernel deals with, within the first metre."""
    from bridge.floor_plan.floor_plan import Carpet, FloorPlan, Threshold
    from bridge.motion.geometry import Pose2

    def box(low: float, high: float) -> tuple[tuple[float, float], ...]:
        return (low, low), (high, low), (high, high), (low, high)

    return FloorPlan(
        "warm",
        box(0.0, 1.5),
        (box(1.3, 1.4),),
        Pose2(0.3, 0.3, 0.0),
        (Carpet(box(0.0, 0.6)),),
        (Threshold((0.7, 0.0), (0.7, 1.5), 0.003),),
    )


def warm() -> None:
    """Call every kernel."""
    from bridge.config import load_robot
    from bridge.coverage.recovery.rehearse import rehearse as rehearse_recovery
    from bridge.record.records_kernel import rehearse as rehearse_export
    from bridge.record.sink import NullSink
    from tools.virtual.run import run_virtual
    from tools.virtual.summary import summarise

    plan, (model, _) = room(), load_robot(None)
    rehearse_export()
    rehearse_recovery(model)
    for planner, time_s in _SIMULATED_S.items():
        run = run_virtual(plan, model, planner, NullSink(), max_time_s=time_s)
        summarise(run, plan, planner, 0, "")


def kernels() -> dict[str, Kernel]:
    """All kernels of the modules that are loaded, by name; those with an underscore stay inside."""
    from bridge.motion.compiled import KERNELS

    return {kernel.name: kernel for kernel in KERNELS.values()}


def main() -> None:
    """Warm up, and say what was done."""
    write_line("compiling the simulator's kernels, once: up to a minute ...")
    flush()
    begun_s = time.perf_counter()
    warm()
    ready = sum(kernel.kinds is not None for kernel in kernels().values())
    write_line(f"{ready} ready, {time.perf_counter() - begun_s:.0f} s")


if __name__ == "__main__":
    main()
