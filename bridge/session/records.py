"""What a run tells: typed records, from the host's core to the log and the viewer.

Times are Unix nanoseconds (``log_ns``: when the host knew it; ``publish_ns``: when it was
true on the device, None where no clock mapping exists yet).
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
    """Bytes exactly as they came from or went to the port."""

    log_ns: int
    outgoing: bool
    data: bytes


class RawCan(NamedTuple):
    """A CAN frame exactly as it came from or went to the bus."""

    log_ns: int
    outgoing: bool
    can_id: int
    """As SocketCAN has it: flags for extended, remote and error frames in the top bits."""
    data: bytes


class DeviceMessage(NamedTuple):
    """A decoded message of the device."""

    log_ns: int
    publish_ns: int | None
    bound_ns: int | None
    """Half-width of the interval that ``publish_ns`` is known to."""
    node: int
    seq: int
    t_us: int
    """The device's 32-bit stamp as received."""
    name: str
    """The message's name in the catalogue."""
    message: Message


class PoseRecord(NamedTuple):
    """The estimate after a control step; recorded as /pose, /pose/estimate and /tf."""

    log_ns: int
    pose: Pose2
    v_m_s: float
    yaw_rate_rad_s: float
    covariance: tuple[float, ...]
    """Row-major 3×3 over x, y (m) and yaw (rad)."""
    gyro_bias_rad_s: float
    wheel_scale: float


class TruthRecord(NamedTuple):
    """The simulator's own pose."""

    log_ns: int
    pose: Pose2


class CommandRecord(NamedTuple):
    """A velocity that was sent."""

    log_ns: int
    v_m_s: float
    yaw_rate_rad_s: float
    target_v_m_s: float
    """Before smoothing."""
    target_yaw_rate_rad_s: float


class PlannerRecord(NamedTuple):
    """The planner's state after a change."""

    log_ns: int
    planner: str
    state: PlannerState


class Severity(Enum):
    """Of events and log lines."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class EventRecord(NamedTuple):
    """Something worth finding again: a decision, a stop, a loss, a reconnection."""

    log_ns: int
    severity: Severity
    source: str
    """``planner``, ``session``, ``safety``, ``link``, ``clock``, ``device`` or ``recorder``."""
    kind: str
    text: str
    data: dict[str, Any]


class LogRecord(NamedTuple):
    """A line for people, of the host or the device."""

    log_ns: int
    severity: Severity
    source: str
    text: str


class ClockRecord(NamedTuple):
    """The fit of device time to host time."""

    log_ns: int
    offset_ns: int
    """Unix time less device time at the moment of the record."""
    drift_ppm: float
    bound_ns: int
    round_trip_ns: int
    samples: int
    boot_id: int


class CoverageRecord(NamedTuple):
    """The swept map so far, as an occupancy grid: 0 where the mouth went, -1 elsewhere."""

    log_ns: int
    cells: NDArray[np.int8]
    """(rows, columns), row 0 at the origin's y; -1 unknown, 0..100 as nav_msgs has it."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float


class RoomRecord(NamedTuple):
    """The floor plan, once, where it is known."""

    log_ns: int
    plan: FloorPlan


class IdentityRecord(NamedTuple):
    """The device that a session agreed with; recorded as metadata ``device``."""

    log_ns: int
    node: int
    uid: bytes
    boot_id: int
    session_id: int
    reset_cause: str
    firmware: str
    """Name and version."""
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
    """What a log says of itself first."""

    port: str
    planner: str
    seed: int | None
    version: str
    opened_unix_ns: int
    clock_offset_ns: int
    """Unix time less the host's monotonic clock, taken once as the log was opened."""
    robot: RobotModel
    robot_toml: str
    """The robot file that ``robot`` was read from; it is attached as it is."""
    plan: FloorPlan | None = None
    extra: dict[str, str] = field(default_factory=dict)
    begun_unix_ns: int | None = None
    """Of this file, where it is not the run's first."""
