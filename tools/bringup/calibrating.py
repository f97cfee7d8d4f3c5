"""What the calibrations share at the command line: the truth of an emulator, and writing."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from tools.cli.completion import complete_robot
from tools.cli.paths import is_there

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from bridge.bringup.applying import Change
    from bridge.bringup.desk import Desk
    from bridge.bringup.person import Person


class ByTruth:
    """Measures with an emulator's own account of where its robot is, by its control socket."""

    def __init__(self, control: Path) -> None:
        self._control = control
        self._from = (0.0, 0.0, 0.0)

    def begin(self) -> None:
        """The robot stands where it begins."""
        self._from = self._now()

    def end(self) -> tuple[float, float]:
        """Ahead and to the left of there, metres."""
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
    """Where a calibration went."""

    file: str | None
    device: tuple[str, ...]
    lacking: tuple[str, ...]
    reboot: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            "robot_file": self.file,
            "device": list(self.device),
            "device_lacks": list(self.lacking),
            "needs_reboot": list(self.reboot),
        }


NOWHERE = Written(None, (), (), ())


def write_results(
    desk: Desk, person: Person, changes: Sequence[Change], robot: Path | None, robot_toml: str
) -> Written:
    """Show the changes, ask, and bring them to the robot file and to the device.

    Raises:
        ConfigError: the robot file would not be valid, or cannot be written.
        BridgeError: the device refused, or fell silent.

    """
    from bridge.bringup.applying import set_on_device
    from bridge.bringup.values import edited

    for change in changes:
        person.show(change.line)
    where = f"{robot} and the device" if robot else "the device (no --robot FILE was given)"
    if not person.confirm(f"Write this to {where}?"):
        person.show("nothing was written")
        return NOWHERE
    if robot is not None:  # what can fail without the device, first
        text = robot_toml if is_there(robot) else ""
        replace_file(robot, edited(text, {c.key: c.new for c in changes}))
        person.show(f"{robot}: written")
    applied = set_on_device(desk, changes)
    if applied.set:
        person.show(f"device: set and saved {', '.join(applied.set)}")
    if applied.lacking:
        person.show(f"device: has no parameter {', '.join(applied.lacking)}")
    if applied.reboot:
        person.show(f"{', '.join(applied.reboot)}: count from the device's next boot on")
    return Written(str(robot) if robot else None, applied.set, applied.lacking, applied.reboot)


def replace_file(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises:
        ConfigError: it cannot be written.

    """
    from bridge.errors import ConfigError

    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from None


def load_existing(robot: Path | None) -> tuple[Any, str]:
    """The model and its text; a robot file that is not there yet is an empty one.

    Raises:
        ConfigError: it cannot be read, or a key is wrong.

    """
    from bridge.config import load_robot

    if robot is not None and not is_there(robot):
        return load_robot(None)[0], ""
    return load_robot(robot)


def writing_options(f: Callable[..., object]) -> Callable[..., object]:
    """``--robot`` and ``--yes``."""
    from pathlib import Path as ClickPath

    f = click.option(
        "--yes",
        is_flag=True,
        help="Answer yes to every question, including the one before writing.",
    )(f)
    return click.option(
        "--robot",
        type=click.Path(dir_okay=False, path_type=ClickPath),
        shell_complete=complete_robot,
        help="Robot file (TOML) to read and to update; created if missing.",
    )(f)
