"""Conversion of a robot file (TOML) to a checked :class:`RobotModel`.

The file may contain any key of the model, and a table for each range sensor. Supervision rules are
in tables ``[supervise.NAME]`` (:mod:`bridge.supervise.settings`)::

    name = "my sweeper"
    wheel_diameter_m = 0.0648

    [ultrasonic]
    x_m = 0.12
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from bridge.errors import ConfigError
from bridge.files import open_to_read
from bridge.motion.robot_model import MISSING_SENSOR_EFFECTS, RangerMount, RobotModel
from bridge.supervise.settings import PREFIX as SUPERVISE
from bridge.supervise.settings import Level, SuperviseSettings, settings_from
from bridge.validation import as_toml, fill, load_toml

if TYPE_CHECKING:
    from collections.abc import Set as AbstractSet
    from pathlib import Path

    from _typeshed import DataclassInstance

MAX_FILE_BYTES = 64 * 1024
ROUNDING_M = 1e-6
"""Maximum length that counts as zero, m. It allows for rounded numbers in a robot file."""
_TILT = math.sin(math.radians(2.0))
"""Largest tilt of a side infrared sensor without a caution, as a sine."""
MAX_OVERHANG = 0.5
"""Maximum distance of a sensor outside the hull, as a share of the radius. A larger distance is
probably a typing error."""


def load_robot(path: Path | None) -> tuple[RobotModel, str]:
    """Read a robot file, or use the default robot; return the model and its TOML text.

    Raises:
        ConfigError: the file cannot be read or a key is wrong; the text names it.

    """
    if path is None:
        model = RobotModel()
        return model, to_toml(model)
    try:
        with open_to_read(path, takes_pipe=True) as file:
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
        raise ConfigError(*error.problems, source=f"robot file {path}") from None


def robot_cautions(model: RobotModel) -> list[str]:
    """Return the model's keys that are likely to cause problems, each with a remedy."""
    found = []
    radius_m = model.radius_m
    outside_m = model.mouth_reach_m - radius_m
    if outside_m > ROUNDING_M:
        found.append(
            f"cleaning_width_m, mouth_offset_m: the ends of the mouth are "
            f"{1000 * outside_m:.0f} mm outside the footprint; they hit walls before the hull does"
        )
    found += [
        f"{name}.fitted: without this sensor {MISSING_SENSOR_EFFECTS[name]}"
        for name, mount in model.rangers.items()
        if not mount.fitted
    ]
    for name, mount in model.fitted_rangers.items():
        overhang_m = mount.centre_distance_m - radius_m
        contact_m = mount.contact_range_m(radius_m)
        if name.startswith("infrared") and abs(math.cos(mount.yaw_rad)) > _TILT:
            found.append(
                f"{name}.yaw_rad: the sensor does not look straight to its side; wall following "
                f"expects ±{math.pi / 2:.4f} rad"
            )
        if overhang_m > ROUNDING_M:
            found.append(
                f"{name}: the sensor is {1000 * overhang_m:.0f} mm outside the footprint; "
                f"it hits walls before the hull does"
            )
        elif contact_m < mount.min_range_m - ROUNDING_M:
            found.append(
                f"{name}: a wall that touches the robot is {1000 * contact_m:.0f} mm from the "
                f"sensor, below its minimum range of {1000 * mount.min_range_m:.0f} mm; it reads "
                f"wrong there, so mount it at least "
                f"{1000 * (mount.min_range_m - contact_m):.0f} mm further inside"
            )
    return found


def load_supervise(path: Path | None) -> SuperviseSettings:
    """Return the supervision settings of a robot file (``[supervise]``), with defaults.

    Raises:
        ConfigError: the file cannot be read or a key is wrong; the text names it.

    """
    _, text = load_robot(path)
    return settings_from(load_toml(text).get(SUPERVISE, {}))


def parse_robot(text: str) -> RobotModel:
    """Read a robot file's text.

    Raises:
        ConfigError: the text is not TOML, keys are unknown, values are out of range, or the robot
            cannot work. The error text lists all errors.

    """
    data = load_toml(text)
    problems: list[str] = []
    try:
        # an invalid rule must be reported before the run, not during the run
        settings_from(data.pop(SUPERVISE, {}))
    except ConfigError as error:
        problems += error.problems
    model = fill(RobotModel(), data, "", problems, also_known=(SUPERVISE,))
    problems += _impossible(model, {problem.partition(":")[0] for problem in problems})
    if problems:
        raise ConfigError(*problems)
    return model


