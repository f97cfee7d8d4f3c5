"""One trial, from room to figures; runs in a process of its own."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

from bridge.coverage.metrics import CoverageMeter
from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from tools.experiment import curves
from tools.experiment.observed import Observed, observe
from tools.experiment.trials import PERFECT, Kind, Trial, room_of
from tools.virtual_summary import summarise

if TYPE_CHECKING:
    from bridge.coverage.planner import Planner
    from tools.virtual_run import VirtualRun

_PATH_STEP_M = 0.02


def run_trial(trial: Trial) -> dict[str, Any]:
    """Run it and give its figures: a flat object, but for curves, paths and the like.

    Raises:
        FloorPlanError: the room cannot be used.
        CompareMissingError: it is one of zimablue's, which is not installed.

    """
    match trial.kind:
        case Kind.CYCLES:
            from tools.experiment.cycles import run_cycles

            return run_cycles(trial)
        case Kind.ZIMABLUE:
            from tools.experiment.zimablue_run import run_zimablue

            return run_zimablue(trial)
        case Kind.LIMITS:
            return _limits(trial)
        case _:
            return _figures(trial, observe(trial, room_of(trial.room)))


def _limits(trial: Trial) -> dict[str, Any]:
    from tools.experiment.limits import give_true_pose, rounded, split_loss

    perfect = trial.noise == PERFECT
    planners: list[Planner] = []

    def prepare(run: VirtualRun) -> None:
        model = run.host.model
        planners.append(make_planner(trial.planner, model, random.Random(trial.seed)))
        run.host.mission.runner = PlanRunner(planners[0], model)
        if perfect:
            give_true_pose(run)

    plan = room_of(trial.room)
    observed = observe(trial, plan, noise="none" if perfect else None, prepare=prepare)
    return _figures(trial, observed) | {"loss": rounded(split_loss(observed, planners[0]))}


def _figures(trial: Trial, observed: Observed) -> dict[str, Any]:
    summary = summarise(observed.run, observed.plan, trial.planner, trial.seed, None)
    meter = CoverageMeter(observed.plan, observed.model, 0.01)
    report = meter.measure(observed.truth)
    row = {key: value for key, value in summary.items() if not isinstance(value, dict)}
    for key in ("log", "room", "planner", "seed"):
        del row[key]
    row |= summary["coverage"]
    row |= {f"pose_error_{key}_m": value for key, value in summary["pose_error_m"].items()}
    start_s = observed.truth[0][0] if observed.truth else 0.0
    cut = row["outcome"] == "timeout"
    times = [start_s + multiple * report.reference_time_s for multiple in curves.MULTIPLES]
    return row | {
        "sweepable_m2": round(report.sweepable_m2, 4),
        "reference_time_s": round(report.reference_time_s, 2),
        "path_ratio": round(report.path_ratio, 4),
        "time_ratio": round(report.time_ratio, 4),
        "curve": {
            "coverage": curves.over_time(meter, report, cut=cut),
            "by_path": curves.over_path(meter, report, observed.truth, cut=cut),
            # after its end the robot stands: nothing more is drawn for the sweeping
            "energy_wh": [round(observed.energy_at(time), 5) for time in times],
        },
        "path": thinned([pose[1:3] for pose in observed.truth]),
    }


def thinned(places: list[tuple[float, float]]) -> list[list[float]]:
    """A path, thinned to what a picture shows."""
    kept: list[list[float]] = []
    for x, y in places:
        if not kept or abs(x - kept[-1][0]) + abs(y - kept[-1][1]) >= _PATH_STEP_M:
            kept.append([round(x, 3), round(y, 3)])
    return kept
