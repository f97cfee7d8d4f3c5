"""Parses and writes the text form of a fault: ``kind@time[:for][:name=value,...]``.

The time is the start in seconds since power-on of the device, ``for`` is the duration. ``@+2``
means two seconds from now. A fault for a running device may omit ``@time``; it then starts at once.
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
    """An invalid fault text."""

    def __init__(self, text: str, reason: str) -> None:
        """Store the text, and the reason with the valid form."""
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
        """Return the allowed range as text."""
        return f"{self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"

    def parse(self, text: str) -> float:
        """Parse a value.

        Raises:
            ValueError: the text is not a number, or the number is out of range.

        """
        value = float(text)
        if not self.low <= value <= self.high:  # also true for "nan"
            raise ValueError(text)
        return value


@dataclass(frozen=True, slots=True)
class Choice:
    """An argument with a fixed set of allowed words."""

    name: str
    meaning: str
    choices: tuple[str, ...]
    default: str

    unit = ""

    @property
    def allowed(self) -> str:
        """Return the allowed words as text."""
        return ", ".join(self.choices)

    def parse(self, text: str) -> str:
        """Parse a value.

        Raises:
            ValueError: the text is not an allowed word.

        """
        if text not in self.choices:
            raise ValueError(text)
        return text


Argument = Number | Choice


@dataclass(frozen=True, slots=True)
class FaultKind:
    """Declaration of a kind of fault.

    Exactly one of ``turn`` and ``strike`` is set. ``turn`` changes knobs while a lasting fault is
    active. ``strike`` is the name of the method that applies a momentary fault.
    """

    name: str
    meaning: str
    example: str
    arguments: tuple[Argument, ...] = ()
    turn: Callable[[Knobs, Mapping[str, Value]], None] | None = None
    strike: str | None = None
    """Name of the method of :class:`.fault_target.FaultTarget` that applies a momentary fault."""
    default_for_s: float | None = None
    """Default duration, s; ``None``: until the fault is cleared."""

    @property
    def lasting(self) -> bool:
        """Return whether faults of this kind have a duration."""
        return self.turn is not None

    def argument(self, name: str) -> Argument | None:
        """Return the argument with this name, or None."""
        return next((a for a in self.arguments if a.name == name), None)


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One requested fault."""

    kind: FaultKind
    at_s: float | None
    """Start, s since power-on of the device; ``None``: now."""
    for_s: float | None
    """Duration, s; ``None``: until cleared, or momentary."""
    values: Mapping[str, Value]
    relative: bool = False
    """True: ``at_s`` is relative to the time of the request."""

    @property
    def text(self) -> str:
        """Return the fault as text with all arguments; parsing this text gives an equal fault."""
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
    """Parse ``kind@time[:for][:name=value,...]``.

    Values may also be given without names, in the order of the kind's arguments. With ``timed`` a
    start time is required, because the device does not run yet and "at once" has no meaning.

    Raises:
        FaultSpecError: the kind is unknown, or a time or a value is invalid.

    """
    head, *rest = text.strip().split(":")
    name, at_sign, at = head.partition("@")
    kind = _kind(text, name, kinds)
    if timed and not at_sign:
        raise FaultSpecError(
            text, f"no time: write {name}@SECONDS, counted from the device's power-on"
        )
    relative = not timed and at.startswith("+")
    at_s = _seconds(text, "time", at) if at_sign else None
    for_s = kind.default_for_s
    if rest and (not rest[0] or _is_number(rest[0]) or _is_duration(rest[0])):
        first = rest.pop(0)
        if first and kind.lasting:
            for_s = _seconds(text, "duration", first)
        elif first:
            raise FaultSpecError(text, f"{kind.name} is instantaneous: it has no duration")
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
    """Return whether a part of the text is a duration with a unit of time."""
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
        if not equals:  # an argument without a name
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
