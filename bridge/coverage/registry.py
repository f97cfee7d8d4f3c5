"""Planners by name: the project's planners, plug-ins, and ``module:callable``."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import sweepctl_plugins
from bridge.coverage.baselines.lanes import LaneOptions
from bridge.coverage.baselines.paper import PaperOptions, PaperPlanner
from bridge.coverage.baselines.random_bounce import RandomOptions, RandomPlanner, RandomSource
from bridge.coverage.baselines.u_shape import UShapePlanner
from bridge.coverage.planner import ORIGINS, PlannerError, check_planner
from bridge.coverage.planner_options import NoOptions, PlannerOptionError, parse_options

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
    from bridge.coverage.recovery.planner import (  # noqa: PLC0415 - imported only when used
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
    """There is no planner with this name."""

    def __init__(self, name: str) -> None:
        """Store the requested name."""
        self.name = name
        super().__init__(f"unknown planner '{name}'; there are: {', '.join(planner_names())}")


class PlannerMakingError(PlannerError):
    """A planner that is not part of the project cannot be imported or created.

    The text names it.
    """


def planner_names() -> list[str]:
    """Return the names of the project's planners, then of plug-ins. No planner is imported."""
    return [
        *PLANNERS,
        *(name for name in sweepctl_plugins.found("planners") if name not in PLANNERS),
    ]


def is_planner_path(name: str) -> bool:
    """Return True if a name has the form ``module:callable``."""
    module, colon, attribute = name.partition(":")
    return bool(colon) and all(
        part.isidentifier() for text in (module, attribute) for part in text.split(".")
    )


def make_planner(
    name: str, model: RobotModel, rng: RandomSource, options: Sequence[str] = ()
) -> Planner:
    """Create a planner from its name.

    Args:
        name: one of :func:`planner_names`, or ``module:callable``.
        model: the robot.
        rng: source of random numbers. Of the project's planners, only ``random`` uses it.
        options: options in the form ``name=value``.

    Raises:
        UnknownPlannerError: no planner has this name.
        PlannerOptionError: the planner has no such option, or the value is invalid.
        PlannerError: a plug-in or ``module:callable`` cannot be loaded or raises an exception, or
            its result lacks a method. The text names the planner.

    """
    if name in _FACTORIES:
        return _FACTORIES[name](model, rng, options)
    origin, factory = _outside(name)
    try:
        planner = factory(model, rng, options)
    except PlannerOptionError:
        raise
    except Exception as error:
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise PlannerMakingError(f"{origin} cannot be made: {what}") from error
    try:
        check_planner(planner)
    except PlannerError as error:
        raise PlannerMakingError(f"{origin}: {error}") from None
    ORIGINS[type(planner)] = origin
    return planner


def _outside(name: str) -> tuple[str, Factory]:
    """Return the description and the factory of a planner that is not part of the project."""
    plugin = sweepctl_plugins.found("planners").get(name)
    clash = sweepctl_plugins.clashes("planners").get(name)
    if clash is not None:
        raise PlannerMakingError(clash)
    if plugin is not None:
        origin = str(plugin)
        try:
            factory = sweepctl_plugins.load(plugin)
        except sweepctl_plugins.PluginError as error:
            raise PlannerMakingError(str(error)) from error
    elif is_planner_path(name):
        origin, factory = f"planner {name}", _imported(name)
    else:
        raise UnknownPlannerError(name)
    if not callable(factory):
        raise PlannerMakingError(f"{origin} is not callable: it must take (model, rng, options)")
    return origin, factory


def _imported(name: str) -> Factory:
    module_name, _, attribute = name.partition(":")
    try:
        found = importlib.import_module(module_name)
        for part in attribute.split("."):
            found = getattr(found, part)
    except Exception as error:
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise PlannerMakingError(f"planner {name} cannot be loaded: {what}") from error
    return found  # type: ignore[return-value]  # its result is checked
