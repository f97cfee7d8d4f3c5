"""A robot's values in two places: the robot file, and the device's parameters. Pure."""

from __future__ import annotations

import dataclasses
import struct
from typing import TYPE_CHECKING, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError

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

    Keys of a table are written ``ultrasonic.offset_m``. A value that the file lacks is added.

    Raises:
        ConfigError: the text is no TOML, or the result is not a valid robot file.

    """
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise ConfigError(f"the robot file is no TOML: {error}") from None
    for path, value in changes.items():
        table, _, key = path.rpartition(".")
        rounded = float(f"{value:.9g}")
        if table:
            document.setdefault(table, tomlkit.table())[key] = rounded
        else:
            document[key] = rounded
    result = tomlkit.dumps(document)
    try:
        parse_robot(result)
    except ConfigError as error:
        raise ConfigError(f"the robot file would not be valid: {error}") from None
    return result
