"""Inputs and results of the supervisor for one control step."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from protocol.messages.values import Contact, Fault

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import VelocityCommand
    from bridge.supervise.settings import Level
    from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status
    from protocol.schema.message import Message

Scalar = float | str | bool
M = TypeVar("M", bound="Message")


def newest_of(messages: Mapping[type[Message], Message], kind: type[M]) -> M | None:
    """Return the message of a class, or None."""
    message = messages.get(kind)
    return message if isinstance(message, kind) else None


CREEP_M_S = 0.05
"""Maximum forward speed that the device itself allows with a bumper switch pressed, m/s."""
_CLIFF, _LIMITED = int(Contact.CLIFF), int(Fault.LIMITED)


def limited_command(
    command: VelocityCommand, status: Status | None, reading: Range | None
) -> VelocityCommand:
    """Return the setpoint that the device executes.

    At a cliff the device allows no forward speed. With a bumper switch pressed it allows a low
    forward speed. The yaw rate and the backward speed are not limited.
    """
    if status is None or not status.faults & _LIMITED:
        return command
    at_cliff = reading is not None and reading.contacts & _CLIFF
    return command._replace(v_m_s=min(command.v_m_s, 0.0 if at_cliff else CREEP_M_S))


class RuleInputs(NamedTuple):
    """State of the robot at one control step; each message is the newest, or None."""

    time_s: float
    """Host time, s."""
    pose: Pose2
    """Estimated pose in the map frame."""
    v_m_s: float
    yaw_rate_rad_s: float
    """Yaw rate of the gyro minus its bias, rad/s."""
    wheel_scale: float = 1.0
    """The estimator's scale of the wheels: true distance divided by nominal distance."""
    last_frame_s: float = 0.0
    """Host time of the newest intact frame, s."""
    boot_id: int | None = None
    imu: Imu | None = None
    encoders: Encoders | None = None
    range: Range | None = None
    power: Power | None = None
    status: Status | None = None
    planner: PlannerState | None = None
    """State of the device's own planner."""
    arrived_s: Mapping[type[Message], float] = MappingProxyType({})
    """Host time of the newest message of each type, s."""
    command: VelocityCommand | None = None
    """Velocity setpoint that the device executes, after it has limited the setpoint at contacts and
    cliffs; None if the device plans."""
    onboard: str = ""
    """Name of the device's planner; empty if the host plans."""
    plugged: Mapping[type[Message], Message] = MappingProxyType({})
    """Newest message of each message class that a plug-in declares."""

    def newest(self, kind: type[M]) -> M | None:
        """Return the newest message of a class that a plug-in declares, or None."""
        return newest_of(self.plugged, kind)


class Reaction(NamedTuple):
    """A reaction and its reason, as one event."""

    kind: str
    """Name of the rule."""
    level: Level
    text: str
    """Description of the finding, for people."""
    data: dict[str, Scalar]
    """Measured values."""
    factor: float = 1.0
    """Factor of all speeds, if the reaction is ``SLOW``."""
