"""Runs one trial and computes its metrics, in a worker process."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.coverage.baselines.paper import PaperPlanner
from bridge.evaluation.metrics import CoverageMeter
from tools.experiment import curves
from tools.experiment.observed import Observed, observe
from tools.experiment.span import energy_unit_wh, enough, limit_s, planner_of
from tools.experiment.trials import PERFECT, Trial, TrialKind
from tools.virtual.summary import summarise

if TYPE_CHECKING:
    from bridge.coverage.planner import Planner
    from sim_device.noise import NoiseLevel
    from tools.virtual.run import VirtualRun


def run_trial(trial: Trial) -> dict[str, Any]:
    """Run a trial and return its metrics: a flat object, except for curves and paths.

    Raises:
        FloorPlanError: the room is invalid.
        CompareMissingError: the planner is from zimablue, and zimablue is not installed.

    """
    match trial.kind:
        case TrialKind.CYCLES:
            from tools.experiment.cycles import run_cycles

            return run_cycles(trial)
        case TrialKind.ZIMABLUE:
            from tools.experiment.zimablue_run import run_zimablue

            return run_zimablue(trial)
        case TrialKind.LIMITS:
            return _limits(trial)
        case TrialKind.LAYOUT | TrialKind.RANGES:
            return _reading(trial)
        case _:
            return _figures(trial, _drive(trial))


def _limits(trial: Trial) -> dict[str, Any]:
    from tools.experiment.unswept_causes import rounded, split_loss

    driven = _drive(trial)
    return _figures(trial, driven) | {"loss": rounded(split_loss(driven.observed, driven.planner))}


class _Driven(NamedTuple):
    """A trial after its run."""

    observed: Observed
    planner: Planner
    meter: CoverageMeter
    limit_s: float


def _drive(trial: Trial, noise: str | NoiseLevel | None = None) -> _Driven:
    """Run the planner of a trial in its room until the planner ends or the time limit is reached.

    The planner ``random`` ends after the last point of the coverage curves.
    """
    model, plan = trial.model, trial.plan
    planner, meter = planner_of(trial, model), CoverageMeter(plan, model, 0.01)
    perfect = trial.noise == PERFECT

    def prepare(run: VirtualRun) -> None:
        if perfect:
            from tools.experiment.true_pose import give_true_pose

            give_true_pose(run)

    max_time_s = limit_s(trial, meter)
    observed = observe(
        trial,
        plan,
        max_time_s=max_time_s,
        planner=planner,
        noise="none" if perfect else noise,
        prepare=prepare,
        enough=enough(planner, meter),
    )
    return _Driven(observed, planner, meter, max_time_s)


def _reading(trial: Trial) -> dict[str, Any]:
    """Run a trial with a variant of ``paper``, or a trial with only range noise."""
    from tools.experiment.paper_trials import RANGE_LEVEL, READINGS

    model, plan, reading = trial.model, trial.plan, READINGS.get(trial.planner)
    noise = RANGE_LEVEL if trial.noise == RANGE_LEVEL.name else trial.noise
    if reading is None:
        return _figures(trial, _drive(trial, noise))
    meter, planner = CoverageMeter(plan, model, 0.01), PaperPlanner(model, reading)
    known, max_time_s = replace(trial, planner="paper"), limit_s(trial, meter)
    observed = observe(known, plan, max_time_s=max_time_s, planner=planner, noise=noise)
    return _figures(trial, _Driven(observed, planner, meter, max_time_s))


def _figures(trial: Trial, driven: _Driven) -> dict[str, Any]:
    observed, meter = driven.observed, driven.meter
    summary = summarise(observed.run, observed.plan, trial.planner, trial.seed, None)
    report = meter.measure(observed.truth)
    row = {key: value for key, value in summary.items() if not isinstance(value, dict)}
    for key in ("log", "room", "planner", "seed"):
        del row[key]
    row |= summary["coverage"]
    row |= {f"pose_error_{key}_m": value for key, value in summary["pose_error_m"].items()}
    start_s = observed.truth[0][0] if observed.truth else 0.0
    drawn = [(time_s - start_s, energy_wh) for time_s, energy_wh in observed.energy]
    unit_wh = energy_unit_wh(meter)
    cut = row["outcome"] == "timeout"
    by_time = curves.over_time(meter, report, cut=cut)
    return row | {
        "limit_s": driven.limit_s,
        "radius_m": meter.model.radius_m,
        "width_m": meter.model.cleaning_width_m,
        "sweepable_m2": round(report.sweepable_m2, 4),
        "reference_time_s": round(report.reference_time_s, 2),
        "reference_energy_wh": round(unit_wh, 5),
        "path_ratio": round(report.path_ratio, 4),
        "time_ratio": round(report.time_ratio, 4),
        "curve": {
            "coverage": by_time,
            "by_path": curves.over_path(meter, report, observed.truth, cut=cut),
            "by_energy": curves.over_energy(meter, report, drawn, unit_wh, cut=cut),
            # Constant after the end of the run, because the robot no longer sweeps.
            "energy_wh": [
                None
                if share is None
                else round(observed.energy_at(start_s + multiple * report.reference_time_s), 5)
                for multiple, share in zip(curves.MULTIPLES, by_time, strict=True)
            ],
        },
        "path": curves.thinned([pose[1:3] for pose in observed.truth]),
    }
