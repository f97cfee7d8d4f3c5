"""Device parameters as named values in their units, with range checks."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from bridge.errors import ParameterError, shown
from bridge.spelling import nearest
from protocol.messages.values import ParameterFlag, ParameterKind, label
from protocol.parameter_values import from_raw, rounded_f32, to_raw

if TYPE_CHECKING:
    from protocol.messages.device import ParameterValue

_VALUES = ("value", "default", "low", "high")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of the device; ``value``, ``default``, ``low`` and ``high`` in ``unit``."""

    number: int
    name: str
    unit: str
    kind: str
    """``u32`` or ``f32``; ``unknown(7)`` for a kind that this version lacks."""
    value: float
    default: float
    low: float
    high: float
    stored: bool
    """True if the value survives a reset."""
    changed: bool
    """True if the value differs from the stored value."""
    read_only: bool
    needs_reboot: bool
    """True if a change takes effect at the next boot."""

    @classmethod
    def from_message(cls, message: ParameterValue) -> Parameter:
        """Create a parameter from the device's message."""
        name, _, unit = message.name.partition(" ")
        kind, flags = message.kind, message.flags
        return cls(
            message.parameter,
            name,
            unit,
            label(ParameterKind, kind),
            from_raw(kind, message.value),
            from_raw(kind, message.default),
            from_raw(kind, message.low),
            from_raw(kind, message.high),
            bool(flags & ParameterFlag.STORED),
            bool(flags & ParameterFlag.CHANGED),
            bool(flags & ParameterFlag.READ_ONLY),
            bool(flags & ParameterFlag.NEEDS_REBOOT),
        )

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Parameter:
        """Create a parameter from the result of :meth:`to_dict`.

        Raises:
            ParameterError: ``fields`` has missing, unknown or invalid entries.

        """
        try:
            texts = {n: float(fields[n]) for n in _VALUES if isinstance(fields.get(n), str)}
            return cls(**{**fields, **texts})
        except (TypeError, ValueError) as error:
            raise ParameterError(f"invalid parameter object: {error}") from None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields for JSON, which has no NaN: nan, inf and -inf become text."""
        fields = asdict(self)
        odd = {n: str(fields[n]) for n in _VALUES if not math.isfinite(fields[n])}
        return fields | odd

    def raw(self, value: float | str) -> int:
        """Convert a value to the 32 bits of the wire format.

        Raises:
            ParameterError: the parameter is read-only, or the value has the wrong kind or range.
                The text names the parameter, the value and the range.

        """
        if self.read_only:
            raise ParameterError(f"{self.name} is read-only and cannot be set")
        number = self._number(value)
        if not self.low <= number <= self.high:
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(
                f"{self.name}: {number:g} is not in {self.low:g} to {self.high:g}{unit}"
            )
        return to_raw(ParameterKind.F32 if self.kind == "f32" else ParameterKind.U32, number)

    def _number(self, value: float | str) -> float:
        if isinstance(value, bool):  # float(True) is 1.0: 1 m/s for a top speed
            raise ParameterError(f"{self.name}: {shown(value)} is not a number")
        try:
            number = float(value)
        except (ValueError, OverflowError):  # OverflowError: an integer beyond float range
            raise ParameterError(f"{self.name}: {shown(value)} is not a number") from None
        if not math.isfinite(number):
            raise ParameterError(f"{self.name}: {value} is not a finite number")
        if self.kind == "f32":
            # Round to 32 bits as the wire format does, because the range's limits have 32 bits too.
            try:
                return rounded_f32(number)
            except OverflowError:
                return number
        if number != int(number):
            raise ParameterError(f"{self.name}: {value} is not a whole number")
        return number


def closest(name: str, known: list[str]) -> str:
    """Return the error text for an unknown parameter name, with the nearest known name."""
    near = nearest(name, known)
    hint = f"; did you mean {near}?" if near else f"; use one of {', '.join(known)}"
    return f"the device has no parameter {shown(name)}{hint}"
