"""The summary of a virtual run: metrics from the true path, collisions and energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.run.onboard_mission import OnboardMission
from bridge.run.summary import run_summary

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from tools.virtual.run import VirtualRun


def summarise(
    run: VirtualRun, plan: FloorPlan, planner: str, seed: int, log: str | None
) -> dict[str, Any]:
    """Return the run's summary, the object of ``--json``."""
    host = run.host
    truth = run.device.truth
    report = None
    loop = run.loop
    if loop.end_error_m is not None:
        runner, onboard = host.mission.runner, isinstance(host.mission, OnboardMission)
        lanes_m = None if onboard else runner.lane_length_m if runner else 0.0
        report = run.track.report(lanes_m)
    return run_summary(
        host,
        room=plan.name,
        planner=planner,
        seed=seed,
        log=log,
        report=report,
        error_m=(loop.end_error_m, loop.max_error_m),
        collisions=truth.collisions,
        contact_s=truth.contact_s,
        energy_wh=truth.energy_wh,
    )
