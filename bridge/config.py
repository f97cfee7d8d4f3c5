"""The robot file: TOML to a checked :class:`RobotModel`.

Every key of the model may stand in the file, ranges in tables of their own; rules of
supervision stand in tables ``[supervise.NAME]`` (:mod:`bridge.supervise.settings`)::

    name = "my sweeper"
    wheel_diameter_m = 0.0648

    [ultrasonic]
    x_m = 0.12
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from typing import TYPE_CHECKING, Any, TypeVar

from bridge.errors import ConfigError
from bridge.motion.robot_model import RangerMount, RobotModel
from bridge.supervise.settings import PREFIX as SUPERVISE
from bridge.supervise.settings import SuperviseSettings, settings_from

if TYPE_CHECKING:
    from pathlib import Path

MAX_FILE_BYTES = 64 * 1024
MAX_NAME = 64
_SHOWN = 10**30
_RANGES: dict[str, tuple[float, float]] = {
    "robot_diameter_m": (0.05, 2.0),
    "cleaning_width_m": (0.02, 2.0),
    "cruise_speed_m_s": (0.01, 2.0),
    "max_speed_m_s": (0.01, 2.0),
    "max_accel_m_s2": (0.01, 10.0),
    "max_yaw_rate_rad_s": (0.05, 20.0),
    "max_yaw_accel_rad_s2": (0.05, 100.0),
    "wheel_diameter_m": (0.01, 1.0),
    "wheel_base_m": (0.02, 2.0),
    "battery_v": (3.0, 60.0),
    "battery_ah": (0.1, 200.0),
    "mouth_offset_m": (-1.0, 1.0),
    "driver_drop_v": (0.0, 5.0),
    "counts_per_turn": (4, 1_000_000),
    "wheel_ratio": (0.8, 1.25),
    "gyro_bias_rad_s": (-0.4, 0.4),
    "scale": (0.5, 2.0),
    "offset_m": (-0.2, 0.2),
    "x_m": (-1.0, 1.0),
    "y_m": (-1.0, 1.0),
    "yaw_rad": (-2 * math.pi, 2 * math.pi),
    "min_range_m": (0.0, 10.0),
    "max_range_m": (0.01, 20.0),
    "cone_rad": (0.0, math.pi),
}


def load_robot(path: Path | None) -> tuple[RobotModel, str]:
    """Read a robot file; without one, the default robot. Gives the model and its TOML text.

    Raises:
        ConfigError: the file cannot be read or a key is wrong; the text names which.

    """
    if path is None:
        model = RobotModel()
        return model, to_toml(model)
    try:
        with path.open("rb") as file:  # not by its size: a device file says 0
            content = file.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise ConfigError(f"robot file {path} is larger than {MAX_FILE_BYTES} bytes")
        text = content.decode()
    except OSError as error:
        raise ConfigError(f"cannot read robot file {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"robot file {path} is not UTF-8 text") from None
    try:
        return parse_robot(text), text
    except ConfigError as error:
        raise ConfigError(f"robot file {path}: {error}") from None


def load_supervise(path: Path | None) -> SuperviseSettings:
    """What a robot file says of supervision (``[supervise]``), over the defaults.

    Raises:
        ConfigError: the file cannot be read or a key is wrong; the text names which.

    """
    _, text = load_robot(path)
    return settings_from(_tables(text).get(SUPERVISE, {}))


def parse_robot(text: str) -> RobotModel:
    """Read a robot file's text.

    Raises:
        ConfigError: not TOML, an unknown key, or a value out of its range.

    """
    data = _tables(text)
    settings_from(data.pop(SUPERVISE, {}))  # a wrong rule is told before a run, not in it
    model = _fill(RobotModel(), data, "")
    if model.cleaning_width_m > model.robot_diameter_m:
        raise ConfigError("cleaning_width_m must not exceed robot_diameter_m")
    if model.cruise_speed_m_s > model.max_speed_m_s:
        raise ConfigError("cruise_speed_m_s must not exceed max_speed_m_s")
    if model.wheel_base_m > model.robot_diameter_m:
        raise ConfigError("wheel_base_m must not exceed robot_diameter_m")
    return model


def _tables(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of 5000 digits is a ValueError
        raise ConfigError(f"not valid TOML: {error}") from None


def to_toml(model: RobotModel) -> str:
    """The model as a robot file that :func:`parse_robot` reads back."""
    plain: list[str] = []
    tables: list[str] = []
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        if isinstance(value, RangerMount):
            tables.append(f"\n[{field.name}]")
            tables += [f"{k} = {v!r}" for k, v in dataclasses.asdict(value).items()]
        elif isinstance(value, str):
            plain.append(f'{field.name} = "{"".join(_escaped(c) for c in value)}"')
        else:
            plain.append(f"{field.name} = {value!r}")
    return "\n".join(plain + tables) + "\n"


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    return character if character.isprintable() else f"\\U{ord(character):08x}"


_T = TypeVar("_T", RobotModel, RangerMount)


def _fill(base: _T, data: dict[str, Any], prefix: str) -> _T:
    known = {field.name for field in dataclasses.fields(base)}
    changes: dict[str, Any] = {}
    for key, value in data.items():
        if key not in known:
            raise ConfigError(f"{prefix}{key}: no such key; known are {', '.join(sorted(known))}")
        changes[key] = _value(f"{prefix}{key}", key, getattr(base, key), value)
    return dataclasses.replace(base, **changes)


def _value(path: str, key: str, default: object, value: object) -> object:
    if isinstance(default, RangerMount):
        if not isinstance(value, dict):
            raise ConfigError(f"{path}: must be a table")
        mount = _fill(default, value, f"{path}.")
        if mount.min_range_m >= mount.max_range_m:
            raise ConfigError(f"{path}.min_range_m must be below {path}.max_range_m")
        return mount
    if isinstance(default, str):
        if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME:
            raise ConfigError(f"{path}: must be a text of 1 to {MAX_NAME} characters")
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{path}: {value!r} is not a number")
    if isinstance(default, int) and not isinstance(value, int):
        raise ConfigError(f"{path}: {value!r} is not a whole number")
    low, high = _RANGES[key]
    if not low <= value <= high:
        shown = repr(value) if isinstance(value, float) or abs(value) < _SHOWN else "a huge number"
        raise ConfigError(f"{path}: {shown} is out of range {low:g}..{high:g}")
    return value if isinstance(default, int) else float(value)
