"""A second, simple and slow codec that shares no code with ``protocol``.

The byte offsets and scales are typed in by hand from the description of the wire format. The CRC
works bit by bit, and COBS byte by byte. If the results of this codec and of ``protocol`` differ,
one of the two is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

VERSION = 2
LONGEST_DECODED = 253
SHORTEST_DECODED = 12


class CobsError(ValueError):
    """Bytes that are not valid COBS."""


def crc32(data: bytes) -> int:
    """Return the CRC-32 of zlib: reflected 0x04C11DB7, initial value and final XOR all ones."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            lowest = register & 1
            register >>= 1
            if lowest:
                register ^= 0xEDB88320  # 0x04C11DB7 with its bits in reverse
    return register ^ 0xFFFFFFFF


def cobs_encode(data: bytes) -> bytes:
    """Replace each zero by the distance to the next zero; 0xFF means 254 bytes without a zero."""
    out = bytearray()
    group = bytearray()
    for position, byte in enumerate(data):
        if byte == 0:
            out.append(len(group) + 1)
            out += group
            group.clear()
            continue
        group.append(byte)
        if len(group) == 254 and position + 1 < len(data):
            out.append(255)
            out += group
            group.clear()
    out.append(len(group) + 1)
    out += group
    return bytes(out)


def cobs_decode(data: bytes) -> bytes:
    """Decode the output of :func:`cobs_encode`.

    Raises:
        CobsError: there is a zero byte, or a distance points past the end.

    """
    out = bytearray()
    position = 0
    while position < len(data):
        code = data[position]
        group = data[position + 1 : position + code]
        if code == 0 or 0 in group or len(group) != code - 1:
            raise CobsError(position)
        out += group
        position += code
        if code != 255 and position < len(data):
            out.append(0)
    return bytes(out)


# ---- framing ----------------------------------------------------------------------------


@dataclass(frozen=True)
class RefFrame:
    """An intact frame: header fields as numbers, payload, and position of the first byte."""

    offset: int
    version: int
    flags: int
    node: int
    type_id: int
    seq: int
    t_us: int
    payload: bytes


@dataclass(frozen=True)
class RefDamage:
    """Bytes between two delimiters that are no valid frame; the reason is cobs, length or crc."""

    offset: int
    length: int
    damage: str


def frame_bytes(  # noqa: PLR0913 - the header's fields
    *,
    flags: int,
    node: int,
    type_id: int,
    seq: int,
    t_us: int,
    payload: bytes,
    version: int = VERSION,
) -> bytes:
    """Write one frame by its byte offsets, with a delimiter before and after it."""
    body = bytearray(8)
    body[0] = version * 16 + flags
    body[1] = node
    body[2] = type_id
    body[3] = seq
    for i in range(4):
        body[4 + i] = (t_us >> (8 * i)) % 256
    body += payload
    check = crc32(bytes(body))
    for i in range(4):
        body.append((check >> (8 * i)) % 256)
    return b"\0" + cobs_encode(bytes(body)) + b"\0"


def parse_stream(data: bytes) -> list[RefFrame | RefDamage]:
    """Parse a whole stream; bytes after the last zero are incomplete and ignored."""
    found: list[RefFrame | RefDamage] = []
    first = 0
    for position, byte in enumerate(data):
        if byte == 0:
            if position > first:
                found.append(_stretch(data[first:position], first))
            first = position + 1
    return found


def _stretch(piece: bytes, offset: int) -> RefFrame | RefDamage:
    if len(piece) > LONGEST_DECODED + 1:
        return RefDamage(offset, len(piece), "length")
    try:
        body = cobs_decode(piece)
    except CobsError:
        return RefDamage(offset, len(piece), "cobs")
    if len(body) < SHORTEST_DECODED:
        return RefDamage(offset, len(piece), "length")
    content, check = body[:-4], body[-4:]
    if crc32(content) != check[0] + 256 * check[1] + 65536 * check[2] + 16777216 * check[3]:
        return RefDamage(offset, len(piece), "crc")
    stamp = content[4] + 256 * content[5] + 65536 * content[6] + 16777216 * content[7]
    return RefFrame(
        offset=offset,
        version=content[0] // 16,
        flags=content[0] % 16,
        node=content[1],
        type_id=content[2],
        seq=content[3],
        t_us=stamp,
        payload=content[8:],
    )


# ---- messages ---------------------------------------------------------------------------

G = 9.80665 / 16384
"""Scale of an accelerometer count at ±2 g, m/s²."""
DPS = math.pi / 180 / 131
"""Scale of a gyroscope count at ±250 °/s, rad/s."""

