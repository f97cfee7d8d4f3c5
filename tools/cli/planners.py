"""``--planner``: the planners of sweepctl, the planners of plug-ins, and ``module:callable``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

import sweepctl_plugins

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.coverage.baselines.random_bounce import RandomSource
    from bridge.coverage.planner import Planner
    from bridge.motion.robot_model import RobotModel

if TYPE_CHECKING:
    _Name = click.ParamType[str]
    _Names = click.ParamType[list[str]]
else:  # click before 8.2 has no such index
    _Name = _Names = click.ParamType

PLANNERS = ("recovery", "paper", "u-shape", "random")
DEFAULT_PLANNER = "recovery"
_FORM = "MODULE:CALLABLE"


def planner_names() -> list[str]:
    """Return the names of all planners; plug-ins are found by metadata and not imported."""
    plugged = [name for name in sweepctl_plugins.found("planners") if name not in PLANNERS]
    return [*PLANNERS, *plugged]


class PlannerName(_Name):
    """Parameter type: the name of a planner."""

    name = "planner"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:  # noqa: ARG002 - click's interface
        """Return the names for the help."""
        return f"[{'|'.join((*planner_names(), _FORM))}]"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str:
        """Check that the text names a planner."""
        from bridge.spelling import nearest

        text = str(value)
        clash = sweepctl_plugins.clashes("planners").get(text)
        if clash is not None:
            self.fail(clash, param, ctx)
        if text in planner_names() or _is_path(text):
            return text
        near = nearest(text, planner_names())
        hint = f" Did you mean {near!r}?" if near else ""
        return self.fail(
            f"{text!r} is not one of {', '.join(planner_names())}, nor {_FORM}.{hint}", param, ctx
        )

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's interface
        param: click.Parameter,  # noqa: ARG002 - click's interface
        incomplete: str,
    ) -> list[click.shell_completion.CompletionItem]:
        """Return the names that begin with the text."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(n) for n in planner_names() if n.startswith(incomplete)]


class PlannerList(_Names):
    """Parameter type: names of planners, separated by commas."""

    name = "planners"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Return the names for the help."""
        return f"{PlannerName().get_metavar(param, ctx)},..."

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's interface
        param: click.Parameter,  # noqa: ARG002 - click's interface
        incomplete: str,
    ) -> list[click.shell_completion.CompletionItem]:
        """Return the lists that begin with the text."""
        from click.shell_completion import CompletionItem

        from tools.cli.completion import in_list

        return [CompletionItem(text) for text in in_list(planner_names(), incomplete)]

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> list[str]:
        """Check that each text of the list names a planner."""
        if isinstance(value, list):  # click converts a default again
            return value
        names = [name.strip() for name in str(value).split(",") if name.strip()]
        return list(dict.fromkeys(PlannerName().convert(name, param, ctx) for name in names))


def _is_path(text: str) -> bool:
    from bridge.coverage.registry import is_planner_path

    return is_planner_path(text)


def make(
    name: str,
    model: RobotModel,
    rng: RandomSource,
    options: Sequence[str] = (),
    option: str = "--planner",
) -> Planner:
    """Make a planner and check its interface, before the robot moves.

    Raises:
        click.BadParameter: the planner cannot be made; the text names planner and missing part.

    """
    from bridge.coverage.planner import PlannerError
    from bridge.coverage.planner_options import PlannerOptionError
    from bridge.coverage.registry import UnknownPlannerError, make_planner

    if ":" in name and "" not in sys.path:
        sys.path.insert(0, "")  # a file under development is in the working directory
    try:
        return make_planner(name, model, rng, options)
    except PlannerOptionError as error:
        raise click.BadParameter(f"{name}: {error}", param_hint="'--planner-option'") from None
    except (PlannerError, UnknownPlannerError) as error:
        raise click.BadParameter(str(error), param_hint=f"'{option}'") from None
