"""How far a run goes: to its own end, or as far as it is compared."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner
from bridge.coverage.registry import make_planner
from tools.experiment.curves import MULTIPLES
from tools.experiment.observed import observe
from tools.experiment.trials import HOUR_S, OPEN_FLOOR, Trial, room_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.planner import Planner
    from bridge.evaluation.metrics import CoverageMeter
    from bridge.motion.robot_model import RobotModel

_LONGEST = 15.0
"""Multiples of the reference time that a run is given at least. At rest the robot draws 1.5 W, more
than half of what it draws at cruise: it draws 8 times the reference energy before."""
_STRAIGHT_S, _STEADY_S = 22.0, 2.0
"""A straight way at cruise, and what is left out where it sets off."""
_S_PER_H = 3600.0


def planner_of(trial: Trial, model: RobotModel) -> Planner:
    """A trial's planner; ``random`` without its own limit, which has nothing to do with the room.

    Raises:
        UnknownPlannerError: there is no such planner.

    """
    rng = random.Random(trial.seed)
    planner = make_planner(trial.planner, model, rng)
    if isinstance(planner, RandomPlanner):
        return RandomPlanner(model, rng, replace(RandomOptions(), max_time_s=float("inf")))
    return planner


def limit_s(trial: Trial, meter: CoverageMeter) -> float:
    """When a trial is ended, in seconds of its drive: as asked, or an hour and more."""
    if trial.max_time_s is not None:
        return trial.max_time_s
    return max(HOUR_S, round(_LONGEST * meter.reference_time_s, 1))


def enough(planner: Planner, meter: CoverageMeter) -> Callable[[float, float], bool]:
    """Whether a run is over by its drive's time (s) and the energy drawn since boot (Wh).

    Only ``random`` needs to be told: it never ends by itself. It is ended where the last of the
    multiples of reference time and energy has been passed.
    """
    if not isinstance(planner, RandomPlanner):
        return lambda _time_s, _energy_wh: False
    time_s, energy_wh = (
        MULTIPLES[-1] * meter.reference_time_s,
        MULTIPLES[-1] * energy_unit_wh(meter),
    )
    return lambda driven_s, drawn_wh: driven_s > time_s + 1.0 and drawn_wh > energy_wh


def energy_unit_wh(meter: CoverageMeter) -> float:
    """The reference energy: sweeping the sweepable floor once, straight on at cruise speed."""
    return cruise_power_w() * meter.reference_time_s / _S_PER_H


@cache
def cruise_power_w() -> float:
    """What the robot draws on a straight way at cruise speed, measured on the virtual sweeper."""
    straight = Trial(OPEN_FLOOR, "u-shape", "none", 0)
    seen = observe(straight, room_of(OPEN_FLOOR), max_time_s=_STRAIGHT_S)
    steady = [point for point in seen.energy if point[0] >= seen.truth[0][0] + _STEADY_S]
    (begin_s, begin_wh), (end_s, end_wh) = steady[0], steady[-1]
    return _S_PER_H * (end_wh - begin_wh) / (end_s - begin_s)
