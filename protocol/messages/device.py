"""Messages from a device to the host."""

from __future__ import annotations

from typing import Annotated

from protocol.messages.values import (
    Capability,
    Contact,
    Fault,
    LogLevel,
    Mode,
    NackReason,
    ParameterFlag,
    ParameterKind,
    PlannerPhase,
    ResetCause,
    StopCause,
)
from protocol.schema.fields import (
    I16,
    U8,
    U16,
    U32,
    number,
    si,
    si_or_none,
    text,
    uid,
)
from protocol.schema.message import CanPart, Direction, Message, RateClass, message

_DEVICE = Direction.DEVICE
_STREAM, _RARE = RateClass.STREAM, RateClass.RARE

_ACCEL_SCALE = "9.80665/16384"  # MPU6050 register map 4.17: 16384 LSB/g at ±2 g
_GYRO_SCALE = "1/131"  # MPU6050 register map 4.19: 131 LSB/(°/s) at ±250 °/s
ULTRASONIC_NONE = 0xFFFF
INFRARED_NONE = 0xFF
ULTRASONIC_AGE_NONE = 0xFF
UNKNOWN = 0xFF
"""Count in a describe reply if the device has no such message or enumeration."""


@message(0x10, _DEVICE, _STREAM, default_hz=10, full_stamp=True)
class Sync(Message):
    """Count of all frames sent; reveals losses that the 8-bit sequence number cannot."""

    frame_count: Annotated[int, number(U32, "count", "frames sent since boot, this one included")]


@message(0x11, _DEVICE, _STREAM, default_hz=10, minimal=True)
class Status(Message):
    """Mode, latched stop, faults and load of the device."""

    mode: Annotated[int, number(U8, "enum", "what moves the wheels", enum=Mode)]
    stop_cause: Annotated[
        int, number(U8, "enum", "cause of the latched stop; 0: none", enum=StopCause)
    ]
    faults: Annotated[int, number(U16, "bits", "present conditions", enum=Fault)]
    setpoint_remaining: Annotated[
        int, number(U8, "s", "remaining time to live of the setpoint", scale="0.001", high=250)
    ]
    load: Annotated[int, number(U8, "percent", "busy share of the control period", high=100)]

    setpoint_remaining_s = si("setpoint_remaining")


@message(
    0x13,
    _DEVICE,
    _STREAM,
    default_hz=100,
    minimal=True,
    can_parts=(
        CanPart(0x13, "acceleration"),
        CanPart(0x14, "rotation"),
        CanPart(0x15, "temperature", slow_us=1_000_000),
    ),
)
class Imu(Message):
    """Raw counts in the MPU6050's register order; ±2 g, ±250 °/s unless ``imu_info`` differs."""

    accel_x: Annotated[int, number(I16, "m/s2", "forward", scale=_ACCEL_SCALE)]
    accel_y: Annotated[int, number(I16, "m/s2", "left", scale=_ACCEL_SCALE)]
    accel_z: Annotated[int, number(I16, "m/s2", "up; +1 g at rest", scale=_ACCEL_SCALE)]
    temperature: Annotated[
        int,
        # MPU6050 register map 4.18: raw / 340 + 36.53
        number(I16, "degC", "chip temperature", scale="1/340", offset="36.53", can_part=2),
    ]
    gyro_x: Annotated[int, number(I16, "deg/s", "roll rate", scale=_GYRO_SCALE, can_part=1)]
    gyro_y: Annotated[int, number(I16, "deg/s", "pitch rate", scale=_GYRO_SCALE, can_part=1)]
    gyro_z: Annotated[int, number(I16, "deg/s", "yaw rate", scale=_GYRO_SCALE, can_part=1)]

    accel_x_m_s2 = si("accel_x")
    accel_y_m_s2 = si("accel_y")
    accel_z_m_s2 = si("accel_z")
    temperature_deg_c = si("temperature")
    gyro_x_rad_s = si("gyro_x")
    gyro_y_rad_s = si("gyro_y")
    gyro_z_rad_s = si("gyro_z")


@message(0x16, _DEVICE, _STREAM, default_hz=50, minimal=True)
class Encoders(Message):
    """Absolute wheel counts after ×4 decoding; they wrap at 16 bits."""

    left: Annotated[int, number(U16, "count", "left wheel; increases forward")]
    right: Annotated[int, number(U16, "count", "right wheel; increases forward")]


