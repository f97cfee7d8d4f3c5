"""``--supervise-rule``, and the settings of the rules of a supervised run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli.completion import complete_rule

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bridge.supervise import SuperviseSettings


def rule_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--supervise-rule``, which may be repeated."""
    return click.option(
        "--supervise-rule",
        "rules",
        multiple=True,
        metavar="RULE.KEY=VALUE",
        shell_complete=complete_rule,
        help="Supervise the run, with this setting of a rule (stall.reaction=pause); may be "
        "repeated.",
    )(f)


def supervise_rules(robot: Path | None, changes: tuple[str, ...]) -> SuperviseSettings:
    """Return the rules of the robot file with the changes of ``--supervise-rule``.

    Raises:
        ConfigError: the file or a change names an unknown rule or an invalid value.

    """
    from bridge.config import load_supervise
    from bridge.supervise import parse_rule

    settings = load_supervise(robot)
    for change in changes:
        settings = parse_rule(settings, change)
    return settings
