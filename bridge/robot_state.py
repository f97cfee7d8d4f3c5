"""The newest of everything the device told, in SI units, with its age."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.motion.observation import Observation
from protocol.messages import (
    ClearStop,
    Encoders,
    Imu,
    LogText,
    PlannerState,
    Power,
    Range,
    SetMode,
    Status,
    VelocitySetpoint,
)
from protocol.values import Contact

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bridge.motion.geometry import Pose2
    from protocol.agreement import MessageAgreement
    from protocol.message import Message

STALE_S = 0.3
"""Six range readings or fifteen encoder readings: more is not jitter but a fault."""

_NEEDED: dict[type[Message], int] = {
    Imu: 7,
    Encoders: 2,
    Range: 4,
    Status: 3,
    VelocitySetpoint: 4,
    ClearStop: 2,
    SetMode: 2,
}
"""Driving needs these messages, and of each that many leading fields."""
_READ: dict[type[Message], int] = {**_NEEDED, Power: 1, LogText: 2}
"""What the host looks into, and how far; the rest it only records."""
_KEPT: dict[type[Message], str] = {
    Imu: "imu",
    Encoders: "encoders",
    Range: "range",
    Power: "power",
    Status: "status",
    PlannerState: "planner",
}
# As plain integers: an enumeration's own arithmetic makes a new member each time.
_LEFT, _RIGHT = int(Contact.BUMPER_LEFT), int(Contact.BUMPER_RIGHT)
_CLIFF = int(Contact.CLIFF)


def missing_needs(differences: Iterable[MessageAgreement]) -> list[str]:
    """Names of what driving needs and the device does not have, or has otherwise."""
    return [d.spec.name for d in differences if d.shared_fields < _NEEDED.get(d.spec.cls, 0)]


def understood(message: Message) -> bool:
    """Whether a device's message has every field that the host looks into.

    An older device may leave fields out, which are then None.
    """
    count = _READ.get(type(message))
    return count is None or None not in tuple(message)[:count]


@dataclass(slots=True)
class RobotState:
    """Latest messages and when they arrived (host seconds)."""

    imu: Imu | None = None
    encoders: Encoders | None = None
    range: Range | None = None
    power: Power | None = None
    status: Status | None = None
    planner: PlannerState | None = None
    """Of the device's own planner."""
    arrived_s: dict[type[Message], float] = field(default_factory=dict)
    _seen: Range | None = field(default=None, init=False, compare=False)
    """The reading that ``_sight`` tells in SI units: several control steps see the same."""
    _sight: tuple[float | None, float | None, float | None, bool, bool, bool] = field(
        default=(None, None, None, False, False, False), init=False, compare=False
    )

    def take(self, message: Message, now_s: float) -> None:
        """Keep a message if it is one of those kept."""
        cls = type(message)
        name = _KEPT.get(cls)
        if name is not None:
            setattr(self, name, message)
            self.arrived_s[cls] = now_s

    def stale(self, now_s: float) -> str | None:
        """Name of a stream that driving depends on and that has stopped, if any."""
        get, oldest_s = self.arrived_s.get, now_s - STALE_S
        for cls in (Encoders, Imu, Range):
            if get(cls, -1e9) < oldest_s:
                return cls.__name__.lower()
        return None

    def observation(  # noqa: PLR0913, PLR0917 - what an observation is made of
        self,
        now_s: float,
        pose: Pose2,
        v_m_s: float,
        yaw_rate_rad_s: float,
        gyro_doubt_rad_s: float = 0.0,
        heading_doubt_rad: float = 0.0,
    ) -> Observation | None:
        """What planner and controllers are told; None before the first range reading."""
        reading = self.range
        if reading is None:
            return None
        if reading is not self._seen:
            self._seen = reading
            contacts = reading.contacts
            self._sight = (
                reading.ultrasonic_m,
                reading.infrared_left_m,
                reading.infrared_right_m,
                contacts & _LEFT != 0,
                contacts & _RIGHT != 0,
                contacts & _CLIFF != 0,
            )
        return Observation(
            now_s,
            pose,
            v_m_s,
            yaw_rate_rad_s,
            *self._sight,
            gyro_doubt_rad_s,
            heading_doubt_rad,
        )

    def forget(self) -> None:
        """Drop everything: another boot or session."""
        self.imu = self.encoders = self.range = self.power = self.status = self.planner = None
        self.arrived_s.clear()