@message(0x20, _DEVICE, _STREAM, default_hz=20)
class Range(Message):
    """Distances and contacts around the robot, stamped when infrared and contacts were sampled."""

    ultrasonic: Annotated[
        int,
        number(
            U16,
            "m",
            "distance ahead; 65535: no echo",
            scale="0.001",
            high=4000,
            none=ULTRASONIC_NONE,
        ),
    ]
    infrared_left: Annotated[
        int,
        number(
            U8,
            "m",
            "distance to the left; 255: out of range",
            scale="0.00125",
            high=254,
            none=INFRARED_NONE,
        ),
    ]
    infrared_right: Annotated[
        int,
        number(
            U8,
            "m",
            "distance to the right; 255: out of range",
            scale="0.00125",
            high=254,
            none=INFRARED_NONE,
        ),
    ]
    contacts: Annotated[
        int, number(U8, "bits", "bumper switches and cliff sensor", enum=Contact, high=7)
    ]
    ultrasonic_age: Annotated[
        int,
        number(
            U8,
            "s",
            "from the ultrasonic pulse to the stamp; 255: longer",
            scale="0.001",
            high=254,
            none=ULTRASONIC_AGE_NONE,
        ),
    ]

    ultrasonic_m = si_or_none("ultrasonic")
    infrared_left_m = si_or_none("infrared_left")
    infrared_right_m = si_or_none("infrared_right")
    ultrasonic_age_s = si_or_none("ultrasonic_age")


@message(0x24, _DEVICE, _STREAM, default_hz=5)
class Power(Message):
    """Supply rails and motor currents."""

    battery: Annotated[int, number(U16, "V", "16 V rail", scale="0.001")]
    logic: Annotated[int, number(U8, "V", "5 V rail", scale="0.025")]
    motor_left: Annotated[int, number(U8, "A", "absolute current", scale="0.02")]
    motor_right: Annotated[int, number(U8, "A", "absolute current", scale="0.02")]

    battery_v = si("battery")
    logic_v = si("logic")
    motor_left_a = si("motor_left")
    motor_right_a = si("motor_right")


@message(
    0x28,
    _DEVICE,
    _STREAM,
    default_hz=1,
    can_parts=(CanPart(0x28, "received"), CanPart(0x29, "dropped"), CanPart(0x2A, "can")),
)
class LinkCounters(Message):
    """Counters of received and dropped frames since boot; each wraps."""

    received: Annotated[int, number(U16, "count", "intact frames")]
    damaged: Annotated[int, number(U16, "count", "frames with an invalid CRC or format")]
    stale: Annotated[int, number(U16, "count", "setpoints rejected as too old or repeated")]
    receive_dropped: Annotated[
        int,
        number(U16, "count", "received frames dropped because a queue was full", can_part=1),
    ]
    send_dropped: Annotated[
        int, number(U16, "count", "messages not sent because a queue was full", can_part=1)
    ]
    can_send_errors: Annotated[
        int, number(U8, "count", "transmit error counter (TEC) of the CAN controller", can_part=2)
    ]
    can_receive_errors: Annotated[
        int, number(U8, "count", "receive error counter (REC) of the CAN controller", can_part=2)
    ]
    can_bus_offs: Annotated[
        int, number(U16, "count", "bus-off events of the CAN controller", can_part=2)
    ]


@message(
    0x2C,
    _DEVICE,
    _STREAM,
    default_hz=5,
    can_parts=(CanPart(0x2C, "target"), CanPart(0x2D, "lane")),
)
class PlannerState(Message):
    """State of the device's own planner: the paper's variables and the target."""

    phase: Annotated[int, number(U8, "enum", "current phase", enum=PlannerPhase)]
    turn_count: Annotated[int, number(U8, "count", "T of the paper")]
    target_x: Annotated[int, number(I16, "m", "in the frame of the start pose", scale="0.001")]
    target_y: Annotated[int, number(I16, "m", "in the frame of the start pose", scale="0.001")]
    lane_distance: Annotated[int, number(U16, "m", "D of the paper", scale="0.001", can_part=1)]
    previous_lane_distance: Annotated[
        int, number(U16, "m", "Prev-D of the paper", scale="0.001", can_part=1)
    ]
    length: Annotated[int, number(U8, "m", "Length of the paper", scale="0.02", can_part=1)]
    lane_case: Annotated[
        int, number(U8, "count", "case of the last lane in the paper; 0: none", high=3, can_part=1)
    ]

    target_x_m = si("target_x")
    target_y_m = si("target_y")
    lane_distance_m = si("lane_distance")
    previous_lane_distance_m = si("previous_lane_distance")
    length_m = si("length")


@message(0x18, _DEVICE, _RARE, minimal=True)
class TimeReply(Message):
    """Answer to a time request; the header's stamp is the time of sending."""

    ping: Annotated[int, number(U8, "id", "copied from the request")]
    received_us: Annotated[int, number(U32, "us", "device clock when the request arrived")]


