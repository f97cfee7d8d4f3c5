"""Encoder of poses, transforms and log lines in Foxglove's protobuf types.

A pose has a fixed length, so one ``struct.pack`` encodes it. Protobuf may omit zero values, but
this encoder writes them. The two integers of a time stamp always have five bytes each; protobuf's
variable-length integers permit this padding. Google's library takes 1 µs per pose.
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import TYPE_CHECKING

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from bridge.record.encode.packer import Packer, Part
from bridge.record.encode.protobuf_wire import WIRE_FIXED64, delimited, tag, varint
from bridge.record.encode.ros import BODY_FRAME, MAP_FRAME
from bridge.session.records import Severity

if TYPE_CHECKING:
    from google.protobuf.descriptor import FileDescriptor

    from bridge.motion.robot_model import RangerMount
    from bridge.session.records import LogRecord

_NANOSECONDS = 1_000_000_000

MessageType = type[PoseInFrame | FrameTransform | Log]
_LEVELS = {
    Severity.DEBUG: Log.DEBUG,
    Severity.INFO: Log.INFO,
    Severity.WARNING: Log.WARNING,
    Severity.ERROR: Log.ERROR,
}


def schema(message: MessageType) -> tuple[str, str, bytes]:
    """Return name, encoding and data of a type's MCAP schema."""
    files: dict[str, FileDescriptor] = {}

    def visit(file: FileDescriptor) -> None:
        for used in file.dependencies:
            visit(used)
        files.setdefault(file.name, file)

    visit(message.DESCRIPTOR.file)
    found = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(found.file.add())
    return message.DESCRIPTOR.full_name, "protobuf", found.SerializeToString()


# ---- messages of fixed length ----------------------------------------------------------------

_STAMP = struct.Struct("<BIBBIB")
STAMP_CODE = f"{_STAMP.size}s"


@lru_cache(maxsize=8)  # the true pose, the estimated pose and the transform have equal times
def timestamp(time_ns: int) -> bytes:
    """Encode Unix nanoseconds as a ``google.protobuf.Timestamp`` of exactly twelve bytes."""
    s, n = divmod(time_ns, _NANOSECONDS)
    # Seven bits per byte. All bytes except the fifth have the continuation bit.
    return _STAMP.pack(
        0x08,
        s & 0x7F | s << 1 & 0x7F00 | s << 2 & 0x7F0000 | s << 3 & 0x7F000000 | 0x80808080,
        s >> 28,
        0x10,
        n & 0x7F | n << 1 & 0x7F00 | n << 2 & 0x7F0000 | n << 3 & 0x7F000000 | 0x80808080,
        n >> 28,
    )


def _stamp_parts() -> tuple[Part, ...]:
    return tag(1, 2), varint(_STAMP.size), STAMP_CODE


def _vector_parts(number: int, names: str) -> tuple[Part, ...]:
    """Return a message of doubles; its fields are numbered in the order of ``xyzw``."""
    parts: list[Part] = []
    for name in names:
        parts += (tag(1 + "xyzw".index(name), WIRE_FIXED64), "d")
    return tag(number, 2), varint(9 * len(names)), *parts


_POSITION, _ROTATION = _vector_parts(1, "xy"), _vector_parts(2, "zw")
POSE_PARTS: tuple[Part, ...] = (
    *_stamp_parts(),
    delimited(2, MAP_FRAME),
    tag(3, 2),
    varint(2 * (2 + 2 * 9)),
    *_POSITION,
    *_ROTATION,
)
"""``PoseInFrame`` in the map frame: stamp, x (m), y (m), sine and cosine of half the yaw."""


def _transform_parts(parent: str, child: str) -> tuple[Part, ...]:
    frames = delimited(2, parent) + delimited(3, child)
    return *_stamp_parts(), frames, *_vector_parts(4, "xy"), *_vector_parts(5, "zw")


TRANSFORM_PARTS = _transform_parts(MAP_FRAME, BODY_FRAME)
"""``FrameTransform`` from the map to the robot; the values are those of ``POSE_PARTS``."""


def mount(time_ns: int, name: str, mount: RangerMount) -> bytes:
    """Encode the ``FrameTransform`` from the robot to a range sensor."""
    form = Packer(_transform_parts(BODY_FRAME, f"range_{name}"))
    half = 0.5 * mount.yaw_rad
    values = (timestamp(time_ns), mount.x_m, mount.y_m, math.sin(half), math.cos(half))
    return form.pack(values)


def log(record: LogRecord) -> bytes:
    """Encode a log line as ``Log``."""
    text = record.text.encode(errors="replace")  # a lone surrogate must not fail
    head = delimited(1, timestamp(record.log_ns)) + tag(2, 0) + varint(_LEVELS[record.severity])
    return head + delimited(3, text) + delimited(4, record.source)
