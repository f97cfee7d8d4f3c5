"""The log writer's encoding of Foxglove messages, compared with Google's protobuf library."""

from __future__ import annotations

import math

import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given
from hypothesis import strategies as st
from mcap_protobuf.schema import build_file_descriptor_set

from bridge.record.encode import foxglove
from bridge.record.encode.packer import Packer


@pytest.mark.parametrize("message", [FrameTransform, Log, PoseInFrame])
def test_the_schema_has_every_file_that_a_reader_needs(message: foxglove.MessageType) -> None:
    name, encoding, data = foxglove.schema(message)
    assert (name, encoding) == (message.DESCRIPTOR.full_name, "protobuf")
    assert FileDescriptorSet.FromString(data) == build_file_descriptor_set(message)


@given(st.integers(0, 2**64 - 1))
def test_a_time_stamp_of_any_moment_is_twelve_bytes(time_ns: int) -> None:
    data = foxglove.timestamp(time_ns)
    read = Timestamp.FromString(data)
    assert (read.seconds, read.nanos, len(data)) == (*divmod(time_ns, 10**9), 12)


@given(*[st.floats(-1e3, 1e3)] * 2, st.floats(-math.pi, math.pi))
def test_a_pose_and_its_transform_read_back(x_m: float, y_m: float, theta_rad: float) -> None:
    stamp, half = foxglove.timestamp(1_700_000_000_123_456_789), 0.5 * theta_rad
    values = (stamp, x_m, y_m, math.sin(half), math.cos(half))
    pose = PoseInFrame.FromString(Packer(foxglove.POSE_PARTS).pack(values))
    moved = FrameTransform.FromString(Packer(foxglove.TRANSFORM_PARTS).pack(values))
    assert (pose.frame_id, moved.parent_frame_id, moved.child_frame_id) == (
        "map",
        "map",
        "base_link",
    )
    for where, turned in (
        (pose.pose.position, pose.pose.orientation),
        (moved.translation, moved.rotation),
    ):
        assert (where.x, where.y, where.z) == (x_m, y_m, 0.0)
        assert (turned.x, turned.y) == (0.0, 0.0)
        assert 2.0 * math.atan2(turned.z, turned.w) == pytest.approx(theta_rad, abs=1e-12)
    assert pose.timestamp.nanos == moved.timestamp.nanos == 123_456_789
