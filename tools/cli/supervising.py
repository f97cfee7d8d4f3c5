"""Options of a run that is supervised, and the rules that follow from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bridge.supervise import SuperviseSettings


def rule_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--supervise-rule``, any number of times."""
    return click.option(
        "--supervise-rule",
        "rules",
        multiple=True,
        metavar="RULE.KEY=VALUE",
        help="Supervise the run with this rule changed (stall.reaction=pause). Repeatable.",
    )(f)


def supervise_rules(robot: Path | None, changes: tuple[str, ...]) -> SuperviseSettings:
    """What is watched, and how hard: the robot file's rules, changed as asked.

    Raises:
        ConfigError: the file or a change names no rule, or a value that it does not take.

    """
    from bridge.config import load_supervise
    from bridge.supervise import parse_rule

    settings = load_supervise(robot)
    for change in changes:
        settings = parse_rule(settings, change)
    return settings
