"""What the supervisor is shown at every control step, and what it answers."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import VelocityCommand
    from bridge.supervise.settings import Level
    from protocol.messages import Encoders, Imu, PlannerState, Power, Range, Status
    from protocol.schema.message import Message

Scalar = float | str | bool


class RuleInputs(NamedTuple):
    """One control step of a robot that moves; the messages are the newest, None: not yet come."""

    time_s: float
    """Host time."""
    pose: Pose2
    """Estimate, in the frame of the map."""
    v_m_s: float
    yaw_rate_rad_s: float
    """By the gyro less its bias."""
    wheel_scale: float = 1.0
    """The estimate's: how many nominal ways a count is worth."""
    heard_s: float = 0.0
    """Host time of the newest intact frame."""
    boot_id: int | None = None
    imu: Imu | None = None
    encoders: Encoders | None = None
    range: Range | None = None
    power: Power | None = None
    status: Status | None = None
    planner: PlannerState | None = None
    """Of the device's own planner."""
    arrived_s: Mapping[type[Message], float] = MappingProxyType({})
    """Host time of the newest message of each kind."""
    command: VelocityCommand | None = None
    """What was sent last; None where the device plans for itself."""
    onboard: str = ""
    """Name of the device's planner; empty where the host plans."""


class Reaction(NamedTuple):
    """What is to be done, and why: one event."""

    kind: str
    """Name of the rule."""
    level: Level
    text: str
    """For people: what was found."""
    data: dict[str, Scalar]
    """The evidence."""
    factor: float = 1.0
    """For ``SLOW``: what speeds are scaled by."""