def _impossible(model: RobotModel, wrong: AbstractSet[str]) -> list[str]:
    """Return combinations of values that are impossible although each value is in its range.

    A value in ``wrong`` is unknown, so combinations with this value are not checked.
    """
    found: list[str] = []

    def check(holds: bool, keys: tuple[str, ...], text: str) -> None:  # noqa: FBT001 - a condition
        if not holds and wrong.isdisjoint(keys):
            found.append(text)

    diameter, radius_m = "robot_diameter_m", model.radius_m
    for key in ("cleaning_width_m", "wheel_base_m", "wheel_diameter_m"):
        value = getattr(model, key)
        check(
            value <= model.robot_diameter_m,
            (key, diameter),
            f"{key}: {value:g} must not exceed robot_diameter_m ({model.robot_diameter_m:g})",
        )
    check(
        abs(model.mouth_offset_m) <= radius_m,
        ("mouth_offset_m", diameter),
        f"mouth_offset_m: {model.mouth_offset_m:g} puts the mouth outside the footprint, "
        f"whose radius is {radius_m:g} m",
    )
    check(
        model.cruise_speed_m_s <= model.max_speed_m_s,
        ("cruise_speed_m_s", "max_speed_m_s"),
        f"cruise_speed_m_s: {model.cruise_speed_m_s:g} must not exceed max_speed_m_s "
        f"({model.max_speed_m_s:g})",
    )
    check(
        model.driver_drop_v < model.battery_v,
        ("driver_drop_v", "battery_v"),
        f"driver_drop_v: {model.driver_drop_v:g} must be below battery_v ({model.battery_v:g})",
    )
    for name, mount in model.fitted_rangers.items():
        place = (f"{name}.x_m", f"{name}.y_m", name, diameter)
        out_m = mount.centre_distance_m
        check(
            out_m <= (1.0 + MAX_OVERHANG) * radius_m,
            place,
            f"{name}.x_m, {name}.y_m: the sensor at ({mount.x_m:g}, {mount.y_m:g}) is "
            f"{out_m:.3g} m from the axle's centre, far outside the footprint, whose radius is "
            f"{radius_m:g} m",
        )
        contact_m = mount.contact_range_m(radius_m)
        check(
            contact_m < mount.max_range_m,
            (*place, f"{name}.max_range_m", f"{name}.yaw_rad"),
            f"{name}: a wall that touches the robot is {1000 * contact_m:.0f} mm from the sensor, "
            f"beyond its maximum range of {1000 * mount.max_range_m:.0f} mm; mount it further "
            f"outside, or set {name}.fitted = false",
        )
        check(
            mount.min_range_m < mount.max_range_m,
            (f"{name}.min_range_m", f"{name}.max_range_m", name),
            f"{name}.min_range_m: {mount.min_range_m:g} must be below {name}.max_range_m "
            f"({mount.max_range_m:g})",
        )
        yaw = (f"{name}.yaw_rad", name)
        direction, share = {
            "ultrasonic": ("forward", math.cos(mount.yaw_rad)),
            "infrared_left": ("to the left (yaw_rad near 1.571)", math.sin(mount.yaw_rad)),
            "infrared_right": ("to the right (yaw_rad near -1.571)", -math.sin(mount.yaw_rad)),
        }[name]
        check(share > 0.0, yaw, f"{name}.yaw_rad: {mount.yaw_rad:g} does not face {direction}")
    return found


def to_toml(model: RobotModel) -> str:
    """Return the model as the text of a robot file, for :func:`parse_robot`."""
    plain: list[str] = []
    tables: list[str] = []
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        if isinstance(value, RangerMount):
            tables.append(f"\n[{field.name}]")
            tables += [f"{k} = {as_toml(v)}" for k, v in dataclasses.asdict(value).items()]
        else:
            plain.append(f"{field.name} = {as_toml(value)}")
    return "\n".join(plain + tables) + "\n"


def template() -> str:
    """Return a robot file of the default robot. Each key has its unit, range and meaning.

    The supervision rules are commented out, because their defaults rarely need a change.
    """
    model, rules = RobotModel(), SuperviseSettings()
    plain = [
        "# A robot file. `sweepctl robot check FILE` names everything that is wrong in it.",
        "",
    ]
    tables: list[str] = []
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        if isinstance(value, RangerMount):
            tables += ["", f"# {field.metadata['meaning']}", f"[{field.name}]"]
            tables += _explained(value)
        else:
            plain.append(_line(field, value))
    tables += [
        "",
        "# Rules that watch a run; uncomment what you change, and the header of its table.",
    ]
    tables.append(f"# [{SUPERVISE}]")
    tables += [f"# {line}" for line in _explained(rules)]
    for name, rule in rules.rules.items():
        tables += ["", f"# {_sentence(rule)}", f"# [{SUPERVISE}.{name}]"]
        tables += [f"# {line}" for line in _explained(rule)]
    return "\n".join(plain + tables) + "\n"


def _explained(table: DataclassInstance) -> list[str]:
    values = [(field, getattr(table, field.name)) for field in dataclasses.fields(table)]
    return [_line(field, value) for field, value in values if not dataclasses.is_dataclass(value)]


def _line(field: dataclasses.Field[Any], value: object) -> str:
    """Return one key with its value, and its meaning as a comment."""
    text = f"{field.name} = {as_toml(value)}"
    parts = [field.metadata.get("meaning", "").replace("`", "")]
    if "range" in field.metadata:
        low, high = field.metadata["range"]
        unit = field.metadata["unit"]
        parts.append(f"{low:.7g} to {high:.7g}" + ("" if unit == "1" else f" {unit}"))
    elif isinstance(value, Level):
        parts.append(", ".join(level.name.lower() for level in Level))
    comment = "; ".join(part for part in parts if part)
    return f"{text}  # {comment}" if comment else text


def _sentence(table: object) -> str:
    """Return the first line of a table's docstring."""
    return (type(table).__doc__ or "").splitlines()[0]
