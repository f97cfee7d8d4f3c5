"""Encoder of device messages and maps as ROS 2 messages, for other tools.

The field lists are the definitions of ``sensor_msgs``, ``nav_msgs``, ``geometry_msgs``,
``std_msgs`` and ``builtin_interfaces``. They have the concatenated form that MCAP calls
``ros2msg``.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from bridge.record.encode.cdr import LITTLE_ENDIAN, CdrLayout, stamp
from bridge.record.wheels import WheelAngles
from bridge.session.records import CoverageRecord
from protocol.messages.device import Encoders, Imu, Power, Range

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.robot_model import RangerMount, RobotModel
    from bridge.session.records import DeviceMessage

BODY_FRAME = "base_link"
MAP_FRAME = "map"

_DEPENDENCIES = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": ("geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"),
    "nav_msgs/MapMetaData": (
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\n"
        "uint32 height\ngeometry_msgs/Pose origin"
    ),
}
_FIELDS = {
    "sensor_msgs/msg/Imu": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\n"
        "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/msg/BatteryState": (
        "std_msgs/Header header\n"
        "float32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\n"
        "float32 capacity\nfloat32 design_capacity\nfloat32 percentage\n"
        "uint8 power_supply_status\nuint8 power_supply_health\nuint8 power_supply_technology\n"
        "bool present\nfloat32[] cell_voltage\nfloat32[] cell_temperature\n"
        "string location\nstring serial_number"
    ),
    "sensor_msgs/msg/Range": (
        "std_msgs/Header header\n"
        "uint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n"
        "float32 range\nfloat32 variance"
    ),
    "nav_msgs/msg/OccupancyGrid": (
        "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data"
    ),
}
IMU, JOINT_STATE, BATTERY_STATE, RANGE, OCCUPANCY_GRID = _FIELDS
"""Names of the message types, as in an MCAP schema."""


def schema_text(name: str) -> str:
    """Return a type's fields and those of every type that it uses."""
    text, pending, done = _FIELDS[name], [_FIELDS[name]], set[str]()
    while pending:
        for line in pending.pop().splitlines():
            used = line.split()[0].partition("[")[0]
            if used in _DEPENDENCIES and used not in done:
                done.add(used)
                pending.append(_DEPENDENCIES[used])
                text += f"\n{'=' * 80}\nMSG: {used}\n{_DEPENDENCIES[used]}"
    return text


class RosTopic(NamedTuple):
    """A ROS topic for a device message. The first two values are the time stamp."""

    name: str
    type_name: str
    layout: CdrLayout
    age: int | None = None
    """Index of the field with the sample's age when the message was stamped; None: no age."""


class RosMessages(NamedTuple):
    """ROS topics and values of one type of device message."""

    topics: tuple[RosTopic, ...]
    needs: int
    """Number of leading fields that the device's message must have."""
    raw: tuple[int, ...] = ()
    """Index and gain of each field, if all values are scaled fields."""
    values: Callable[[DeviceMessage], tuple[float, ...]] | None = None
    """Function that returns the values of all topics in order, without time stamps. Used if some
    values are not scaled fields."""


_NO_COVARIANCE = [("d", 0.0)] * 9
_IMU = CdrLayout(
    "2I",
    ("text", BODY_FRAME),
    *[("d", 0.0)] * 3,
    ("d", 1.0),
    ("d", -1.0),  # first covariance -1: no orientation
    *[("d", 0.0)] * 8,
    "3d",
    *_NO_COVARIANCE,
    "3d",
    *_NO_COVARIANCE,
)
_IMU_VALUES = (4, 5, 6, 0, 1, 2)
"""Indices of the fields: rates, then accelerations."""
_JOINT_STATE = CdrLayout(
    "2I",
    ("text", BODY_FRAME),
    ("I", 2),
    ("text", "left_wheel"),
    ("text", "right_wheel"),
    ("I", 2),
    "2d",
    ("I", 2),
    "2d",
    ("I", 0),
)

_DISCHARGING = 2
_ULTRASOUND, _INFRARED = 0, 1
_ULTRASONIC_AGE = 4
"""Index of the field ``ultrasonic_age`` of the range message."""


def _ranger(name: str, mount: RangerMount, radiation: int, age: int | None = None) -> RosTopic:
    layout = CdrLayout(
        "2I",
        ("text", f"range_{name}"),
        ("B", radiation),
        ("f", mount.cone_rad),
        ("f", mount.min_range_m),
        ("f", mount.max_range_m),
        "f",
        ("f", 0.0),
    )
    return RosTopic(f"/ros/range/{name}", RANGE, layout, age)


