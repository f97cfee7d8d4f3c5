"""The tuned constants of planner, controllers and estimation, and runs with other values of them.

Every numeric field of the config dataclasses is a constant. The name of a constant consists of its
group and its field, such as ``planner.min_rate``. A group has the name of the field that holds its
dataclass.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.estimation.tuning import EstimationTuning

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_Config = TypeVar("_Config", bound="DataclassInstance")


@dataclass(frozen=True, slots=True)
class Settings:
    """The config of one run."""

    planner: RecoveryOptions = field(default_factory=RecoveryOptions)
    motion: MotionTuning = field(default_factory=MotionTuning)
    estimation: EstimationTuning = field(default_factory=EstimationTuning)


def constants() -> dict[str, float]:
    """Return every constant with its default."""
    found: dict[str, float] = {}
    for group, values in groups(Settings()).items():
        for each in dataclasses.fields(values):
            value = getattr(values, each.name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and value and math.isfinite(value):
                found[f"{group}.{each.name}"] = value
    return found


def inner(config: DataclassInstance) -> dict[str, DataclassInstance]:
    """Return the dataclasses that are fields of a dataclass, by their names."""
    values = {each.name: getattr(config, each.name) for each in dataclasses.fields(config)}
    return {
        name: value
        for name, value in values.items()
        if dataclasses.is_dataclass(value) and not isinstance(value, type)
    }


def groups(config: DataclassInstance) -> dict[str, DataclassInstance]:
    """Return the dataclasses within a dataclass, also indirectly, by their groups."""
    found = inner(config)
    for value in list(found.values()):
        found |= groups(value)
    return found


def _changed(config: _Config, group: str, change: dict[str, float]) -> _Config:
    """Return a dataclass with other values in one of its groups."""
    changes: dict[str, Any] = {}
    for name, value in inner(config).items():
        is_group = name == group
        changes[name] = (
            dataclasses.replace(value, **change) if is_group else _changed(value, group, change)
        )
    return dataclasses.replace(config, **changes)


def scaled(name: str, factor: float) -> float:
    """Return a constant multiplied by a factor; the result is an integer if the constant is one."""
    value = constants()[name]
    if not isinstance(value, int):
        return value * factor
    changed = round(value * factor)
    if changed == value:
        changed += 1 if factor > 1.0 else -1
    return max(changed, 0)


def settings_of(options: str) -> Settings:
    """Return the settings from ``NAME=VALUE`` texts, separated by commas; empty: the defaults."""
    settings = Settings()
    for part in filter(None, options.split(",")):
        name, _, text = part.partition("=")
        group, _, key = name.partition(".")
        kind = type(constants()[name])
        settings = _changed(settings, group, {key: kind(float(text))})
    return settings
