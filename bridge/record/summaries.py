"""Validation of a run's summary in a log."""

from __future__ import annotations

import json
import math
from typing import Any

_NUMBERS = (
    *("seed", "duration_s", "path_m", "turns", "collisions", "contact_s", "energy_wh"),
    *("t90_s", "t99_s", "largest_hole_cm2", "hole_inradius_m", "repeat_ratio"),
)
_TEXTS = ("room", "planner", "outcome", "reason", "log")
_TABLES: dict[str, tuple[str, ...]] = {
    "coverage": ("mouth_sweepable", "mouth_free", "body_reachable", "body_free", "eq8"),
    "pose_error_m": ("end", "max"),
    "wire": ("lost", "crc_errors"),
}
_ADDED = {"coverage": ("mouth_passing",)}
"""Keys that a later version added, by table. Older logs do not have these keys."""
_LARGEST = 1e300
"""Maximum absolute value of a number that is accepted. JSON integers have no limit; floats have."""
_BY_DIRECTION = ("frames", "bytes")
_SHOWN = {
    *("room", "planner", "outcome", "reason", "seed", "duration_s", "path_m", "turns"),
    *("collisions", "energy_wh", "t90_s", "t99_s", "largest_hole_cm2"),
}


def read_summary(data: bytes) -> dict[str, Any] | None:
    """Return the summary as a dict, or None if ``data`` is not a JSON object.

    Known keys with a value of the wrong type are removed. NaN and infinity become null.
    """
    try:
        value = json.loads(data, parse_constant=lambda _: None, parse_float=_finite)
    except (ValueError, RecursionError):
        return None
    if not isinstance(value, dict):
        return None
    return {key: entry for key, entry in value.items() if _is_ours(key, entry)}


def is_run(summary: dict[str, Any]) -> bool:
    """Return True for the summary of a run. Summaries of bring-up commands do not have all keys."""
    if not summary.keys() >= _SHOWN:
        return False
    if not all(summary.get(name, {}).keys() >= {*keys} for name, keys in _TABLES.items()):
        return False
    return all(summary["wire"].get(name, {}).keys() >= {"rx", "tx"} for name in _BY_DIRECTION)


def _finite(text: str) -> float | None:
    number = float(text)
    return number if math.isfinite(number) else None


def _is_ours(key: str, value: Any) -> bool:  # noqa: ANN401 - any JSON value
    if key in _TABLES:
        return isinstance(value, dict) and _is_table(key, value)
    if value is None:
        return True
    return _is_number(value) if key in _NUMBERS else key not in _TEXTS or isinstance(value, str)


def _is_table(key: str, value: dict[str, Any]) -> bool:
    names = (*_TABLES[key], *_ADDED.get(key, ()))
    if not all(value.get(name) is None or _is_number(value[name]) for name in names):
        return False
    ways = [value[name] for name in _BY_DIRECTION if key == "wire" and name in value]
    return all(
        isinstance(way, dict) and all(_is_number(way.get(end, 0)) for end in ("rx", "tx"))
        for way in ways
    )


def _is_number(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST
