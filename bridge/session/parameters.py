"""A device's parameters as people and programs see them: by name, in their unit, checked."""

from __future__ import annotations

import math
import struct
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from bridge.errors import ParameterError, shown
from bridge.spelling import nearest
from protocol.values import ParameterFlag, ParameterKind, label

if TYPE_CHECKING:
    from protocol.messages import ParameterValue

_F32 = struct.Struct("<f")
_I32 = struct.Struct("<i")
_U32 = struct.Struct("<I")
_TRUE, _FALSE = frozenset({"true", "on", "yes", "1"}), frozenset({"false", "off", "no", "0"})
_VALUES = ("value", "default", "low", "high")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of the device; ``value``, ``default``, ``low`` and ``high`` in ``unit``."""

    number: int
    name: str
    unit: str
    kind: str
    """``u32``, ``i32``, ``f32`` or ``bool``; ``unknown(7)`` where this program knows no such."""
    value: float
    default: float
    low: float
    high: float
    stored: bool
    """The value survives a reset."""
    changed: bool
    """The value differs from the stored one."""
    read_only: bool
    needs_reboot: bool
    """A change counts from the next boot on."""

    @classmethod
    def from_message(cls, message: ParameterValue) -> Parameter:
        """What the device told of it."""
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
        """The inverse of :meth:`to_dict`.

        Raises:
            ParameterError: it is not such an object.

        """
        try:
            texts = {n: float(fields[n]) for n in _VALUES if isinstance(fields.get(n), str)}
            return cls(**{**fields, **texts})
        except (TypeError, ValueError) as error:
            raise ParameterError(f"not a parameter: {error}") from None

    def to_dict(self) -> dict[str, Any]:
        """For JSON, which has no infinite numbers: these are the texts nan, inf and -inf."""
        fields = asdict(self)
        odd = {n: str(fields[n]) for n in _VALUES if not math.isfinite(fields[n])}
        return fields | odd

    def raw(self, value: float | str) -> int:
        """The 32 bits of a value, which must be of the parameter's kind and in its range.

        Raises:
            ParameterError: it is not; the text names the parameter, the value and the range.

        """
        if self.read_only:
            raise ParameterError(f"{self.name} is read-only")
        number = self._number(value)
        if not self.low <= number <= self.high and self.kind != "bool":
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(
                f"{self.name}: {number:g} is not in {self.low:g} to {self.high:g}{unit}"
            )
        return to_raw(self.kind, number)

    def _number(self, value: float | str) -> float:
        if self.kind == "bool":
            text = str(value).lower()
            if text not in _TRUE | _FALSE:
                raise ParameterError(f"{self.name}: {shown(value)} is not true or false")
            return float(text in _TRUE)
        if isinstance(value, bool):  # true is 1 to float(): 1 m/s for a top speed
            raise ParameterError(f"{self.name}: {shown(value)} is not a number")
        try:
            number = float(value)
        except (ValueError, OverflowError):  # an integer beyond a float's range
            raise ParameterError(f"{self.name}: {shown(value)} is not a number") from None
        if not math.isfinite(number):
            raise ParameterError(f"{self.name}: {value} is not a finite number")
        if self.kind == "f32":
            # As it travels: the ends of the range are 32 bits wide too.
            try:
                rounded: float = _F32.unpack(_F32.pack(number))[0]
            except OverflowError:
                return number
            return rounded
        if number != int(number):
            raise ParameterError(f"{self.name}: {value} is not a whole number")
        return number


def from_raw(kind: int, raw: int) -> float:
    """Value of 32 bits; a float may be infinite or not a number."""
    if kind == ParameterKind.F32:
        value: float = _F32.unpack(_U32.pack(raw))[0]
        return value
    if kind == ParameterKind.I32:
        signed: int = _I32.unpack(_U32.pack(raw))[0]
        return signed
    return raw


def to_raw(kind: str, value: float) -> int:
    """32 bits of a value that is known to fit."""
    if kind == "f32":
        raw: int = _U32.unpack(_F32.pack(value))[0]
        return raw
    return int(value) & 0xFFFF_FFFF


def closest(name: str, known: list[str]) -> str:
    """What to tell of a name that no parameter has."""
    near = nearest(name, known)
    hint = f"; did you mean {near}?" if near else f"; there are {', '.join(known)}"
    return f"the device has no parameter {shown(name)}{hint}"
