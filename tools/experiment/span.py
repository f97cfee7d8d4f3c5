"""End of a trial: when its planner ends, or at the last compared multiple of the references."""

from __future__ import annotations

import random
from functools import cache
from typing import TYPE_CHECKING

from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.registry import make_planner
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from tools.experiment.curves import MULTIPLES
from tools.experiment.observed import observe
from tools.experiment.settings import settings_of
from tools.experiment.trials import HOUR_S, Trial

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.planner import Planner
    from bridge.evaluation.metrics import CoverageMeter
    from bridge.motion.robot_model import RobotModel

_LONGEST = 15.0
"""Minimum time limit of a run, in multiples of the reference time. A robot at rest draws 1.5 W,
more than half of its power at cruise speed, so a run reaches 8 times the reference energy before
this limit."""
_STRAIGHT_S = 22.0
"""Duration of the straight drive that measures the cruise power, s."""
_FREE_M = 2.0
"""Length of the floor before and after the straight drive, m."""
_ASIDE_M = 1.5
"""Distance to the walls beside the straight drive, m; no side sensor measures them."""
_STEADY_S = 2.0
"""Time at the start of the straight drive that is not measured, s: the acceleration."""
_S_PER_H = 3600.0
"""Seconds in an hour."""


def planner_of(trial: Trial, model: RobotModel) -> Planner:
    """Make the planner of a trial; the planner ``random`` gets no time limit.

    Raises:
        UnknownPlannerError: no planner has this name.

    """
    if trial.options:
        settings = settings_of(trial.options)
        return RecoveryPlanner(model, settings.planner, motion=settings.motion)
    rng = random.Random(trial.seed)
    planner = make_planner(trial.planner, model, rng)
    if isinstance(planner, RandomPlanner):
        return RandomPlanner(model, rng, RandomOptions(max_time_s=float("inf")))
    return planner


def limit_s(trial: Trial, meter: CoverageMeter) -> float:
    """Return the time limit of a trial, s: the requested limit, else an hour or more."""
    if trial.max_time_s is not None:
        return trial.max_time_s
    return max(HOUR_S, round(_LONGEST * meter.reference_time_s, 1))


def enough(planner: Planner, meter: CoverageMeter) -> Callable[[float, float], bool]:
    """Return a function that decides whether to end a run.

    The arguments of the function are the time of the drive, s, and the energy drawn since boot, Wh.
    Only the planner ``random`` needs the function, because it never ends by itself. A run of
    ``random`` ends after the last multiple of the reference time and energy.
    """
    if not isinstance(planner, RandomPlanner):
        return lambda _time_s, _energy_wh: False
    time_s, energy_wh = (
        MULTIPLES[-1] * meter.reference_time_s,
        MULTIPLES[-1] * energy_unit_wh(meter),
    )
    return lambda driven_s, drawn_wh: driven_s > time_s + 1.0 and drawn_wh > energy_wh


def energy_unit_wh(meter: CoverageMeter) -> float:
    """Return the energy to sweep the sweepable floor once, straight ahead at cruise speed, Wh."""
    return cruise_power_w(meter.model) * meter.reference_time_s / _S_PER_H


@cache
def cruise_power_w(model: RobotModel) -> float:
    """Return the power at cruise speed, W, measured on a straight drive of the virtual sweeper."""
    length_m = _STRAIGHT_S * model.cruise_speed_m_s + 2.0 * _FREE_M
    walls = ((0.0, 0.0), (length_m, 0.0), (length_m, 2.0 * _ASIDE_M), (0.0, 2.0 * _ASIDE_M))
    corridor = FloorPlan("straight", walls, (), Pose2(_ASIDE_M, _ASIDE_M, 0.0))
    straight = Trial(corridor.name, "u-shape", "none", 0)
    seen = observe(straight, corridor, max_time_s=_STRAIGHT_S, model=model)
    steady = [point for point in seen.energy if point[0] >= seen.truth[0][0] + _STEADY_S]
    (begin_s, begin_wh), (end_s, end_wh) = steady[0], steady[-1]
    return _S_PER_H * (end_wh - begin_wh) / (end_s - begin_s)