class RosTranslator:
    """Converts device messages to ROS 2. The messages of a robot must be passed in order."""

    def __init__(self, model: RobotModel) -> None:
        self._rad_per_count = 2.0 * math.pi / model.counts_per_turn
        self._wheels: dict[int, WheelAngles] = {}
        nan = ("f", math.nan)  # not measured
        battery = CdrLayout(
            "2I",
            ("text", BODY_FRAME),
            "f",
            *(nan, nan, nan, nan),
            ("f", model.battery_ah),
            nan,
            ("B", _DISCHARGING),
            ("B", 0),
            ("B", 0),
            ("?", True),
            *(("I", 0), ("I", 0)),
            ("text", ""),
            ("text", ""),
        )
        joints = RosTopic("/ros/joint_states", JOINT_STATE, _JOINT_STATE)
        ranges = (
            _ranger("front", model.ultrasonic, _ULTRASOUND, _ULTRASONIC_AGE),
            _ranger("left", model.infrared_left, _INFRARED),
            _ranger("right", model.infrared_right, _INFRARED),
        )
        self._forms: dict[type, RosMessages] = {
            Imu: RosMessages((RosTopic("/ros/imu", IMU, _IMU),), 7, _IMU_VALUES),
            Encoders: RosMessages((joints,), 2, values=self._encoders),
            Range: RosMessages(ranges, 3, values=self._range),
            Power: RosMessages((RosTopic("/ros/battery", BATTERY_STATE, battery),), 1, (0,)),
        }

    def form(self, message: type) -> RosMessages | None:
        """Return the ROS form of this message type; None if there is none."""
        return self._forms.get(message)

    def _encoders(self, record: DeviceMessage) -> tuple[float, ...]:
        left, right, *_ = record.message
        wheels = self._wheels.get(record.node)
        if wheels is None:
            wheels = self._wheels[record.node] = WheelAngles(self._rad_per_count)
        return wheels.advance((left, right), record.t_us)

    @staticmethod
    def _range(record: DeviceMessage) -> tuple[float, ...]:
        """Return the ranges. A missing echo is +infinity (REP 117)."""
        message = cast("Range", record.message)
        ranges = (message.ultrasonic_m, message.infrared_left_m, message.infrared_right_m)
        return tuple(math.inf if m is None else m for m in ranges)


def occupancy_grid(record: CoverageRecord) -> bytes:
    """Encode a map as ``nav_msgs/OccupancyGrid`` in the map frame."""
    rows, columns = record.cells.shape
    time = stamp(record.log_ns)
    head = _GRID_HEAD.encode(
        *time,
        *time,
        record.resolution_m,
        columns,
        rows,
        record.origin_x_m,
        record.origin_y_m,
        rows * columns,
    )
    return head + record.cells.astype("i1").tobytes()


_GRID_HEAD = CdrLayout(
    "2I",
    ("text", MAP_FRAME),
    "2I",
    "f",
    "2I",
    "2d",
    *[("d", 0.0)] * 4,
    ("d", 1.0),
    "I",
)


def parse_occupancy_grid(log_ns: int, data: bytes) -> CoverageRecord:
    """Parse ``nav_msgs/OccupancyGrid`` without a copy of its cells.

    The library's decoder creates a Python integer per cell and takes a hundred times as long. The
    orientation of the origin is ignored.

    Raises:
        ValueError: the data are not a grid in little-endian CDR, or are truncated.

    """
    if not data.startswith(LITTLE_ENDIAN):
        raise ValueError("the grid is not in little-endian CDR")
    body = memoryview(data)[len(LITTLE_ENDIAN) :]
    try:
        (length,) = struct.unpack_from("<I", body, 8)
        info = _aligned(12 + length, 4)
        resolution_m, columns, rows = struct.unpack_from("<f2I", body, info + 8)
        origin = _aligned(info + 20, 8)
        x_m, y_m = struct.unpack_from("<2d", body, origin)
        cells = np.frombuffer(body, dtype=np.int8, count=rows * columns, offset=origin + 60)
    except (struct.error, OverflowError) as error:
        raise ValueError(str(error)) from None
    return CoverageRecord(log_ns, cells.reshape(rows, columns), x_m, y_m, resolution_m)


def _aligned(offset: int, size: int) -> int:
    return offset + -offset % size
