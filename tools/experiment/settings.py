"""The tuned constants of planner, controllers and estimation, and runs with other values of them.

Every numeric field of the config dataclasses is a constant. The name of a constant consists of its
group and its field, such as ``planner.min_rate``. A group has the name of the field that holds its
dataclass.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.estimation.tuning import EstimationTuning


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


def groups(config: Any) -> dict[str, Any]:  # noqa: ANN401 - any config dataclass
    """Return the dataclasses within a config dataclass, also indirectly, by their groups."""
    found: dict[str, Any] = {}
    for each in dataclasses.fields(config):
        value = getattr(config, each.name)
        if dataclasses.is_dataclass(value):
            found |= {each.name: value, **groups(value)}
    return found


def _changed(config: Any, group: str, change: dict[str, Any]) -> Any:  # noqa: ANN401 - as above
    """Return a config dataclass with other values in one of its groups."""
    inner = {}
    for each in dataclasses.fields(config):
        value = getattr(config, each.name)
        if each.name == group:
            inner[group] = dataclasses.replace(value, **change)
        elif dataclasses.is_dataclass(value):
            inner[each.name] = _changed(value, group, change)
    return dataclasses.replace(config, **inner)


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
