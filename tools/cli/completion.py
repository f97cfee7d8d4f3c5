"""Shell completion of rooms, robot files, parameters and kinds of fault."""

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
    """Return the rooms that ship with sweepctl, and room files."""
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
    """Return the parameters of the reference firmware; completion asks no device."""
    from bridge.motion.robot_model import RobotModel
    from sim_device.device.parameters import table

    return _beginning((each.name for each in table(RobotModel(), 1)), incomplete)


def complete_fault(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the kinds of fault, with which the text of a fault begins."""
    from sim_device.faults.kinds import KINDS

    return _beginning(KINDS, incomplete)


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
