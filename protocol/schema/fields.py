"""Wire types and field declarations for the catalogue.

A message is a class whose annotations each contain a :class:`Field`. A message
stores the raw integers of the payload, so decoding is fast and logs are exact. :func:`si` and
:func:`si_or_none` add properties with the values in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, overload

if TYPE_CHECKING:
    from enum import IntEnum


@dataclass(frozen=True, slots=True)
class WireType:
    """Layout of a value on the wire: little-endian, no padding."""

    name: str
    code: str
    """``struct`` format character; empty for text."""
    size: int
    """Size, bytes; 0 for a text, which has a variable length."""
    low: int = 0
    high: int = 0

    @property
    def is_text(self) -> bool:
        """True if the type is UTF-8 text up to the payload's end; only for the last field."""
        return self.name == "text"

    @property
    def is_integer(self) -> bool:
        """True if the type is a number."""
        return self.high > self.low


U8 = WireType("u8", "B", 1, 0, 0xFF)
U16 = WireType("u16", "H", 2, 0, 0xFFFF)
U32 = WireType("u32", "I", 4, 0, 0xFFFF_FFFF)
I16 = WireType("i16", "h", 2, -0x8000, 0x7FFF)
UID96 = WireType("uid96", "12s", 12)
TEXT = WireType("text", "", 0)

Exact = int | str | Fraction
"""Number without rounding, in a form that every language can read exactly: ``"9.80665/16384"``,
``"0.001"`` or 2."""


def exact(value: Exact) -> Fraction:
    """Convert ``"a/b"`` (decimal numbers) or a plain number to a fraction, without rounding."""
    if isinstance(value, str) and "/" in value:
        numerator, denominator = value.split("/")
        return Fraction(numerator) / Fraction(denominator)
    return Fraction(value)


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message: ``physical = raw * scale + offset`` in ``unit``."""

    wire: WireType
    unit: str
    doc: str
    scale: Fraction = Fraction(1)
    offset: Fraction = Fraction(0)
    low: int = 0
    """Minimum valid raw value."""
    high: int = 0
    """Maximum valid raw value; the sentinel may be greater."""
    none: int | None = None
    """Sentinel: the raw value that means "no value"; None if there is none."""
    enum: type[IntEnum] | None = None
    """Enumeration with the names of the values, or of the bits if the unit is ``bits``."""
    can_part: int = 0
    """Number of the CAN frame that contains the field, if the message needs several frames."""
    name: str = ""

    def canonical(self) -> str:
        """Return the input of the schema hash: all properties that affect the field's meaning.

        The range of an enumeration is omitted, so that a version with an appended member stays
        compatible.
        """
        scale = str(self.scale)
        if self.offset:
            scale += f"{'+' if self.offset > 0 else '-'}{abs(self.offset)}"
        none = "" if self.none is None else str(self.none)
        numeric = self.wire.is_integer and self.enum is None
        span = f"{self.low}..{self.high}" if numeric else ""
        enum = "" if self.enum is None else self.enum.__name__
        return f"{self.name}|{self.wire.name}|{scale}|{self.unit}|{none}|{span}|{enum}"

    @property
    def is_scaled(self) -> bool:
        """True if the physical value differs from the raw integer."""
        return self.scale != 1 or self.offset != 0

    @property
    def si_unit(self) -> SiUnit | None:
        """Unit of the SI property, or None if the raw value has no unit."""
        return SI_UNITS.get(self.unit)

    @property
    def si_suffix(self) -> str | None:
        """Suffix of the SI property's name, or None if the raw value has no unit."""
        unit = self.si_unit
        return unit.suffix if unit else None

    @property
    def si_gain(self) -> float:
        """SI value of one raw step."""
        return float(self.scale) * SI_UNITS[self.unit].factor

    @property
    def si_offset(self) -> float:
        """SI value at raw zero."""
        return float(self.offset) * SI_UNITS[self.unit].factor

    def named(self, name: str) -> Field:
        """Return a copy of the declaration with the field's name."""
        return replace(self, name=name)


class SiUnit(NamedTuple):
    """The SI unit for a physical unit of the wire."""

    suffix: str
    """End of the SI property's name."""
    factor: float
    """SI value of one physical unit of the wire."""
    text: str
    """The unit as people read it, after the number."""