Row = tuple[str, str] | tuple[str, str, str, float] | tuple[str, str, str, float, int]
"""Name and wire type; then the SI property and the value of one count; then the sentinel."""

LAYOUTS: dict[int, tuple[str, str, list[Row]]] = {
    0x00: ("stop_all", "host", []),
    0x01: ("stop", "host", [("command_id", "u16"), ("cause", "u8")]),
    0x02: (
        "velocity_setpoint",
        "host",
        [
            ("v", "i16", "v_m_s", 0.0001),
            ("yaw_rate", "i16", "yaw_rate_rad_s", 0.0002),
            ("time_to_live", "u8", "time_to_live_s", 0.001),
            ("counter", "u8"),
        ],
    ),
    0x0A: (
        "wheel_duty",
        "host",
        [
            ("left", "i16", "left_duty", 0.0001),
            ("right", "i16", "right_duty", 0.0001),
            ("time_to_live", "u8", "time_to_live_s", 0.001),
            ("counter", "u8"),
        ],
    ),
    0x04: (
        "host_hello",
        "host",
        [
            ("catalogue_hash", "u32"),
            ("session_id", "u32"),
            ("boot_id", "u32"),
            ("negotiated", "u8"),
            ("name", "text"),
        ],
    ),
    0x05: ("clear_stop", "host", [("command_id", "u16"), ("cause", "u8")]),
    0x06: ("set_mode", "host", [("command_id", "u16"), ("mode", "u8")]),
    0x07: ("time_request", "host", [("ping", "u8")]),
    0x08: ("describe", "host", [("described_type", "u8"), ("field_count", "u8")]),
    0x09: (
        "planner_command",
        "host",
        [("command_id", "u16"), ("action", "u8"), ("planner", "u8")],
    ),
    0x70: ("get_parameter", "host", [("command_id", "u16"), ("parameter", "u8")]),
    0x71: (
        "set_parameter",
        "host",
        [("command_id", "u16"), ("parameter", "u8"), ("kind", "u8"), ("value", "u32")],
    ),
    0x72: ("save_parameters", "host", [("command_id", "u16")]),
    0x0D: (
        "set_stream_rate",
        "host",
        [("command_id", "u16"), ("stream_type", "u8"), ("rate", "u16", "rate_hz", 0.1)],
    ),
    0x0E: ("reboot", "host", [("command_id", "u16"), ("kind", "u8")]),
    0x73: (
        "set_key",
        "host",
        [
            ("command_id", "u16"),
            ("key_0", "u32"),
            ("key_1", "u32"),
            ("key_2", "u32"),
            ("key_3", "u32"),
        ],
    ),
    0x10: ("sync", "device", [("frame_count", "u32")]),
    0x11: (
        "status",
        "device",
        [
            ("mode", "u8"),
            ("stop_cause", "u8"),
            ("faults", "u16"),
            ("setpoint_remaining", "u8", "setpoint_remaining_s", 0.001),
            ("load", "u8"),
        ],
    ),
    0x13: (
        "imu",
        "device",
        [
            ("accel_x", "i16", "accel_x_m_s2", G),
            ("accel_y", "i16", "accel_y_m_s2", G),
            ("accel_z", "i16", "accel_z_m_s2", G),
            ("temperature", "i16", "temperature_deg_c", 1 / 340),
            ("gyro_x", "i16", "gyro_x_rad_s", DPS),
            ("gyro_y", "i16", "gyro_y_rad_s", DPS),
            ("gyro_z", "i16", "gyro_z_rad_s", DPS),
        ],
    ),
    0x16: ("encoders", "device", [("left", "u16"), ("right", "u16")]),
    0x20: (
        "range",
        "device",
        [
            ("ultrasonic", "u16", "ultrasonic_m", 0.001, 65535),
            ("infrared_left", "u8", "infrared_left_m", 0.00125, 255),
            ("infrared_right", "u8", "infrared_right_m", 0.00125, 255),
            ("contacts", "u8"),
            ("ultrasonic_age", "u8", "ultrasonic_age_s", 0.001, 255),
        ],
    ),
    0x24: (
        "power",
        "device",
        [
            ("battery", "u16", "battery_v", 0.001),
            ("logic", "u8", "logic_v", 0.025),
            ("motor_left", "u8", "motor_left_a", 0.02),
            ("motor_right", "u8", "motor_right_a", 0.02),
        ],
    ),
    0x28: (
        "link_counters",
        "device",
        [
            ("received", "u16"),
            ("damaged", "u16"),
            ("stale", "u16"),
            ("receive_dropped", "u16"),
            ("send_dropped", "u16"),
            ("can_send_errors", "u8"),
            ("can_receive_errors", "u8"),
            ("can_bus_offs", "u16"),
        ],
    ),
    0x2C: (
        "planner_state",
        "device",
        [
            ("phase", "u8"),
            ("turn_count", "u8"),
            ("target_x", "i16", "target_x_m", 0.001),
            ("target_y", "i16", "target_y_m", 0.001),
            ("lane_distance", "u16", "lane_distance_m", 0.001),
            ("previous_lane_distance", "u16", "previous_lane_distance_m", 0.001),
            ("length", "u8", "length_m", 0.02),
            ("lane_case", "u8"),
        ],
    ),
    0x18: ("time_reply", "device", [("ping", "u8"), ("received_us", "u32")]),
    0x19: ("ack", "device", [("command_id", "u16"), ("command_type", "u8")]),
    0x1A: ("nack", "device", [("command_id", "u16"), ("command_type", "u8"), ("reason", "u8")]),
    0x1B: (
        "hello",
        "device",
        [
            ("catalogue_hash", "u32"),
            ("uid", "uid96"),
            ("boot_id", "u32"),
            ("session_id", "u32"),
            ("reset_cause", "u8"),
            ("capabilities", "u16"),
            ("version_major", "u8"),
            ("version_minor", "u8"),
            ("version_patch", "u8"),
            ("name", "text"),
        ],
    ),
    0x1C: (
        "describe_reply",
        "device",
        [
            ("described_type", "u8"),
            ("field_count", "u8"),
            ("payload_length", "u8"),
            ("chain", "u32"),
        ],
    ),
    0x79: ("log_text", "device", [("level", "u8"), ("line", "text")]),
    0x78: (
        "parameter_value",
        "device",
        [
            ("parameter", "u8"),
            ("parameter_count", "u8"),
            ("kind", "u8"),
            ("flags", "u8"),
            ("value", "u32"),
            ("default", "u32"),
            ("low", "u32"),
            ("high", "u32"),
            ("name", "text"),
        ],
    ),
    0x1F: ("challenge", "device", [("counter", "u32")]),
    0x0C: ("describe_enum", "host", [("enumeration", "u32"), ("member_count", "u8")]),
    0x1D: (
        "imu_info",
        "device",
        [
            ("accel", "u32", "accel_per_g", 0.0001),
            ("gyro", "u32", "gyro_per_deg_s", 0.0001),
            ("temperature", "u32", "temperature_per_k", 0.0001),
            ("zero", "i16", "zero_deg_c", 0.01),
        ],
    ),
    0x1E: (
        "describe_enum_reply",
        "device",
        [("enumeration", "u32"), ("member_count", "u8"), ("chain", "u32")],
    ),
}

