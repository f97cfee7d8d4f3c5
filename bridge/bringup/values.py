"""Comparison and change of a robot's values in the robot file and on the device. No I/O."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError

from bridge.config import parse_robot
from bridge.errors import ConfigError
from bridge.motion.robot_model import RangerMount
from protocol.parameter_values import rounded_f32

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
"""Map of a parameter's unit to the suffix of the robot file's key."""


class ParameterDifference(NamedTuple):
    """A value that differs between device and file; None: the value is missing there."""

    name: str
    """Name of the parameter, or key of the file if there is no parameter."""
    unit: str
    device: float | None
    file: float | None


def robot_key(parameter: Parameter) -> str:
    """Return the robot file's key of a parameter: ``wheel_diameter_m`` for ``wheel_diameter``."""
    return parameter.name + _SUFFIX.get(parameter.unit, "_" + parameter.unit.replace("/", "_"))


def file_values(model: RobotModel) -> dict[str, float]:
    """Return a robot file's numbers by flattened keys, for example ``ultrasonic_offset_m``."""
    found: dict[str, float] = {}
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        if isinstance(value, RangerMount):
            for key, number in dataclasses.asdict(value).items():
                found[f"{field.name}_{key}"] = number
        elif not isinstance(value, str):
            found[field.name] = value
    return found


def differences(parameters: Sequence[Parameter], model: RobotModel) -> list[ParameterDifference]:
    """Return the values that exist on the device and in the file but differ.

    The file's number is rounded to the parameter's precision before the comparison.
    """
    values = file_values(model)
    found = []
    for parameter in parameters:
        wanted = values.get(robot_key(parameter))
        if wanted is not None and not _same(parameter, wanted):
            found.append(
                ParameterDifference(parameter.name, parameter.unit, parameter.value, wanted)
            )
    return found


def _same(parameter: Parameter, wanted: float) -> bool:
    if parameter.kind == "f32":
        return rounded_f32(wanted) == parameter.value
    return wanted == parameter.value


def edited(text: str, changes: Mapping[str, float]) -> str:
    """Return a robot file's text with changed values. Comments and all other text are unchanged.

    The form of a key in a table is ``ultrasonic.offset_m``. Missing keys are added.

    Raises:
        ConfigError: the text is not TOML, or the result is not a valid robot file.

    """
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise ConfigError(f"the robot file is not valid TOML: {error}") from None
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
