"""One trial, from room to figures; runs in a process of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.coverage.metrics import CoverageMeter
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.experiment.trials import Trial, room_of
from tools.virtual_run import run_virtual
from tools.virtual_summary import summarise

if TYPE_CHECKING:
    from bridge.coverage.metrics import CoverageReport
    from tools.virtual_run import VirtualRun

MULTIPLES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)
"""Of the lower bound (sweepable area / (W · cruise speed)): where curves are read off."""
_PATH_STEP_M = 0.02


def run_trial(trial: Trial, max_time_s: float) -> dict[str, Any]:
    """Run it and give its figures: a flat object, but for ``curve`` and ``path``.

    Raises:
        FloorPlanError: the room cannot be used.

    """
    plan, model = room_of(trial.room), RobotModel()
    run = run_virtual(
        plan,
        model,
        trial.planner,
        NullSink(),
        seed=trial.seed,
        noise=trial.noise,
        max_time_s=max_time_s,
    )
    summary = summarise(run, plan, trial.planner, trial.seed, None)
    meter = CoverageMeter(plan, model, 0.01)
    report = meter.measure((t, *pose) for t, pose in run.truth)
    row = {key: value for key, value in summary.items() if not isinstance(value, dict)}
    for key in ("log", "room", "planner", "seed"):
        del row[key]
    row |= summary["coverage"]
    row |= {f"pose_error_{key}_m": value for key, value in summary["pose_error_m"].items()}
    return row | {
        "sweepable_m2": round(report.sweepable_m2, 4),
        "reference_time_s": round(report.reference_time_s, 2),
        "path_ratio": round(report.path_ratio, 4),
        "time_ratio": round(report.time_ratio, 4),
        "curve": _curve(meter, report, run),
        "path": _path(run),
    }


def _curve(meter: CoverageMeter, report: CoverageReport, run: VirtualRun) -> dict[str, list[Any]]:
    """The main figure at multiples of the lower bound, and the energy drawn by then (Wh).

    After the run's end coverage stays as it is, and so does the energy: the robot stands.
    """
    reference_s = report.reference_time_s
    times = [multiple * reference_s for multiple in MULTIPLES]
    start_s = run.truth[0][0] if run.truth else 0.0
    return {
        "coverage": [round(share, 4) for share in meter.share_at(report, times)],
        "energy_wh": [round(_energy_at(run, start_s + t), 5) for t in times],
    }


def _energy_at(run: VirtualRun, time_s: float) -> float:
    """Drawn by ``time_s`` (s since boot), from samples a second apart."""
    before = 0.0
    for sampled_s, energy_wh in run.energy:
        if sampled_s > time_s:
            break
        before = energy_wh
    return before


def _path(run: VirtualRun) -> list[list[float]]:
    """The true path, thinned to what a picture shows."""
    kept: list[list[float]] = []
    for _, pose in run.truth:
        step = (
            _PATH_STEP_M if not kept else abs(pose.x_m - kept[-1][0]) + abs(pose.y_m - kept[-1][1])
        )
        if step >= _PATH_STEP_M:
            kept.append([round(pose.x_m, 3), round(pose.y_m, 3)])
    return kept
