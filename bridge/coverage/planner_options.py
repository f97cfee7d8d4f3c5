"""Planner options by name, from the text of ``--planner-option NAME=VALUE``."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from collections.abc import Iterable

Options = TypeVar("Options")

_BOOLEANS = {"true": True, "false": False}


@dataclass(frozen=True, slots=True)
class NoOptions:
    """Options of a planner that has no options."""


class PlannerOptionError(ValueError):
    """An unknown planner option or an invalid value."""


def option_names(kind: type[Any]) -> list[str]:
    """Return the names of the options that a text can set.

    They are numbers, one of several words, and true or false.
    """
    return [field.name for field in fields(kind) if _expected(_hint(kind, field.name))]


def parse_options(kind: type[Options], texts: Iterable[str]) -> Options:
    """Return options with the given values, and defaults for all other options.

    Args:
        kind: a dataclass whose fields all have defaults.
        texts: ``name=value`` each; lengths in m, times in s, angles in rad.

    Raises:
        PlannerOptionError: an option is unknown or a value is invalid. The text names it.

    """
    names, values = option_names(kind), {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator:
            raise PlannerOptionError(f"{text!r} is not NAME=VALUE")
        if name not in names:
            raise PlannerOptionError(f"no option {name!r}; there are: {', '.join(names) or 'none'}")
        if name in values:
            raise PlannerOptionError(f"{name} is given twice")
        hint = _hint(kind, name)
        values[name] = _read(hint, value)
        if values[name] is None:
            raise PlannerOptionError(f"{text!r}: not {_expected(hint)}")
    return kind(**values)


def _hint(kind: type[Any], name: str) -> Any:  # noqa: ANN401 - any form of a type
    return get_type_hints(kind)[name]


def _expected(hint: Any) -> str:  # noqa: ANN401 - as above
    """Describe the valid values. Return an empty text if no text can set the option."""
    if get_origin(hint) is Literal:
        return "one of " + ", ".join(get_args(hint))
    return {
        bool: "true or false",
        int: "a whole number from 0",
        float: "a number from 0",
    }.get(hint, "")


def _read(hint: Any, text: str) -> bool | float | str | None:  # noqa: ANN401 - as above
    """Return the value of ``text``; None if it is invalid."""
    if get_origin(hint) is Literal:
        return text if text in get_args(hint) else None
    if hint is bool:
        return _BOOLEANS.get(text.lower())
    try:
        number = hint(text)
    except ValueError:
        return None
    return number if 0 <= number < math.inf else None
