"""A robot's values in two places: the robot file, and the device's parameters. Pure."""

from __future__ import annotations

import dataclasses
import re
import struct
from typing import TYPE_CHECKING, NamedTuple

from bridge.config import parse_robot
from bridge.errors import ConfigError
from bridge.motion.robot_model import RangerMount

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bridge.motion.robot_model import RobotModel
    from bridge.session.parameters import Parameter

_SUFFIX = {
    "m": "_m",
    "m/s": "_m_s",
    "m/s2": "_m_s2",
    "rad/s": "_rad_s",
    "V": "_v",
    "count": "",
    "ratio": "",
    "": "",
}
"""Unit of a parameter → ending of the robot file's key."""
_F32 = struct.Struct("<f")
_TABLE = re.compile(r"^\s*\[([^\]]+)\]\s*(?:#.*)?$")


class Difference(NamedTuple):
    """One value that is not the same in both places; None: only the other has it."""

    name: str
    """Of the parameter, or the file's key where no parameter has it."""
    unit: str
    device: float | None
    file: float | None


def robot_key(parameter: Parameter) -> str:
    """The robot file's key of a parameter: ``wheel_diameter`` in m is ``wheel_diameter_m``."""
    return parameter.name + _SUFFIX.get(parameter.unit, "_" + parameter.unit.replace("/", "_"))


def file_values(model: RobotModel) -> dict[str, float]:
    """The numbers of a robot file, tables flattened: ``ultrasonic_offset_m``."""
    found: dict[str, float] = {}
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        if isinstance(value, RangerMount):
            for key, number in dataclasses.asdict(value).items():
                found[f"{field.name}_{key}"] = number
        elif not isinstance(value, str):
            found[field.name] = value
    return found


def differences(parameters: Sequence[Parameter], model: RobotModel) -> list[Difference]:
    """Values that device and robot file have both, and not the same.

    A number of the file is rounded to what the parameter can hold before they are compared.
    """
    values = file_values(model)
    found = []
    for parameter in parameters:
        wanted = values.get(robot_key(parameter))
        if wanted is not None and not _same(parameter, wanted):
            found.append(Difference(parameter.name, parameter.unit, parameter.value, wanted))
    return found


def _same(parameter: Parameter, wanted: float) -> bool:
    if parameter.kind == "f32":
        rounded: float = _F32.unpack(_F32.pack(wanted))[0]
        return rounded == parameter.value
    return wanted == parameter.value


def edited(text: str, changes: Mapping[str, float]) -> str:
    """A robot file's text with some values changed; all else, comments included, as it was.

    Keys of a table are written ``ultrasonic.offset_m``. What is not in the file yet is added.

    Raises:
        ConfigError: the file that results is none.

    """
    lines = text.splitlines()
    for path, value in changes.items():
        table, _, key = path.rpartition(".")
        shown = repr(float(f"{value:.9g}"))
        lines = _set(lines, table, key, shown)
    result = "\n".join(lines) + "\n"
    try:
        parse_robot(result)
    except ConfigError as error:
        raise ConfigError(f"the robot file would not be valid: {error}") from None
    return result


def _set(lines: list[str], table: str, key: str, shown: str) -> list[str]:
    form = re.compile(rf"^(\s*{re.escape(key)}\s*=\s*)([^#]*?)(\s*(?:#.*)?)$")
    here, last = "", None
    for index, line in enumerate(lines):
        heading = _TABLE.match(line)
        if heading is not None:
            if here == table:
                break
            here = heading.group(1).strip()
            if here == table:
                last = index
            continue
        if here != table:
            continue
        found = form.match(line)
        if found is not None:
            return [*lines[:index], f"{found[1]}{shown}{found[3]}", *lines[index + 1 :]]
        if line.strip():
            last = index
    if last is None and table:
        return [*lines, "", f"[{table}]", f"{key} = {shown}"]
    at = 0 if last is None else last + 1
    return [*lines[:at], f"{key} = {shown}", *lines[at:]]
