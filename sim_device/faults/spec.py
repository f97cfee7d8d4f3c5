"""A fault as text: ``kind@time[:for][:name=value,...]``, read and written; and its parts.

Times are seconds since the device was switched on. Without ``@time`` a fault begins at once
(for what is switched on while a device runs), and ``@+2`` is two seconds from now.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim_device.faults.knobs import Knobs

MAX_TIME_S = 1e7
MAX_TEXT = 200
Value = float | str


class FaultSpecError(ValueError):
    """A fault's text that cannot be used."""

    def __init__(self, text: str, reason: str) -> None:
        """Keep the text as it was given, and what is wrong with it and what would do."""
        self.text, self.reason = text, reason
        super().__init__(f"fault {text[:MAX_TEXT]!r}: {reason}")


@dataclass(frozen=True, slots=True)
class Number:
    """An argument that is a number in a range."""

    name: str
    meaning: str
    unit: str
    default: float
    low: float
    high: float

    @property
    def allowed(self) -> str:
        """The range in words."""
        return f"{self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"

    def parse(self, text: str) -> float:
        """Read a value.

        Raises:
            ValueError: it is no number, or out of range.

        """
        value = float(text)
        if not self.low <= value <= self.high:  # "nan" is in no range
            raise ValueError(text)
        return value


@dataclass(frozen=True, slots=True)
class Choice:
    """An argument that is one of some words."""

    name: str
    meaning: str
    choices: tuple[str, ...]
    default: str

    unit = ""

    @property
    def allowed(self) -> str:
        """The words."""
        return ", ".join(self.choices)

    def parse(self, text: str) -> str:
        """Read a value.

        Raises:
            ValueError: it is none of them.

        """
        if text not in self.choices:
            raise ValueError(text)
        return text


Argument = Number | Choice


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A kind of fault, declared once.

    Exactly one of ``turn`` and ``strike`` is given: a lasting fault turns knobs for as long as
    it is active; one that is over at once strikes the device.
    """

    name: str
    meaning: str
    example: str
    arguments: tuple[Argument, ...] = ()
    turn: Callable[[Knobs, Mapping[str, Value]], None] | None = None
    strike: str | None = None
    """Name of what is done to the device: a method of :class:`sim_device.faults.bench.Bench`."""
    default_for_s: float | None = None
    """Default duration, s; ``None``: until it is cleared."""

    @property
    def lasting(self) -> bool:
        """Whether it has a duration."""
        return self.turn is not None

    def argument(self, name: str) -> Argument | None:
        """The argument of this name."""
        return next((a for a in self.arguments if a.name == name), None)


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One fault that is asked for."""

    kind: FaultKind
    at_s: float | None
    """Seconds since the device was switched on; None: now."""
    for_s: float | None
    """How long; None: until it is cleared, or over at once."""
    values: Mapping[str, Value]
    relative: bool = False
    """``at_s`` counts from the moment in which the fault is asked for."""

    @property
    def text(self) -> str:
        """The fault as text, every argument spelled out; reading it gives an equal fault."""
        at = "" if self.at_s is None else f"@{'+' if self.relative else ''}{_number(self.at_s)}"
        lasts = "" if self.for_s is None else f":{_number(self.for_s)}"
        values = ",".join(
            f"{name}={value if isinstance(value, str) else _number(value)}"
            for name, value in self.values.items()
        )
        return f"{self.kind.name}{at}{lasts}{':' if values else ''}{values}"


def _number(value: float) -> str:
    text = repr(float(value))
    return text.removesuffix(".0")


def parse_spec(text: str, kinds: Mapping[str, FaultKind], *, timed: bool = True) -> FaultSpec:
    """Read ``kind@time[:for][:name=value,...]``.

    Values may also be given without their names, in the order of the kind's arguments. With
    ``timed`` a time is required, since there is no "now" to begin at.

    Raises:
        FaultSpecError: it names no kind, or a time or a value that cannot be.

    """
    head, *rest = text.strip().split(":")
    name, at_sign, at = head.partition("@")
    kind = _kind(text, name, kinds)
    if timed and not at_sign:
        raise FaultSpecError(text, f"when? write {name}@SECONDS, since the device was switched on")
    relative = not timed and at.startswith("+")
    at_s = _seconds(text, "time", at) if at_sign else None
    for_s = kind.default_for_s
    if rest and (not rest[0] or _is_number(rest[0]) or _is_duration(rest[0])):
        first = rest.pop(0)
        if first and kind.lasting:
            for_s = _seconds(text, "duration", first)
        elif first:
            raise FaultSpecError(text, f"{kind.name} is over at once: it takes no duration")
    if len(rest) > 1:
        raise FaultSpecError(text, "too many colons: write kind@time[:for][:name=value,...]")
    values = _values(text, kind, rest[0] if rest else "")
    return FaultSpec(kind, at_s, for_s, values, relative)


def _kind(text: str, name: str, kinds: Mapping[str, FaultKind]) -> FaultKind:
    kind = kinds.get(name.strip().replace("_", "-"))
    if kind is not None:
        return kind
    near = difflib.get_close_matches(name, kinds, 1)
    hint = f"did you mean {near[0]}?" if near else f"the kinds are {', '.join(kinds)}"
    raise FaultSpecError(text, f"there is no kind {name[:40]!r}; {hint}")


def _is_duration(text: str) -> bool:
    """Whether a part that is no plain number was meant as a time: it has a unit of time."""
    return "=" not in text and (_is_number(text.removesuffix("ms")) or _is_number(text[:-1]))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _seconds(text: str, what: str, value: str) -> float:
    number, factor = value.strip(), 1.0
    if number.endswith("ms"):
        number, factor = number[:-2], 1e-3
    elif number.endswith("s"):
        number = number[:-1]
    try:
        seconds = float(number) * factor
    except ValueError:
        seconds = math.nan
    if not 0.0 <= seconds <= MAX_TIME_S or "_" in number:
        raise FaultSpecError(
            text, f"{what} {value[:40]!r} is not a number of seconds from 0 to {MAX_TIME_S:g}"
        )
    return seconds


def _values(text: str, kind: FaultKind, part: str) -> dict[str, Value]:
    given: dict[str, str] = {}
    items = [item.strip() for item in part.split(",")] if part else []
    for position, item in enumerate(items):
        name, equals, value = item.partition("=")
        if not equals:  # by its place
            if position >= len(kind.arguments):
                raise FaultSpecError(text, f"{item[:40]!r} is too much; {_takes(kind)}")
            name, value = kind.arguments[position].name, item
        name = name.strip().replace("_", "-")
        if kind.argument(name) is None:
            raise FaultSpecError(text, f"{kind.name} has no {name[:40]!r}; {_takes(kind)}")
        if name in given:
            raise FaultSpecError(text, f"{name} is given twice")
        given[name] = value.strip()
    values: dict[str, Value] = {}
    for argument in kind.arguments:
        if argument.name not in given:
            values[argument.name] = argument.default
            continue
        try:
            values[argument.name] = argument.parse(given[argument.name])
        except ValueError:
            raise FaultSpecError(
                text,
                f"{argument.name} {given[argument.name][:40]!r} is not in {argument.allowed}",
            ) from None
    return values


def _takes(kind: FaultKind) -> str:
    if not kind.arguments:
        return "it takes no arguments"
    return f"it takes {', '.join(a.name for a in kind.arguments)}"
