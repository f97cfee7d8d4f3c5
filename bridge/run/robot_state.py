"""The newest of everything the device told, in SI units, with its age."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from bridge.motion.observation import Observation
from bridge.session.sample_times import SampleTimes
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
    from collections.abc import Iterable, Mapping

    from bridge.motion.geometry import Pose2
    from protocol.schema.agreement import MessageAgreement
    from protocol.schema.message import Message

STALE_S = 0.3
"""Six range readings or fifteen encoder readings: more is not jitter but a fault."""
STATUS_STALE_S = 1.0
"""Age at which the device's status is stale, s: ten of them."""
NEEDS: Mapping[type[Message], float] = MappingProxyType(
    {Encoders: STALE_S, Imu: STALE_S, Range: STALE_S, Status: STATUS_STALE_S}
)
"""Streams that a drive depends on, with the age (s) at which a sample of each is stale."""

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
    """Latest messages and when their samples were taken (host seconds)."""

    imu: Imu | None = None
    encoders: Encoders | None = None
    range: Range | None = None
    power: Power | None = None
    status: Status | None = None
    planner: PlannerState | None = None
    """Of the device's own planner."""
    times: SampleTimes = field(default_factory=SampleTimes)
    _came_s: dict[type[Message], float] = field(default_factory=dict, init=False, compare=False)
    """When the newest message of each kind came, whatever its stamp."""
    _seen: Range | None = field(default=None, init=False, compare=False)
    """The reading that ``_sight`` tells in SI units: several control steps see the same."""
    _sight: tuple[float | None, float | None, float | None, bool, bool, bool] = field(
        default=(None, None, None, False, False, False), init=False, compare=False
    )

    @property
    def arrived_s(self) -> Mapping[type[Message], float]:
        """Host time at which the newest sample of each kind was taken, by its device stamp."""
        return self.times.taken_s

    def take(self, message: Message, device_us: int, now_s: float) -> bool:
        """Keep a message if it is one of those kept; False where its stamp is not a newer one."""
        cls = type(message)
        name = _KEPT.get(cls)
        if name is None:
            return False
        setattr(self, name, message)
        self._came_s[cls] = now_s
        return self.times.take(cls, device_us, now_s)

    def stale(self, now_s: float, needs: Mapping[type[Message], float] = NEEDS) -> str | None:
        """Name of a stream of ``needs`` that has stopped, if any.

        "fresh" stands before it where messages come and their stamps are old or stand still.
        """
        get = self.times.taken_s.get
        for cls, limit_s in needs.items():
            if get(cls, -1e9) < now_s - limit_s:
                name = _KEPT[cls] if cls is not PlannerState else "planner state"
                comes = self._came_s.get(cls, -1e9) >= now_s - limit_s
                return f"fresh {name}" if comes else name
        return None

    def observation(  # noqa: PLR0913, PLR0917 - what an observation is made of
        self,
        now_s: float,
        pose: Pose2,
        v_m_s: float,
        yaw_rate_rad_s: float,
        gyro_bias_sigma_rad_s: float = 0.0,
        heading_sigma_rad: float = 0.0,
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
            gyro_bias_sigma_rad_s,
            heading_sigma_rad,
        )

    def forget(self) -> None:
        """Drop everything: another boot or session."""
        self.imu = self.encoders = self.range = self.power = self.status = self.planner = None
        self.times.forget()
        self._came_s.clear()