SI_UNITS: dict[str, SiUnit] = {
    "m": SiUnit("_m", 1.0, "m"),
    "m/s": SiUnit("_m_s", 1.0, "m/s"),
    "rad/s": SiUnit("_rad_s", 1.0, "rad/s"),
    "m/s2": SiUnit("_m_s2", 1.0, "m/s²"),
    "deg/s": SiUnit("_rad_s", math.pi / 180.0, "rad/s"),
    "V": SiUnit("_v", 1.0, "V"),
    "A": SiUnit("_a", 1.0, "A"),
    "s": SiUnit("_s", 1.0, "s"),
    "degC": SiUnit("_deg_c", 1.0, "°C"),
    "Hz": SiUnit("_hz", 1.0, "Hz"),
    "duty": SiUnit("_duty", 1.0, ""),
    "count/g": SiUnit("_per_g", 1.0, "/g"),
    "count/(deg/s)": SiUnit("_per_deg_s", 1.0, "/(°/s)"),
    "count/K": SiUnit("_per_k", 1.0, "/K"),
}
"""SI unit for each physical unit of the wire."""

PLAIN_UNITS = frozenset(
    {"count", "percent", "enum", "bits", "id", "us", "hash", "text", "uid", "raw"}
)
"""Units of fields without a scale. For these fields the raw integer is the value."""


def number(  # noqa: PLR0913 - a declaration names every property of the field
    wire: WireType,
    unit: str,
    doc: str,
    *,
    scale: Exact = 1,
    offset: Exact = 0,
    low: int | None = None,
    high: int | None = None,
    none: int | None = None,
    enum: type[IntEnum] | None = None,
    can_part: int = 0,
) -> Field:
    """Declare a number; the enumeration or the wire type gives the default range."""
    values = [int(v) for v in enum] if enum is not None and unit == "enum" else []
    return Field(
        wire,
        unit,
        doc,
        exact(scale),
        exact(offset),
        min(values, default=wire.low) if low is None else low,
        max(values, default=wire.high) if high is None else high,
        none,
        enum,
        can_part,
    )


def text(doc: str) -> Field:
    """Declare a text that extends to the end of the payload."""
    return Field(TEXT, "text", doc)


def uid(doc: str) -> Field:
    """Declare a 96-bit device id, as bytes."""
    return Field(UID96, "uid", doc)


class _Si:
    """Descriptor for :func:`si`; it reads its gain from the field's declaration at first use."""

    __slots__ = ("_field", "_gain", "_index", "_offset")

    def __init__(self, field: str) -> None:
        self._field = field
        self._index = -1
        self._gain = self._offset = 0.0

    @property
    def bound_to(self) -> str | None:
        """Name of the field; None before :meth:`bind`."""
        return self._field if self._index >= 0 else None

    def bind(self, fields: tuple[Field, ...]) -> Field:
        """Find the field with this name in the message's declarations."""
        for index, field in enumerate(fields):
            if field.name == self._field:
                self._index, self._gain, self._offset = index, field.si_gain, field.si_offset
                return field
        raise AttributeError(f"no field {self._field!r} to give in SI units")


class SiValue(_Si):
    """A field's value in SI units."""

    __slots__ = ()

    @overload
    def __get__(self, instance: None, owner: type) -> SiValue: ...
    @overload
    def __get__(self, instance: Any, owner: type) -> float: ...  # noqa: ANN401 - any message
    def __get__(self, instance: Any, owner: type) -> float | SiValue:
        if instance is None:
            return self
        return float(instance[self._index] * self._gain + self._offset)


class SiValueOrNone(_Si):
    """A field's value in SI units, None if it is absent or the sentinel."""

    __slots__ = ("_none",)

    def __init__(self, field: str) -> None:
        super().__init__(field)
        self._none: int | None = None

    def bind(self, fields: tuple[Field, ...]) -> Field:
        """Find the field and store its sentinel."""
        field = super().bind(fields)
        self._none = field.none
        return field

    @overload
    def __get__(self, instance: None, owner: type) -> SiValueOrNone: ...
    @overload
    def __get__(self, instance: Any, owner: type) -> float | None: ...  # noqa: ANN401 - any message
    def __get__(self, instance: Any, owner: type) -> float | SiValueOrNone | None:
        if instance is None:
            return self
        raw = instance[self._index]
        if raw is None or raw == self._none:
            return None
        return float(raw * self._gain + self._offset)


def si(field: str) -> SiValue:
    """Return a property that gives ``field`` in SI units."""
    return SiValue(field)


def si_or_none(field: str) -> SiValueOrNone:
    """Return a property like :func:`si` for a field that may have no value."""
    return SiValueOrNone(field)
