"""The device's parameters: a table of their properties, and a store of their values.

A value is sent as 32 bits together with its kind (data type). A changed value is valid until the
next boot; a save stores the present values in flash. Parameters of the robot's geometry take effect
at the next boot, so that odometry stays consistent.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.messages.device import ParameterValue
from protocol.messages.values import NackReason, ParameterFlag, ParameterKind
from protocol.parameter_values import from_raw, to_raw

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bridge.motion.robot_model import RobotModel

STOP_DECELERATION_M_S2 = 1.0
"""Deceleration of a stop, m/s²: from top speed to rest in 0.3 s. At a higher deceleration the tyres
would slip."""
BATTERY_LOW_V = 12.8
"""Battery voltage below which the fault ``battery_low`` is set, V: 3.2 V for each of four cells."""
BATTERY_EMPTY_V = 12.0
"""Battery voltage below which the robot stops, V: 3.0 V per cell. A lower voltage for a second
damages the pack."""


RANGERS = ("ultrasonic", "infrared_left", "infrared_right")
"""Names of the rangers, in the order of their readings."""


@dataclass(frozen=True, slots=True)
class TableParameter:
    """One row of the table; ``default``, ``low`` and ``high`` are in ``unit``."""

    name: str
    unit: str
    kind: ParameterKind
    default: float
    low: float
    high: float
    model_key: str | None = None
    """Field of the robot model that the parameter sets."""
    read_only: bool = False
    needs_reboot: bool = False
    doc: str = ""
    """Meaning, for documentation."""

    @property
    def label(self) -> str:
        """Name and unit, as in the message."""
        return f"{self.name} {self.unit}"


def table(model: RobotModel, node: int) -> tuple[TableParameter, ...]:
    """Return all parameters in the order of their numbers; append new parameters at the end."""
    u32, f32 = ParameterKind.U32, ParameterKind.F32

    def robot(  # noqa: PLR0913, PLR0917 - a row of the table
        name: str,
        unit: str,
        key: str,
        low: float,
        high: float,
        doc: str,
        *,
        kind: ParameterKind = f32,
        needs_reboot: bool = False,
    ) -> TableParameter:
        default = getattr(model, key)
        return TableParameter(
            name, unit, kind, default, low, high, key, needs_reboot=needs_reboot, doc=doc
        )

    def own(  # noqa: PLR0913, PLR0917 - a row of the table
        name: str, unit: str, default: float, low: float, high: float, doc: str
    ) -> TableParameter:
        return TableParameter(name, unit, f32, default, low, high, doc=doc)

    def switch(name: str, doc: str) -> TableParameter:
        return TableParameter(name, "bool", u32, 1, 0, 1, doc=doc)

    geometry = functools.partial(robot, needs_reboot=True)
    return (
        TableParameter("node", "id", u32, node, 1, 15, read_only=True, doc="set by the board"),
        geometry("wheel_diameter", "m", "wheel_diameter_m", 0.01, 1.0, "mean of both wheels"),
        geometry("wheel_base", "m", "wheel_base_m", 0.02, 2.0, "distance between the wheels"),
        geometry(
            "counts_per_turn",
            "count",
            "counts_per_turn",
            4,
            1e6,
            "encoder counts after x4",
            kind=u32,
        ),
        robot("max_speed", "m/s", "max_speed_m_s", 0.01, 2.0, "limit of the forward speed"),
        robot("max_yaw_rate", "rad/s", "max_yaw_rate_rad_s", 0.05, 20.0, "limit of the yaw rate"),
        robot("cruise_speed", "m/s", "cruise_speed_m_s", 0.01, 2.0, "of the device's planner"),
        own(
            "stop_deceleration", "m/s2", STOP_DECELERATION_M_S2, 0.2, 5.0, "deceleration of a stop"
        ),
        own("battery_low", "V", BATTERY_LOW_V, 3.0, 60.0, "below it the fault battery_low is set"),
        geometry("robot_diameter", "m", "robot_diameter_m", 0.05, 2.0, "of the footprint"),
        geometry("cleaning_width", "m", "cleaning_width_m", 0.02, 2.0, "width of the mouth"),
        geometry("mouth_offset", "m", "mouth_offset_m", -1.0, 1.0, "mouth ahead of the axle"),
        own("battery_empty", "V", BATTERY_EMPTY_V, 3.0, 60.0, "below it for 1 s driving ends"),
        geometry("wheel_ratio", "ratio", "wheel_ratio", 0.8, 1.25, "right over left diameter"),
        geometry("gyro_bias", "rad/s", "gyro_bias_rad_s", -0.4, 0.4, "yaw rate read at rest"),
        *(
            TableParameter(
                f"{ranger}_{name}", unit, f32, value, low, high, needs_reboot=True, doc=doc
            )
            for ranger in RANGERS
            for name, unit, value, low, high, doc in (
                ("scale", "ratio", getattr(model, ranger).scale, 0.5, 2.0, "true over raw range"),
                ("offset", "m", getattr(model, ranger).offset_m, -0.2, 0.2, "added to its range"),
            )
        ),
        switch("cliff_reflex", "1: no forward speed at a cliff"),
        switch("bumper_reflex", "1: slow forward speed with a bumper pressed"),
    )


class ParameterStore:
    """Stores the present values and the saved values. Only ``stored`` remains after a reset."""

    def __init__(self, parameters: Sequence[TableParameter], stored: Mapping[str, int]) -> None:
        """Read the stored values by name; a value outside its parameter's range is ignored."""
        self.parameters = tuple(parameters)
        self._stored = dict(stored)
        self._defaults = [to_raw(p.kind, p.default) for p in self.parameters]
        self._boot = [
            self._kept(p, default)
            for p, default in zip(self.parameters, self._defaults, strict=True)
        ]
        self.present = list(self._boot)
        self._number = {p.name: i for i, p in enumerate(self.parameters)}

    def _kept(self, parameter: TableParameter, default: int) -> int:
        raw = self._stored.get(parameter.name)
        return default if raw is None or not _allowed(parameter, raw) else raw

    def describe(self, number: int) -> ParameterValue | None:
        """Return all properties of one parameter; None if the number is unknown."""
        if number >= len(self.parameters):
            return None
        parameter, raw = self.parameters[number], self.present[number]
        kind = parameter.kind
        return ParameterValue(
            number,
            len(self.parameters),
            kind,
            int(self._flags(number)),
            raw,
            self._defaults[number],
            to_raw(kind, parameter.low),
            to_raw(kind, parameter.high),
            parameter.label,
        )

    def _flags(self, number: int) -> ParameterFlag:
        parameter, raw = self.parameters[number], self.present[number]
        stored = self._stored.get(parameter.name)
        flags = ParameterFlag(0)
        if stored == raw:
            flags |= ParameterFlag.STORED
        if raw != self._kept(parameter, self._defaults[number]):
            flags |= ParameterFlag.CHANGED
        if parameter.read_only:
            flags |= ParameterFlag.READ_ONLY
        if parameter.needs_reboot:
            flags |= ParameterFlag.NEEDS_REBOOT
        return flags

    def set(self, number: int, kind: int, raw: int) -> NackReason | None:
        """Change a present value; return the reason of a rejection, or None."""
        if number >= len(self.parameters):
            return NackReason.UNKNOWN_PARAMETER
        parameter = self.parameters[number]
        if parameter.read_only:
            return NackReason.READ_ONLY
        if kind != parameter.kind or not _allowed(parameter, raw):
            return NackReason.BAD_VALUE
        self.present[number] = raw
        return None

    def image(self) -> dict[str, int]:
        """Return the image to store so that the next boot uses the present values."""
        return {
            **self._stored,
            **{
                p.name: raw
                for p, raw in zip(self.parameters, self.present, strict=True)
                if not p.read_only
            },
        }

    def saved(self, image: Mapping[str, int]) -> None:
        """Record that the flash now contains this image."""
        self._stored = dict(image)

    def value(self, name: str) -> float:
        """Return the value in effect: the value at boot if ``needs_reboot``, else the present."""
        number = self._number[name]
        parameter = self.parameters[number]
        raw = (self._boot if parameter.needs_reboot else self.present)[number]
        # Return the exact default, not its 32-bit rounding.
        return parameter.default if raw == self._defaults[number] else from_raw(parameter.kind, raw)

    def range_corrections(self) -> tuple[tuple[float, float], ...] | None:
        """Scale and offset (m) in effect for each ranger; None without any correction."""
        found = tuple((self.value(f"{r}_scale"), self.value(f"{r}_offset")) for r in RANGERS)
        return None if found == ((1.0, 0.0),) * len(RANGERS) else found

    def applied_to(self, model: RobotModel) -> RobotModel:
        """Return the robot model with the values in effect."""
        changes: dict[str, float] = {}
        for parameter in self.parameters:
            if parameter.model_key is not None:
                value = self.value(parameter.name)
                changes[parameter.model_key] = (
                    value if parameter.kind is ParameterKind.F32 else int(value)
                )
        return dataclasses.replace(model, **changes)  # type: ignore[arg-type]  # keys are its own


def _allowed(parameter: TableParameter, raw: int) -> bool:
    """Return whether a value is within the parameter's range, with bounds rounded to 32 bits."""
    value = from_raw(parameter.kind, raw)
    low, high = (
        from_raw(parameter.kind, to_raw(parameter.kind, end))
        for end in (parameter.low, parameter.high)
    )
    return math.isfinite(value) and low <= value <= high
