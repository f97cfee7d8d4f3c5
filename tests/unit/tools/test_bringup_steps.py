"""The command ``bringup`` offers the steps of the procedure."""

from __future__ import annotations

import click

from bridge.bringup.procedure import STEPS
from tools.commands.bringup import command


def test_the_command_offers_every_step_in_order() -> None:
    offered = next(option.type for option in command.params if option.name == "steps")
    assert isinstance(offered, click.Choice)
    assert tuple(offered.choices) == STEPS
