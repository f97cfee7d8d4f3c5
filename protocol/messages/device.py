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
UNKNOWN = 0xFF
"""Count in a describe reply that says: there is no such message or enumeration here."""


@message(0x10, _DEVICE, _STREAM, default_hz=10, full_stamp=True)
class Sync(Message):
    """Count of all frames sent, to find losses that the 8-bit sequence cannot."""

    frame_count: Annotated[int, number(U32, "count", "frames sent since boot, this one included")]


@message(0x11, _DEVICE, _STREAM, default_hz=10, minimal=True)
class Status(Message):
    """What the device is doing and why it is not."""

    mode: Annotated[int, number(U8, "enum", "what moves the wheels", enum=Mode)]
    stop_cause: Annotated[int, number(U8, "enum", "0: no stop latched", enum=StopCause)]
    faults: Annotated[int, number(U16, "bits", "conditions that hold now", enum=Fault)]
    setpoint_left: Annotated[
        int, number(U8, "s", "time to live left of the setpoint", scale="0.001", high=250)
    ]
    load: Annotated[int, number(U8, "percent", "busy share of the control loop", high=100)]

    setpoint_left_s = si("setpoint_left")


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
    """MPU6050 registers as read: ±2 g, ±250 °/s, in the chip's order."""

    accel_x: Annotated[int, number(I16, "m/s2", "forward", scale=_ACCEL_SCALE)]
    accel_y: Annotated[int, number(I16, "m/s2", "left", scale=_ACCEL_SCALE)]
    accel_z: Annotated[int, number(I16, "m/s2", "up; +1 g at rest", scale=_ACCEL_SCALE)]
    temperature: Annotated[
        int,
        # MPU6050 register map 4.18: raw / 340 + 36.53
        number(I16, "degC", "of the chip", scale="1/340", offset="36.53", can_part=2),
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
    """Absolute wheel counts after ×4; they wrap at 16 bits."""

    left: Annotated[int, number(U16, "count", "left wheel, rising forward")]
    right: Annotated[int, number(U16, "count", "right wheel, rising forward")]


@message(0x20, _DEVICE, _STREAM, default_hz=20)
class Range(Message):
    """Distances and contacts around the robot."""

    ultrasonic: Annotated[
        int,
        number(U16, "m", "front; 65535: no echo", scale="0.001", high=4000, none=ULTRASONIC_NONE),
    ]
    infrared_left: Annotated[
        int,
        number(U8, "m", "255: nothing near", scale="0.00125", high=254, none=INFRARED_NONE),
    ]
    infrared_right: Annotated[
        int,
        number(U8, "m", "255: nothing near", scale="0.00125", high=254, none=INFRARED_NONE),
    ]
    contacts: Annotated[int, number(U8, "bits", "bumper halves and cliff", enum=Contact, high=7)]

    ultrasonic_m = si_or_none("ultrasonic")
    infrared_left_m = si_or_none("infrared_left")
    infrared_right_m = si_or_none("infrared_right")


@message(0x24, _DEVICE, _STREAM, default_hz=5)
class Power(Message):
    """Supply rails and motor currents."""

    battery: Annotated[int, number(U16, "V", "16 V rail", scale="0.001")]
    logic: Annotated[int, number(U8, "V", "5 V rail", scale="0.025")]
    motor_left: Annotated[int, number(U8, "A", "magnitude", scale="0.02")]
    motor_right: Annotated[int, number(U8, "A", "magnitude", scale="0.02")]

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
    """What the device received and dropped since boot; each wraps."""

    received: Annotated[int, number(U16, "count", "intact frames")]
    damaged: Annotated[int, number(U16, "count", "frames with a bad check or form")]
    stale: Annotated[int, number(U16, "count", "setpoints refused as old or repeated")]
    receive_dropped: Annotated[
        int,
        number(U16, "count", "lost for want of room as they came", can_part=1),
    ]
    send_dropped: Annotated[
        int, number(U16, "count", "messages that were not sent for want of room", can_part=1)
    ]
    can_send_errors: Annotated[
        int, number(U8, "count", "error counter of its CAN controller (TEC)", can_part=2)
    ]
    can_receive_errors: Annotated[
        int, number(U8, "count", "error counter of its CAN controller (REC)", can_part=2)
    ]
    can_bus_offs: Annotated[
        int, number(U16, "count", "times that its CAN controller left the bus", can_part=2)
    ]


@message(
    0x2C,
    _DEVICE,
    _STREAM,
    default_hz=5,
    can_parts=(CanPart(0x2C, "target"), CanPart(0x2D, "lane")),
)
class PlannerState(Message):
    """The device's own planner: the paper's variables and where it drives to."""

    phase: Annotated[int, number(U8, "enum", "what it is doing", enum=PlannerPhase)]
    turn_count: Annotated[int, number(U8, "count", "T of the paper")]
    target_x: Annotated[int, number(I16, "m", "in the frame of its start", scale="0.001")]
    target_y: Annotated[int, number(I16, "m", "in the frame of its start", scale="0.001")]
    lane_distance: Annotated[int, number(U16, "m", "D of the paper", scale="0.001", can_part=1)]
    previous_lane_distance: Annotated[
        int, number(U16, "m", "Prev-D of the paper", scale="0.001", can_part=1)
    ]
    length: Annotated[int, number(U8, "m", "Length of the paper", scale="0.02", can_part=1)]
    lane_case: Annotated[
        int, number(U8, "count", "case of the last lane; 0: none", high=3, can_part=1)
    ]

    target_x_m = si("target_x")
    target_y_m = si("target_y")
    lane_distance_m = si("lane_distance")
    previous_lane_distance_m = si("previous_lane_distance")
    length_m = si("length")


@message(0x18, _DEVICE, _RARE, minimal=True)
class TimeReply(Message):
    """Answer to a time request; the header's stamp is the moment of sending."""

    ping: Annotated[int, number(U8, "id", "of the request")]
    received_us: Annotated[int, number(U32, "us", "device clock when the request arrived")]


@message(0x19, _DEVICE, _RARE, bootstrap=True)
class Ack(Message):
    """The command was carried out (repeated as it was for a repeated command)."""

    command_id: Annotated[int, number(U16, "id", "of the command")]
    command_type: Annotated[int, number(U8, "id", "type of the command", high=0x7E)]


@message(0x1A, _DEVICE, _RARE, bootstrap=True)
class Nack(Message):
    """The command was refused, and nothing was done."""

    command_id: Annotated[int, number(U16, "id", "of the command")]
    command_type: Annotated[int, number(U8, "id", "type of the command", high=0x7E)]
    reason: Annotated[int, number(U8, "enum", "why", enum=NackReason)]


@message(0x1B, _DEVICE, _RARE, default_hz=1, bootstrap=True)
class Hello(Message):
    """Who the device is; sent at 1 Hz until a host has agreed, and as answer to its hello."""

    catalogue_hash: Annotated[int, number(U32, "hash", "of the device's whole catalogue")]
    uid: Annotated[bytes, uid("the chip's 96-bit unique id")]
    boot_id: Annotated[int, number(U32, "id", "random, new at each boot")]
    session_id: Annotated[int, number(U32, "id", "the session it belongs to; 0: none")]
    reset_cause: Annotated[int, number(U8, "enum", "why it booted", enum=ResetCause)]
    capabilities: Annotated[int, number(U16, "bits", "what it has", enum=Capability)]
    version_major: Annotated[int, number(U8, "count", "firmware version")]
    version_minor: Annotated[int, number(U8, "count", "firmware version")]
    version_patch: Annotated[int, number(U8, "count", "firmware version")]
    name: Annotated[str, text("the firmware's name")]


@message(0x1C, _DEVICE, _RARE, bootstrap=True)
class DescribeReply(Message):
    """How the device declares one message."""

    described_type: Annotated[int, number(U8, "id", "type asked about", high=0x7E)]
    field_count: Annotated[int, number(U8, "count", "fields it has; 255: no such message")]
    payload_length: Annotated[int, number(U8, "count", "bytes of its fixed part")]
    chain: Annotated[int, number(U32, "hash", "after min(asked, own) fields")]


@message(0x79, _DEVICE, _RARE)
class LogText(Message):
    """A line for people; at most 10 a second."""

    level: Annotated[int, number(U8, "enum", "severity", enum=LogLevel)]
    line: Annotated[str, text("UTF-8")]


@message(0x78, _DEVICE, _RARE)
class ParameterValue(Message):
    """A parameter with all that is to be known of it; sent as get and set are carried out."""

    parameter: Annotated[int, number(U8, "id", "number of the parameter")]
    parameter_count: Annotated[int, number(U8, "count", "parameters that the device has")]
    kind: Annotated[int, number(U8, "enum", "how its 32 bits are read", enum=ParameterKind)]
    flags: Annotated[int, number(U8, "bits", "what is true of it", enum=ParameterFlag)]
    value: Annotated[int, number(U32, "raw", "present value")]
    default: Annotated[int, number(U32, "raw", "after a factory reset")]
    low: Annotated[int, number(U32, "raw", "least value")]
    high: Annotated[int, number(U32, "raw", "greatest value")]
    name: Annotated[str, text('name, a blank, unit: "wheel_diameter m"')]


@message(0x1F, _DEVICE, _RARE)
class Challenge(Message):
    """A key is set: from which count this session's authenticated frames go on; with each hello."""

    counter: Annotated[int, number(U32, "count", "random, new for each session")]


@message(0x1D, _DEVICE, _RARE, default_hz=1, minimal=True)
class ImuInfo(Message):
    """What the counts of the IMU message are worth; sent after hello, and then at 1 Hz."""

    accel: Annotated[int, number(U32, "count/g", "of an accelerometer axis", scale="0.0001", low=1)]
    gyro: Annotated[int, number(U32, "count/(deg/s)", "of a gyroscope axis", scale="0.0001", low=1)]
    temperature: Annotated[int, number(U32, "count/K", "of the thermometer", scale="0.0001", low=1)]
    zero: Annotated[int, number(I16, "degC", "temperature at a count of 0", scale="0.01")]

    accel_per_g = si("accel")
    gyro_per_deg_s = si("gyro")
    temperature_per_k = si("temperature")
    zero_deg_c = si("zero")


@message(0x1E, _DEVICE, _RARE, bootstrap=True)
class DescribeEnumReply(Message):
    """How the device numbers one enumeration."""

    enumeration: Annotated[int, number(U32, "hash", "enumeration asked about")]
    member_count: Annotated[int, number(U8, "count", "members it has; 255: no such enumeration")]
    chain: Annotated[int, number(U32, "hash", "after min(asked, own) members")]
