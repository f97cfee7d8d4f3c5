"""Typed records of a run, for the log and the viewer.

Times are Unix time in ns. ``log_ns`` is the host's time of the record. ``publish_ns`` is the time
at which the device measured the value; it is None before the first clock fit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bridge.coverage.planner import PlannerState
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from protocol.schema.message import Message


class RawBytes(NamedTuple):
    """Bytes as read from or written to the port."""

    log_ns: int
    outgoing: bool
    data: bytes


class RawCan(NamedTuple):
    """A CAN frame as read from or written to the bus."""

    log_ns: int
    outgoing: bool
    can_id: int
    """CAN id as in SocketCAN: the top bits flag extended, remote and error frames."""
    data: bytes


class DeviceMessage(NamedTuple):
    """A decoded message from the device."""

    log_ns: int
    publish_ns: int | None
    bound_ns: int | None
    """Half-width of the error interval of ``publish_ns``, ns."""
    node: int
    seq: int
    t_us: int
    """The device's 32-bit stamp as received, µs."""
    name: str
    """The message's name in the catalogue."""
    message: Message


class PoseRecord(NamedTuple):
    """The estimate after a control step, recorded in the topics /pose, /pose/estimate and /tf."""

    log_ns: int
    pose: Pose2
    v_m_s: float
    yaw_rate_rad_s: float
    covariance: tuple[float, ...]
    """Row-major 3×3 covariance of x, y (m) and yaw (rad)."""
    gyro_bias_rad_s: float
    wheel_scale: float


class TruthRecord(NamedTuple):
    """The simulator's true pose."""

    log_ns: int
    pose: Pose2


class CommandRecord(NamedTuple):
    """A velocity setpoint that was sent."""

    log_ns: int
    v_m_s: float
    yaw_rate_rad_s: float
    target_v_m_s: float
    """Target before smoothing, m/s."""
    target_yaw_rate_rad_s: float


class PlannerRecord(NamedTuple):
    """The planner's state after a change."""

    log_ns: int
    planner: str
    state: PlannerState


class Severity(Enum):
    """Severity of an event or log line."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class EventRecord(NamedTuple):
    """A decision, stop, loss, reconnection or other event of a run."""

    log_ns: int
    severity: Severity
    source: str
    """Part that reports the event, such as ``session``, ``link``, ``clock``, ``device``,
    ``operator`` or ``recorder``."""
    kind: str
    text: str
    data: dict[str, Any]


class LogRecord(NamedTuple):
    """A log line of the host or the device."""

    log_ns: int
    severity: Severity
    source: str
    text: str


class ClockRecord(NamedTuple):
    """The time synchronisation's fit of device time to host time."""

    log_ns: int
    offset_ns: int
    """Unix time minus device time at the time of the record, ns."""
    drift_ppm: float
    bound_ns: int
    round_trip_ns: int
    samples: int
    boot_id: int


class CoverageRecord(NamedTuple):
    """Map of the swept floor as an occupancy grid: 0 where the mouth has passed, -1 elsewhere."""

    log_ns: int
    cells: NDArray[np.int8]
    """Array of (rows, columns), with row 0 at the origin's y. Values are as in
    nav_msgs/OccupancyGrid: -1 unknown, 0 to 100 occupied."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float


class RoomRecord(NamedTuple):
    """The floor plan; recorded once if known."""

    log_ns: int
    plan: FloorPlan


class IdentityRecord(NamedTuple):
    """The connected device; recorded as metadata ``device``."""

    log_ns: int
    node: int
    uid: bytes
    boot_id: int
    session_id: int
    reset_cause: str
    firmware: str
    """Name and version of the firmware."""
    catalogue_hash: int


Record = (
    RawBytes
    | RawCan
    | DeviceMessage
    | PoseRecord
    | TruthRecord
    | CommandRecord
    | PlannerRecord
    | EventRecord
    | LogRecord
    | ClockRecord
    | CoverageRecord
    | RoomRecord
    | IdentityRecord
)


@dataclass(frozen=True, slots=True)
class RunInfo:
    """Header data of a log."""

    port: str
    planner: str
    seed: int | None
    version: str
    opened_unix_ns: int
    clock_offset_ns: int
    """Unix time minus the host's monotonic clock at the opening of the log, ns."""
    robot: RobotModel
    robot_toml: str
    """Text of the robot file that ``robot`` was read from; attached unchanged."""
    plan: FloorPlan | None = None
    extra: dict[str, str] = field(default_factory=dict)
    begun_unix_ns: int | None = None
    """Start of this file in Unix time, ns; None for the run's first file."""