OFFSETS = {"temperature_deg_c": 36.53}
SIZES = {"u8": 1, "u16": 2, "i16": 2, "u32": 4, "uid96": 12}


def encode_payload(type_id: int, values: dict[str, object]) -> bytes:
    """Write fields one after the other, lowest byte first."""
    out = bytearray()
    for row in LAYOUTS[type_id][2]:
        value = values[row[0]]
        if isinstance(value, str):
            out += value.encode("utf-8")
        elif isinstance(value, bytes):
            out += value
        elif isinstance(value, int):
            for i in range(SIZES[row[1]]):
                out.append((value >> (8 * i)) & 0xFF)
    return bytes(out)


def decode_payload(type_id: int, payload: bytes) -> dict[str, object]:
    """Read fields one after the other; the payload must have the declared length."""
    values: dict[str, object] = {}
    position = 0
    for row in LAYOUTS[type_id][2]:
        name, kind = row[0], row[1]
        if kind == "text":
            values[name] = payload[position:].decode("utf-8", "replace")
            position = len(payload)
            continue
        taken = payload[position : position + SIZES[kind]]
        if len(taken) != SIZES[kind]:
            raise ValueError(name)
        position += len(taken)
        if kind == "uid96":
            values[name] = taken
            continue
        number = 0
        for i, byte in enumerate(taken):
            number += byte * 256**i
        if kind == "i16" and number >= 32768:
            number -= 65536
        values[name] = number
    if position != len(payload):
        raise ValueError(payload[position:])
    return values


def si_values(type_id: int, values: dict[str, object]) -> dict[str, float | None]:
    """Return every physical value of a message in SI units by its property's name."""
    out: dict[str, float | None] = {}
    for row in LAYOUTS[type_id][2]:
        if len(row) == 2:
            continue
        raw = values[row[0]]
        assert isinstance(raw, int)
        if len(row) == 5 and raw == row[4]:
            out[row[2]] = None
        else:
            out[row[2]] = raw * row[3] + OFFSETS.get(row[2], 0.0)
    return out
