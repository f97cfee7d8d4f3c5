"""Shell completion of rooms, robot files, parameters, kinds of fault, and rules."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    import click


def complete_room(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the rooms of sweepctl, and room files."""
    from tools.cli.rooms import shipped_rooms

    return [*_beginning(shipped_rooms(), incomplete), *complete_files(incomplete, ".json")]


def complete_robot(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return robot files."""
    return complete_files(incomplete, ".toml")


def complete_parameter(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the parameters of the reference firmware, without a request to a device."""
    from bridge.motion.robot_model import RobotModel
    from sim_device.device.parameters import table

    return _beginning((each.name for each in table(RobotModel(), 1)), incomplete)


def complete_fault(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the kinds of fault; the text of a fault begins with its kind."""
    from sim_device.faults.kinds import KINDS

    return _beginning(KINDS, incomplete)


def complete_rule(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the keys of the supervision rules with "="; for plug-ins only the reaction."""
    from dataclasses import fields

    import sweepctl_plugins
    from bridge.supervise.settings import SuperviseSettings

    rules = SuperviseSettings().rules.items()
    known = [f"{name}.{field.name}=" for name, rule in rules for field in fields(rule)]
    known += [f"{name}.reaction=" for name in sweepctl_plugins.found("rules")]
    return _beginning(known, incomplete)


def in_list(names: Iterable[str], incomplete: str) -> list[str]:
    """Return the possible continuations of a list that is separated by commas."""
    before, comma, begun = incomplete.rpartition(",")
    listed = before.split(",")
    return [f"{before}{comma}{n}" for n in _beginning(names, begun) if n not in listed]


def complete_rooms(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return lists of rooms: the rooms of sweepctl, and room files."""
    from tools.cli.rooms import shipped_rooms

    files = complete_files(incomplete.rpartition(",")[2], ".json")
    return in_list([*shipped_rooms(), *files], incomplete)


def complete_robots(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return lists of robot files."""
    return in_list(complete_files(incomplete.rpartition(",")[2], ".toml"), incomplete)


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def complete_files(incomplete: str, suffix: str) -> list[str]:
    """Return the files with this suffix, and the folders, that begin with ``incomplete``."""
    folder, _, begun = incomplete.rpartition("/")
    where = Path(f"{folder}/") if "/" in incomplete else Path()
    head = f"{folder}/" if "/" in incomplete else ""
    try:
        entries = sorted(where.iterdir())
    except OSError:
        return []
    found = []
    for entry in entries:
        if not entry.name.startswith(begun) or (entry.name.startswith(".") and not begun):
            continue
        if entry.suffix == suffix:
            found.append(f"{head}{entry.name}")
        elif entry.is_dir():
            found.append(f"{head}{entry.name}/")
    return found