@message(0x19, _DEVICE, _RARE, bootstrap=True)
class Ack(Message):
    """The command was carried out. A repeated command gets the same reply again."""

    command_id: Annotated[int, number(U16, "id", "of the command")]
    command_type: Annotated[int, number(U8, "id", "type of the command", high=0x7E)]


@message(0x1A, _DEVICE, _RARE, bootstrap=True)
class Nack(Message):
    """The command was rejected and not carried out."""

    command_id: Annotated[int, number(U16, "id", "of the command")]
    command_type: Annotated[int, number(U8, "id", "type of the command", high=0x7E)]
    reason: Annotated[int, number(U8, "enum", "reason", enum=NackReason)]


@message(0x1B, _DEVICE, _RARE, default_hz=1, bootstrap=True)
class Hello(Message):
    """Identity of the device; sent at 1 Hz until negotiated, and in reply to ``host_hello``."""

    catalogue_hash: Annotated[int, number(U32, "hash", "of the device's whole catalogue")]
    uid: Annotated[bytes, uid("the chip's 96-bit unique id")]
    boot_id: Annotated[int, number(U32, "id", "random, new at each boot")]
    session_id: Annotated[int, number(U32, "id", "its current session; 0: none")]
    reset_cause: Annotated[int, number(U8, "enum", "cause of the last reset", enum=ResetCause)]
    capabilities: Annotated[int, number(U16, "bits", "features of the device", enum=Capability)]
    version_major: Annotated[int, number(U8, "count", "firmware version")]
    version_minor: Annotated[int, number(U8, "count", "firmware version")]
    version_patch: Annotated[int, number(U8, "count", "firmware version")]
    name: Annotated[str, text("name of the firmware")]


@message(0x1C, _DEVICE, _RARE, bootstrap=True)
class DescribeReply(Message):
    """The device's declaration of one message."""

    described_type: Annotated[int, number(U8, "id", "requested message type", high=0x7E)]
    field_count: Annotated[
        int, number(U8, "count", "fields that the device declares; 255: no such message")
    ]
    payload_length: Annotated[int, number(U8, "count", "length of the fixed part in bytes")]
    chain: Annotated[int, number(U32, "hash", "chain value after min(requested, own) fields")]


@message(0x79, _DEVICE, _RARE)
class LogText(Message):
    """A log line; at most 10 per second."""

    level: Annotated[int, number(U8, "enum", "severity", enum=LogLevel)]
    line: Annotated[str, text("UTF-8")]


@message(0x78, _DEVICE, _RARE)
class ParameterValue(Message):
    """A parameter's value, limits and name; sent for get and set."""

    parameter: Annotated[int, number(U8, "id", "index of the parameter")]
    parameter_count: Annotated[int, number(U8, "count", "number of parameters of the device")]
    kind: Annotated[int, number(U8, "enum", "type of the 32-bit values", enum=ParameterKind)]
    flags: Annotated[int, number(U8, "bits", "state of the value", enum=ParameterFlag)]
    value: Annotated[int, number(U32, "raw", "current value")]
    default: Annotated[int, number(U32, "raw", "value after a factory reset")]
    low: Annotated[int, number(U32, "raw", "minimum")]
    high: Annotated[int, number(U32, "raw", "maximum")]
    name: Annotated[str, text('name, a space, unit: "wheel_diameter m"')]


@message(0x1F, _DEVICE, _RARE)
class Challenge(Message):
    """Start of the counter of this session's signed frames; sent with hello if a key is set."""

    counter: Annotated[int, number(U32, "count", "random, new for each session")]


@message(0x1D, _DEVICE, _RARE, default_hz=1, minimal=True)
class ImuInfo(Message):
    """Scale of the raw counts in ``imu``; sent after hello and at 1 Hz."""

    accel: Annotated[
        int, number(U32, "count/g", "accelerometer sensitivity", scale="0.0001", low=1)
    ]
    gyro: Annotated[
        int, number(U32, "count/(deg/s)", "gyroscope sensitivity", scale="0.0001", low=1)
    ]
    temperature: Annotated[
        int, number(U32, "count/K", "thermometer sensitivity", scale="0.0001", low=1)
    ]
    zero: Annotated[int, number(I16, "degC", "temperature at a raw count of 0", scale="0.01")]

    accel_per_g = si("accel")
    gyro_per_deg_s = si("gyro")
    temperature_per_k = si("temperature")
    zero_deg_c = si("zero")


@message(0x1E, _DEVICE, _RARE, bootstrap=True)
class DescribeEnumReply(Message):
    """The device's numbering of one enumeration."""

    enumeration: Annotated[int, number(U32, "hash", "requested enumeration")]
    member_count: Annotated[
        int, number(U8, "count", "members that the device declares; 255: no such enumeration")
    ]
    chain: Annotated[int, number(U32, "hash", "chain value after min(requested, own) members")]
