"""Newest data from the device, in SI units, with their age."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from bridge.motion.observation import Observation
from bridge.session.sample_times import SampleTimes
from protocol.messages.device import (
    Encoders,
    Imu,
    ImuInfo,
    LinkCounters,
    LogText,
    PlannerState,
    Power,
    Range,
    Status,
)
from protocol.messages.host import ClearStop, SetMode, VelocitySetpoint
from protocol.messages.values import Contact
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.comparison import MessageComparison
from protocol.schema.message import MAKERS_TYPES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from bridge.motion.geometry import Pose2
    from protocol.schema.comparison import Difference
    from protocol.schema.message import Message

STALE_S = 0.3
"""Age at which sensor data are stale, s. It is six periods of the range samples or fifteen of the
encoder samples, and more than the jitter."""
STATUS_STALE_S = 1.0
"""Age at which the device's status is stale, s: ten periods."""
NEEDS: Mapping[type[Message], float] = MappingProxyType(
    {Encoders: STALE_S, Imu: STALE_S, Range: STALE_S, Status: STATUS_STALE_S}
)
"""Streams that a drive depends on, with the age (s) at which a sample is stale."""

_NEEDED: dict[type[Message], int] = {
    Imu: 7,
    ImuInfo: 4,
    Encoders: 2,
    Range: 4,
    Status: 3,
    VelocitySetpoint: 4,
    ClearStop: 2,
    SetMode: 2,
}
"""Messages that the host requires for driving, with the number of leading fields that it reads.
"""
_READ: dict[type[Message], int] = {**_NEEDED, Power: 1, LogText: 2}
"""Messages that the host reads, with the number of leading fields; all others are only recorded."""
_KEPT: dict[type[Message], str] = {
    Imu: "imu",
    Encoders: "encoders",
    Range: "range",
    Power: "power",
    Status: "status",
    PlannerState: "planner",
    LinkCounters: "counters",
}
PLUGGED: tuple[type[Message], ...] = tuple(
    spec.cls for spec in CATALOGUE if spec.type_id in MAKERS_TYPES
)
"""Messages of plug-ins. They are stored for the dashboard, for plug-in rules and for other
processes.
"""
# Plain integers: arithmetic on an enumeration creates a new member each time.
_LEFT, _RIGHT = int(Contact.BUMPER_LEFT), int(Contact.BUMPER_RIGHT)
_CLIFF = int(Contact.CLIFF)


def missing_needs(differences: Iterable[Difference]) -> list[str]:
    """Return the names of required messages that the device lacks or declares differently."""
    return [
        d.spec.name
        for d in differences
        if isinstance(d, MessageComparison) and d.shared_fields < _NEEDED.get(d.spec.cls, 0)
    ]


def understood(message: Message) -> bool:
    """Return True if a message has every field that the host reads.

    An older device may omit fields, which are then None.
    """
    count = _READ.get(type(message))
    return count is None or None not in tuple(message)[:count]


@dataclass(slots=True)
class RobotState:
    """Newest messages and the host times (s) of their samples."""

    imu: Imu | None = None
    encoders: Encoders | None = None
    range: Range | None = None
    power: Power | None = None
    status: Status | None = None
    planner: PlannerState | None = None
    """State of the device's own planner."""
    counters: LinkCounters | None = None
    """Numbers of frames that the device has received and dropped."""
    plugged: dict[type[Message], Message] = field(default_factory=dict)
    """Newest message of each class of a plug-in."""
    times: SampleTimes = field(default_factory=SampleTimes)
    _came_s: dict[type[Message], float] = field(default_factory=dict, init=False, compare=False)
    """Arrival time of each type's newest message (s), regardless of its stamp."""
    _seen: Range | None = field(default=None, init=False, compare=False)
    """The range sample that ``_readings`` contains in SI units. Several control steps use the same
    sample."""
    _readings: tuple[float | None, float | None, float | None, bool, bool, bool] = field(
        default=(None, None, None, False, False, False), init=False, compare=False
    )

    @property
    def arrived_s(self) -> Mapping[type[Message], float]:
        """Host time of each type's newest sample, s, from its device stamp.

        Of a plug-in's message: its arrival.
        """
        return self.times.taken_s

    def take(self, message: Message, device_us: int, now_s: float) -> bool:
        """Store a message of a known type. Return False if its stamp is not newer than the last."""
        cls = type(message)
        name = _KEPT.get(cls)
        if name is None:
            return False
        setattr(self, name, message)
        self._came_s[cls] = now_s
        return self.times.take(cls, device_us, now_s)

    def keep_plugged(self, message: Message, now_s: float) -> None:
        """Store a message of a plug-in.

        Its stamp is not used, because control does not depend on it.
        """
        self.plugged[type(message)] = message
        self.times.note(type(message), now_s)

    def stale(self, now_s: float, needs: Mapping[type[Message], float] = NEEDS) -> str | None:
        """Return the name of a stream in ``needs`` that is stale; None if there is none.

        The caller prints "no <name> data". The name begins with "fresh" if messages arrive but
        their stamps are old or do not advance: "no fresh imu data".
        """
        get = self.times.taken_s.get
        for cls, limit_s in needs.items():
            if get(cls, -1e9) < now_s - limit_s:
                name = _KEPT[cls] if cls is not PlannerState else "planner state"
                comes = self._came_s.get(cls, -1e9) >= now_s - limit_s
                return f"fresh {name}" if comes else name
        return None

    def observation(  # noqa: PLR0913, PLR0917 - the parts of an observation
        self,
        now_s: float,
        pose: Pose2,
        v_m_s: float,
        yaw_rate_rad_s: float,
        gyro_bias_sigma_rad_s: float = 0.0,
        heading_sigma_rad: float = 0.0,
        lateral_sigma_m: float = 0.0,
        *,
        stands: bool = False,
    ) -> Observation | None:
        """Return the input of planner and controllers; None before the first range sample."""
        reading = self.range
        if reading is None:
            return None
        if reading is not self._seen:
            self._seen = reading
            contacts = reading.contacts
            self._readings = (
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
            *self._readings,
            gyro_bias_sigma_rad_s,
            heading_sigma_rad,
            lateral_sigma_m,
            stands,
        )

    def forget(self) -> None:
        """Discard all data at a new boot or session."""
        self.imu = self.encoders = self.range = self.power = self.status = self.planner = (
            self.counters
        ) = None
        self.plugged.clear()
        self.times.forget()
        self._came_s.clear()
