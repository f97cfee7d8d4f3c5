"""The tuned constants of planner, controllers and filter, and runs with other values of them.

Every numeric field of the config dataclasses is a constant. The name of a constant consists of its
group and its field, such as ``planner.min_rate``.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.estimation.drift_model import DriftModel

_NESTED = ("follow", "hidden", "rotary", "distance", "bearing")
"""Groups that are config dataclasses within the group ``motion``."""


class Settings(NamedTuple):
    """The config of one run."""

    planner: RecoveryOptions = RecoveryOptions()
    motion: MotionTuning = MotionTuning()
    drift: DriftModel = DriftModel()


def constants() -> dict[str, float]:
    """Return every constant with its default."""
    found: dict[str, float] = {}
    for group, values in _groups(Settings()).items():
        for field in dataclasses.fields(values):
            value = getattr(values, field.name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and value and math.isfinite(value):
                found[f"{group}.{field.name}"] = value
    return found


def _groups(settings: Settings) -> dict[str, Any]:
    return {
        "planner": settings.planner,
        "motion": settings.motion,
        **{name: getattr(settings.motion, name) for name in _NESTED},
        "drift": settings.drift,
    }


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
        group, _, field = name.partition(".")
        kind = type(constants()[name])
        change: dict[str, Any] = {field: kind(float(text))}
        match group:
            case "planner":
                settings = settings._replace(
                    planner=dataclasses.replace(settings.planner, **change)
                )
            case "drift":
                settings = settings._replace(drift=dataclasses.replace(settings.drift, **change))
            case "motion":
                settings = settings._replace(motion=dataclasses.replace(settings.motion, **change))
            case _:
                nested = dataclasses.replace(getattr(settings.motion, group), **change)
                settings = settings._replace(
                    motion=dataclasses.replace(settings.motion, **{group: nested})
                )
    return settings
