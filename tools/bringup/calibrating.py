"""Shared code of the calibration commands: read an emulator's true pose, and write the results."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from tools.cli.completion import complete_robot
from tools.cli.configuration import RobotsOwnOption
from tools.cli.paths import PathName, is_there

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from bridge.bringup.applying import Change
    from bridge.bringup.person import Person
    from bridge.bringup.session import BringupSession


class ByTruth:
    """Measures displacements with an emulator's true pose, read from its control socket."""

    def __init__(self, control: Path) -> None:
        self._control = control
        self._from = (0.0, 0.0, 0.0)

    def begin(self) -> None:
        """Record the pose at the start of a drive."""
        self._from = self._now()

    def end(self) -> tuple[float, float]:
        """Return the displacement since :meth:`begin`: forward and to the left, m."""
        (x, y, _), (x0, y0, theta) = self._now(), self._from
        c, s = math.cos(theta), math.sin(theta)
        return (x - x0) * c + (y - y0) * s, (y - y0) * c - (x - x0) * s

    def _now(self) -> tuple[float, float, float]:
        from bridge.errors import PortError
        from sim_device.ports import PortUnavailableError, ask_control

        try:
            truth = ask_control(self._control, "truth")["truth"]
        except PortUnavailableError as error:
            raise PortError(str(error)) from None
        return truth["x_m"], truth["y_m"], truth["theta_rad"]


class Written(NamedTuple):
    """Where the results of a calibration were written."""

    file: str | None
    """Robot file; None: no file was written."""
    device: tuple[str, ...]
    """Parameters that were set and saved on the device."""
    lacking: tuple[str, ...]
    """Parameters that the device does not have."""
    reboot: tuple[str, ...]
    """Parameters that take effect at the device's next boot."""

    def to_dict(self) -> dict[str, Any]:
        """Return the object for ``--json``."""
        return {
            "robot_file": self.file,
            "device": list(self.device),
            "device_lacks": list(self.lacking),
            "needs_reboot": list(self.reboot),
        }


NOWHERE = Written(None, (), (), ())


def write_results(
    session: BringupSession,
    person: Person,
    changes: Sequence[Change],
    robot: Path | None,
    robot_toml: str,
) -> Written:
    """Show the changes, ask for confirmation, and write them to the robot file and the device.

    Args:
        session: connection to the device.
        person: the person who confirms.
        changes: parameters with old and new values.
        robot: robot file to write; None: only the device.
        robot_toml: present text of the robot file.

    Raises:
        ConfigError: the robot file would be invalid, or cannot be written.
        BridgeError: the device rejected a value, or does not answer.

    """
    from bridge.bringup.applying import set_on_device
    from bridge.bringup.values import edited

    for change in changes:
        person.show(change.line)
    where = f"{robot} and the device" if robot else "the device (no --robot FILE was given)"
    if not person.confirm(f"Write these values to {where}?"):
        person.show("nothing was written")
        return NOWHERE
    if robot is not None:  # the file is written first, because it can fail without other effects
        text = robot_toml if is_there(robot) else ""
        replace_file(robot, edited(text, {c.key: c.new for c in changes}))
        person.show(f"{robot}: written")
    applied = set_on_device(session, changes)
    if applied.set:
        person.show(f"device: set and saved {', '.join(applied.set)}")
    if applied.lacking:
        person.show(f"device: does not have the parameters {', '.join(applied.lacking)}")
    if applied.reboot:
        names = ", ".join(applied.reboot)
        person.show(f"{names}: takes effect at the next boot; reboot the device (sweepctl reboot)")
    return Written(str(robot) if robot else None, applied.set, applied.lacking, applied.reboot)


def replace_file(path: Path, text: str) -> None:
    """Write a file completely or not at all.

    Raises:
        ConfigError: the file cannot be written.

    """
    from bridge.errors import ConfigError
    from bridge.files import write_whole

    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from None


def load_existing(robot: Path | None) -> tuple[Any, str]:
    """Return the model and the text of a robot file; a missing file counts as empty.

    Raises:
        ConfigError: the file cannot be read, or is invalid.

    """
    from bridge.config import load_robot

    if robot is not None and not is_there(robot):
        return load_robot(None)[0], ""
    return load_robot(robot)


def writing_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--robot`` and ``--yes``."""
    f = click.option(
        "--yes",
        is_flag=True,
        help="Answer yes to every question, including the one before writing.",
    )(f)
    return click.option(
        "--robot",
        cls=RobotsOwnOption,
        type=PathName(dir_okay=False),
        shell_complete=complete_robot,
        help="Robot file (TOML) to read and to update; created if missing.  [default: that of the "
        "named robot]",
    )(f)
