"""Scale of an IMU's raw counts, and conversion of the counts to the catalogue's nominal scale."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from protocol.messages.device import Imu, ImuInfo
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec

G_M_S2 = Fraction("9.80665")
"""Standard gravity, m/s² (CGPM 1901)."""
GRAVITY_M_S2 = float(G_M_S2)
"""Standard gravity as a float, m/s²."""
_INFO = CATALOGUE.spec(ImuInfo).fields
_IMU = CATALOGUE.spec(Imu).fields
_TEMPERATURE = 3
_GYRO = 4
"""Index of the first gyro field in the IMU message; the accelerations are before it."""


@dataclass(frozen=True, slots=True)
class ImuScale:
    """Exact number of counts per physical unit."""

    per_g: Fraction
    per_deg_s: Fraction
    per_k: Fraction
    zero_deg_c: Fraction
    """Temperature at a count of 0, °C."""

    @classmethod
    def of(cls, info: ImuInfo) -> ImuScale | None:
        """Return the scale that a device reports; None if a reported sensitivity is 0."""
        if 0 in {info.accel, info.gyro, info.temperature}:
            return None
        return cls(*(raw * field.scale for raw, field in zip(info, _INFO, strict=True)))

    def info(self) -> ImuInfo:
        """Return the message that reports this scale."""
        values = (self.per_g, self.per_deg_s, self.per_k, self.zero_deg_c)
        return ImuInfo(*(round(v / f.scale) for v, f in zip(values, _INFO, strict=True)))

    def declared(self, spec: MessageSpec) -> MessageSpec:
        """Return the IMU message declared with this scale; any other message unchanged."""
        if spec.cls is not Imu:
            return spec
        return replace(spec, fields=tuple(self._field(i, f) for i, f in enumerate(spec.fields)))

    def _field(self, index: int, field: Field) -> Field:
        if index < _TEMPERATURE:
            return replace(field, scale=G_M_S2 / self.per_g)
        if index == _TEMPERATURE:
            return replace(field, scale=1 / self.per_k, offset=self.zero_deg_c)
        return replace(field, scale=1 / self.per_deg_s)

    def nominal(self, imu: Imu) -> Imu:
        """Return the sample in nominal counts; they are not rounded, so the SI values are exact."""
        raw = tuple(imu)
        accel = float(NOMINAL.per_g / self.per_g)
        gyro = float(NOMINAL.per_deg_s / self.per_deg_s)
        warm_k = raw[_TEMPERATURE] / float(self.per_k)
        temperature = (warm_k + float(self.zero_deg_c - NOMINAL.zero_deg_c)) * float(NOMINAL.per_k)
        accels = [count * accel for count in raw[:_TEMPERATURE]]
        rates = (count * gyro for count in raw[_GYRO:])
        made: tuple[Any, ...] = (*accels, temperature, *rates)  # floats, never sent
        return Imu(*made)


NOMINAL = ImuScale(
    G_M_S2 / _IMU[0].scale,
    1 / _IMU[_GYRO].scale,
    1 / _IMU[_TEMPERATURE].scale,
    _IMU[_TEMPERATURE].offset,
)
"""Nominal scale in the catalogue: an MPU6050 at ±2 g and ±250 °/s."""
NOMINAL_G_LSB = float(NOMINAL.per_g)
"""Nominal number of counts per g."""
NOMINAL_DEG_S_LSB = float(NOMINAL.per_deg_s)
"""Nominal number of counts per °/s."""
NOMINAL_GYRO_RAD_S = math.radians(1.0 / NOMINAL_DEG_S_LSB)
"""Nominal gyro scale, rad/s per count."""


class ImuReader:
    """Converts the IMU samples of one device to nominal counts."""

    def __init__(self, scale: ImuScale | None = None) -> None:
        """Start with an assumed scale.

        With None, no sample is converted until the device reports its scale.
        """
        self.scale = scale
        self._as_it_is = scale == NOMINAL

    def take(self, message: Message) -> Message | None:
        """Return the message with nominal counts; None for a sample with an unknown scale."""
        if isinstance(message, Imu):
            if self._as_it_is:
                return message
            return None if self.scale is None else self.scale.nominal(message)
        if isinstance(message, ImuInfo):
            self.scale = ImuScale.of(message) or self.scale
            self._as_it_is = self.scale == NOMINAL
        return message
