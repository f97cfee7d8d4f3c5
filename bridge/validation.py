"""Conversion of TOML tables to dataclasses. Every error contains its key.

A field's type is the type of its default. The field's metadata may contain ``range`` (minimum and
maximum of a number) or ``read`` (a function of path and value, for other types).
"""

from __future__ import annotations

import dataclasses
import enum
import tomllib
from typing import TYPE_CHECKING, Any, TypeVar

from bridge.errors import ConfigError, shown
from bridge.spelling import unknown_key

if TYPE_CHECKING:
    from collections.abc import Mapping

    from _typeshed import DataclassInstance

MAX_TEXT = 64
"""Maximum length of a text, characters."""
_T = TypeVar("_T", bound="DataclassInstance")


def load_toml(text: str, source: str = "") -> dict[str, Any]:
    """Read a TOML text.

    Raises:
        ConfigError: the text is not TOML; the error starts with ``source``, the name of the file.

    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"not valid TOML: {error}", source=source) from None
    except ValueError:  # Python limits the digits of an integer
        raise ConfigError("not valid TOML: a number has too many digits", source=source) from None


def fill(
    base: _T,
    table: dict[str, Any],
    path: str,
    problems: list[str],
    *,
    also_known: tuple[str, ...] = (),
) -> _T:
    """Return ``base`` with the values of a table.

    Args:
        base: The defaults.
        table: The table from the TOML file.
        path: The table's name and a dot; empty for the file's top.
        problems: Receives the errors.
        also_known: Keys that other code reads.

    """
    fields = {each.name: each for each in dataclasses.fields(base)}
    changes: dict[str, Any] = {}
    for key, value in table.items():
        if key not in fields:
            problems.append(unknown_key(path, key, [*fields, *also_known]))
            continue
        try:
            default = getattr(base, key)
            changes[key] = _value(f"{path}{key}", default, value, fields[key].metadata, problems)
        except ConfigError as error:
            problems += error.problems
    return dataclasses.replace(base, **changes)


def number(path: str, value: object, low: float, high: float) -> float:
    """Read a number.

    Raises:
        ConfigError: the value is not a number, or is out of range.

    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{path}: {shown(value)} is not a number")
    if not low <= value <= high:  # "nan" is in no range
        raise ConfigError(f"{path}: {shown(value)} is out of range {low:g}..{high:g}")
    return float(value)


def _value(
    path: str,
    default: object,
    value: object,
    metadata: Mapping[str, Any],
    problems: list[str],
) -> object:
    if "read" in metadata:
        return metadata["read"](path, value)
    if dataclasses.is_dataclass(default) and not isinstance(default, type):
        if not isinstance(value, dict):
            raise ConfigError(f"{path}: must be a table")
        return fill(default, value, f"{path}.", problems)
    if isinstance(default, enum.Enum):
        return _member(path, type(default), value)
    if isinstance(default, bool | str):
        return _word(path, default, value)
    checked = number(path, value, *metadata["range"])
    if not isinstance(default, int):
        return checked
    if not isinstance(value, int):
        raise ConfigError(f"{path}: {value!r} is not a whole number")
    return value


def _word(path: str, default: bool | str, value: object) -> bool | str:  # noqa: FBT001 - a default of either type, not a flag
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise ConfigError(f"{path}: must be true or false")
        return value
    if not isinstance(value, str) or not 0 < len(value) <= MAX_TEXT:
        raise ConfigError(f"{path}: must be a text of 1 to {MAX_TEXT} characters")
    return value


def _member(path: str, kind: type[enum.Enum], value: object) -> enum.Enum:
    members = {member.name.lower(): member for member in kind}
    if not isinstance(value, str) or value not in members:
        raise ConfigError(f"{path}: {shown(value)} is not one of {', '.join(members)}")
    return members[value]


def as_toml(value: object) -> str:
    """Return a value as TOML text that :func:`fill` can read."""
    if isinstance(value, enum.Enum):
        return f'"{value.name.lower()}"'
    if isinstance(value, str):
        return f'"{"".join(_escaped(character) for character in value)}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(as_toml(each) for each in value)}]"
    return repr(value)


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    return character if character.isprintable() else f"\\U{ord(character):08x}"
