"""The planners by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.coverage.baselines.lanes import LaneOptions
from bridge.coverage.baselines.paper import PaperOptions, PaperPlanner
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner, RandomSource
from bridge.coverage.baselines.u_shape import UShapePlanner
from bridge.coverage.planner_options import NoOptions, parse_options

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.coverage.planner import Planner
    from bridge.motion.robot_model import RobotModel

    Factory = Callable[[RobotModel, RandomSource, Sequence[str]], Planner]

PLANNERS: dict[str, str] = {
    "recovery": "the default: perimeter passes, lanes, and revisits of occluded regions",
    "paper": "the paper's algorithm: lanes, and one slot of memory for an obstacle",
    "u-shape": "the traditional U-shaped trajectory: lanes with no memory",
    "random": "random bounce, for comparison",
}
"""One-line description of each planner."""


def _recovery(model: RobotModel, _rng: RandomSource, options: Sequence[str]) -> Planner:
    from bridge.coverage.recovery.planner import (  # noqa: PLC0415 - only where it runs
        RecoveryPlanner,
    )

    parse_options(NoOptions, options)
    return RecoveryPlanner(model)


_FACTORIES: dict[str, Factory] = {
    "recovery": _recovery,
    "paper": lambda model, _, options: PaperPlanner(model, parse_options(PaperOptions, options)),
    "u-shape": lambda model, _, options: UShapePlanner(model, parse_options(LaneOptions, options)),
    "random": lambda model, rng, options: RandomPlanner(
        model, rng, parse_options(RandomOptions, options)
    ),
}


class UnknownPlannerError(ValueError):
    """No planner has this name."""

    def __init__(self, name: str) -> None:
        """``name`` is what was asked for."""
        self.name = name
        super().__init__(f"unknown planner '{name}'; there are: {', '.join(PLANNERS)}")


def make_planner(
    name: str, model: RobotModel, rng: RandomSource, options: Sequence[str] = ()
) -> Planner:
    """Make a planner from its name.

    Args:
        name: one of :data:`PLANNERS`.
        model: the robot.
        rng: source of random numbers; only ``random`` uses it.
        options: ``name=value`` each.

    Raises:
        UnknownPlannerError: no planner has this name.
        PlannerOptionError: the planner has no such option, or it cannot be that.

    """
    try:
        factory = _FACTORIES[name]
    except KeyError:
        raise UnknownPlannerError(name) from None
    return factory(model, rng, options)
