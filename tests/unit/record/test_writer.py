"""The log messages of each kind of record, read back with the mcap library."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2._dynamic import serialize_dynamic

from bridge.config import to_toml
from bridge.coverage.planner import PlannerState
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.encode.ros import (
    OCCUPANCY_GRID,
    occupancy_grid,
    parse_occupancy_grid,
    schema_text,
)
from bridge.record.log_writer import RunWriter
from bridge.session.records import (
    ClockRecord,
    CommandRecord,
    CoverageRecord,
    DeviceMessage,
    EventRecord,
    LogRecord,
    PlannerRecord,
    PoseRecord,
    RawBytes,
    RawCan,
    RoomRecord,
    Severity,
    TruthRecord,
)
from protocol.imu import NOMINAL
from protocol.messages.device import Encoders, Imu, Power, Range
from protocol.schema.catalogue import CATALOGUE
from support.synthetic_run import EPOCH_NS, PLAN, run_info, summary

if TYPE_CHECKING:
    from pathlib import Path

    from protocol.schema.message import Message
from support.read_log import written

NOW = EPOCH_NS + 123_456_789


def device(message: Message, t_us: int = 1000, seq: int = 7, node: int = 1) -> DeviceMessage:
    name = CATALOGUE.spec(type(message)).name
    return DeviceMessage(NOW, NOW - 5000, 2000, node, seq, t_us, name, message)


def test_attachments_and_metadata_come_before_the_first_message(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written(path, LogRecord(NOW, Severity.INFO, "session", "hello"))
    with path.open("rb") as file:
        kinds = [type(r).__name__ for r in StreamReader(file, emit_chunks=True).records]
    assert kinds[:6] == ["Header", "Attachment", "Attachment", "Attachment", "Metadata", "Chunk"]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        attachments = {a.name: a.data for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert attachments["robot.toml"].decode() == to_toml(RobotModel())
    assert parse_floorplan(attachments["room.json"].decode()) == PLAN
    declared = json.loads(attachments["catalogue.json"])
    assert [m["name"] for m in declared["messages"]] == [s.name for s in CATALOGUE]
    imu = next(m for m in declared["messages"] if m["name"] == "imu")
    assert [f["name"] for f in imu["fields"]] == [f.name for f in CATALOGUE.by_name["imu"].fields]
    assert json.loads(attachments["summary.json"]) == summary()
    printed = metadata["sweepctl"]
    assert (printed["port"], printed["planner"], printed["seed"]) == ("memory", "u-shape", "1")
    assert printed["catalogue_hash"] == f"{CATALOGUE.hash:08x}"
    assert printed["room"] == "synthetic"
    assert int(printed["clock_offset_ns"]) == run_info().clock_offset_ns


def test_a_run_without_a_room_has_no_room_attachment(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run.mcap", run_info(plan=None))
    writer.close()
    with (tmp_path / "run.mcap").open("rb") as file:
        names = [a.name for a in make_reader(file).iter_attachments()]
    assert names == ["robot.toml", "catalogue.json"]


def test_raw_bytes_are_kept_bit_for_bit(tmp_path: Path) -> None:
    data = bytes(range(256)) * 3
    messages = written(
        tmp_path / "run.mcap",
        RawBytes(NOW, False, data),  # noqa: FBT003 - the type of a field of a named tuple
        RawBytes(NOW + 1, True, b""),  # noqa: FBT003 - the type of a field of a named tuple
        RawBytes(NOW + 2, True, b"\0\xff"),  # noqa: FBT003 - the type of a field of a named tuple
    )
    assert [(t, m.log_time, d.data) for t, m, d in messages] == [
        ("/raw/uart/rx", NOW, data),
        ("/raw/uart/tx", NOW + 1, b""),
        ("/raw/uart/tx", NOW + 2, b"\0\xff"),
    ]


def test_can_frames_are_kept_bit_for_bit_bad_ones_included(tmp_path: Path) -> None:
    messages = written(
        tmp_path / "run.mcap",
        RawCan(NOW, False, 0x121, bytes(range(8))),  # noqa: FBT003 - a named tuple's field
        RawCan(NOW + 1, True, 0x000, b""),  # noqa: FBT003 - the type of a field of a named tuple
        RawCan(NOW + 2, False, 0xA000_0004, b"\0\xff"),  # noqa: FBT003 - a named tuple's field
    )
    assert [(t, m.log_time, d.outgoing, d.can_id, d.data) for t, m, d in messages] == [
        ("/raw/can", NOW, 0, 0x121, bytes(range(8))),
        ("/raw/can", NOW + 1, 1, 0, b""),
        ("/raw/can", NOW + 2, 0, 0xA000_0004, b"\0\xff"),
    ]


def test_a_pose_goes_to_three_topics(tmp_path: Path) -> None:
    pose = Pose2(1.25, -0.5, 2.0)
    covariance = (1.0, 2.0, 3.0, 2.0, 4.0, 5.0, 3.0, 5.0, 6.0)
    record = PoseRecord(NOW, pose, 0.2, -0.1, covariance, 0.01, 1.02)
    (t1, _, in_frame), (t2, _, estimate), (t3, _, transform) = written(
        tmp_path / "run.mcap", record
    )
    assert (t1, t2, t3) == ("/pose", "/pose/estimate", "/tf")
    in_frame = PoseInFrame.FromString(in_frame.SerializeToString())
    assert in_frame.frame_id == "map"
    assert in_frame.timestamp.ToNanoseconds() == NOW
    assert (in_frame.pose.position.x, in_frame.pose.position.y) == (1.25, -0.5)
    turn = in_frame.pose.orientation
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(2.0)
    transform = FrameTransform.FromString(transform.SerializeToString())
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "base_link")
    assert (transform.translation.x, transform.rotation.w) == (1.25, math.cos(1.0))
    assert (estimate.x_m, estimate.y_m, estimate.theta_rad) == tuple(pose)
    assert (estimate.covariance_xx, estimate.covariance_xy, estimate.covariance_x_theta) == (
        1,
        2,
        3,
    )
    assert (estimate.covariance_yy, estimate.covariance_y_theta) == (4, 5)
    assert (estimate.covariance_theta_theta, estimate.gyro_bias_rad_s) == (6, 0.01)
    assert (estimate.v_m_s, estimate.yaw_rate_rad_s, estimate.wheel_scale) == (0.2, -0.1, 1.02)


def test_truth_is_a_pose_in_the_map_frame(tmp_path: Path) -> None:
    ((topic, message, pose),) = written(
        tmp_path / "run.mcap", TruthRecord(NOW, Pose2(0.1, 0.2, -3.0))
    )
    assert (topic, message.log_time, pose.frame_id) == ("/truth/pose", NOW, "map")
    assert (pose.pose.position.x, pose.pose.orientation.z) == (0.1, math.sin(-1.5))


def test_planner_command_event_log_and_clock(tmp_path: Path) -> None:
    state = PlannerState("lane", 3, 1.5, 1.25, 0.48, 3, (0.5, 0.75))
    planner, idle, cmd, event, log, clock = (
        d
        for _, _, d in written(
            tmp_path / "run.mcap",
            PlannerRecord(NOW + 1, "paper", state),
            PlannerRecord(NOW + 2, "paper", PlannerState("idle", 0, 0.0, 0.0, 0.0, 0, None)),
            CommandRecord(NOW + 3, 0.2, 0.1, 0.25, 0.3),
            EventRecord(NOW + 4, Severity.WARNING, "safety", "stop", "étage", {"cause": "link"}),
            LogRecord(NOW + 5, Severity.ERROR, "device", "broken \ud800 text"),
            ClockRecord(NOW + 6, -5, -12.5, 100, 2000, 42, 0xFFFF_FFFF),
        )
    )
    assert (planner.state, planner.turn_count, planner.case) == ("lane", 3, 3)
    assert (planner.lane_distance_m, planner.previous_lane_distance_m) == (1.5, 1.25)
    assert (planner.length_m, planner.target_x_m, planner.target_y_m) == (0.48, 0.5, 0.75)
    assert not idle.HasField("target_x_m")
    assert (cmd.v_m_s, cmd.target_v_m_s, cmd.target_yaw_rate_rad_s) == (0.2, 0.25, 0.3)
    assert (event.severity, event.source, event.text) == ("warning", "safety", "étage")
    assert json.loads(event.data_json) == {"cause": "link"}
    log = Log.FromString(log.SerializeToString())
    assert (log.level, log.name, log.message) == (Log.ERROR, "device", "broken ? text")
    assert (clock.offset_ns, clock.drift_ppm, clock.boot_id) == (-5, -12.5, 0xFFFF_FFFF)


def test_device_messages_keep_their_times_and_sequence(tmp_path: Path) -> None:
    imu = Imu(1, -2, 16384, 0, 131, -131, 262)
    _, (topic, message, decoded), (ros_topic, ros_message, ros) = written(
        tmp_path / "run.mcap", device(NOMINAL.info()), device(imu, t_us=0xFFFF_FFFF, seq=255)
    )
    assert (topic, ros_topic) == ("/device/imu", "/ros/imu")
    assert (message.log_time, message.publish_time, message.sequence) == (NOW, NOW - 5000, 255)
    assert (decoded.t_us, decoded.accel_y, decoded.gyro_z) == (0xFFFF_FFFF, -2, 262)
    assert decoded.gyro_z_rad_s == pytest.approx(math.radians(2.0))
    assert ros_message.publish_time == NOW - 5000
    assert ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec == NOW - 5000
    assert ros.header.frame_id == "base_link"
    assert ros.angular_velocity.z == imu.gyro_z_rad_s
    assert ros.linear_acceleration.z == pytest.approx(9.80665)
    assert ros.orientation_covariance[0] == -1.0
    assert ros.linear_acceleration_covariance == [0.0] * 9


def test_publish_time_is_the_log_time_until_the_clock_is_mapped(tmp_path: Path) -> None:
    record = device(Power(16000, 200, 5, 6))._replace(publish_ns=None, bound_ns=None)
    (_, message, decoded), (_, _, ros) = written(tmp_path / "run.mcap", record)
    assert message.publish_time == NOW
    assert not decoded.HasField("bound_ns")
    assert ros.voltage == pytest.approx(16.0)
    assert math.isnan(ros.current)
    assert ros.design_capacity == pytest.approx(RobotModel().battery_ah)
    assert ros.present is True


def test_wheel_angles_unwrap_and_speeds_follow_the_device_clock(tmp_path: Path) -> None:
    messages = written(
        tmp_path / "run.mcap",
        device(Encoders(65_530, 5), t_us=0xFFFF_FFF0),
        device(Encoders(6, 65_531), t_us=0xFFFF_FFF0 + 20_000 - 2**32),
        device(Encoders(100, 100), t_us=20_000, node=2),
        device(Encoders(500, 500), t_us=40_000_000),
    )
    states = [d for t, _, d in messages if t == "/ros/joint_states"]
    rad = 2 * math.pi / RobotModel().counts_per_turn
    assert states[0].name == ["left_wheel", "right_wheel"]
    assert list(states[0].position) == [0.0, 0.0]
    assert all(math.isnan(v) for v in states[0].velocity)
    assert list(states[1].position) == pytest.approx([12 * rad, -10 * rad])
    assert list(states[1].velocity) == pytest.approx([12 * rad / 0.02, -10 * rad / 0.02])
    assert all(math.isnan(v) for v in states[2].velocity), "the wheels of another robot"
    assert all(math.isnan(v) for v in states[3].velocity), "a gap too long to unwrap"


def test_ranges_without_an_echo_are_infinite(tmp_path: Path) -> None:
    messages = written(tmp_path / "run.mcap", device(Range(1234, 255, 80, 5, 30)))
    topics = {t: d for t, _, d in messages}
    raw = topics["/device/range"]
    assert (raw.ultrasonic, raw.infrared_left, raw.contacts) == (1234, 255, 5)
    assert not raw.HasField("infrared_left_m")
    assert topics["/ros/range/front"].range == pytest.approx(1.234)
    assert topics["/ros/range/front"].radiation_type == 0
    assert topics["/ros/range/left"].range == math.inf
    assert topics["/ros/range/right"].range == pytest.approx(0.1)
    assert topics["/ros/range/right"].max_range == pytest.approx(0.30)
    assert topics["/ros/range/right"].header.frame_id == "range_right"


@pytest.mark.parametrize(("age", "older_ns"), [(0, 0), (30, 30_000_000), (255, 0)])
@pytest.mark.parametrize("mapped", [True, False])
def test_an_ultrasonic_range_has_the_time_of_its_pulse(
    tmp_path: Path, age: int, older_ns: int, *, mapped: bool
) -> None:
    record = device(Range(1234, 60, 80, 5, age))
    if not mapped:
        record = record._replace(publish_ns=None, bound_ns=None)
    messages = written(tmp_path / "run.mcap", record)
    found = {topic: (message.publish_time, decoded) for topic, message, decoded in messages}
    sampled_ns = NOW - 5000 if mapped else NOW
    assert found["/device/range"][0] == found["/ros/range/left"][0] == sampled_ns
    pulse_ns, front = found["/ros/range/front"]
    assert pulse_ns == sampled_ns - older_ns
    assert front.header.stamp.sec * 10**9 + front.header.stamp.nanosec == pulse_ns


def test_sensor_mounts_hang_below_the_body(tmp_path: Path) -> None:
    RunWriter(tmp_path / "run.mcap", run_info()).close()
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufFactory()])
        mounts = [d.decoded_message for d in reader.iter_decoded_messages()]
    assert {m.child_frame_id: (m.translation.x, m.translation.y) for m in mounts} == {
        "range_front": (0.12, 0.0),
        "range_left": (0.05, 0.10),
        "range_right": (0.05, -0.10),
    }
    assert {m.parent_frame_id for m in mounts} == {"base_link"}


def test_maps_are_occupancy_grids(tmp_path: Path) -> None:
    cells = np.array([[0, 100, -1], [50, 0, 0]], dtype=np.int8)
    (_, _, swept), (_, _, room) = written(
        tmp_path / "run.mcap",
        CoverageRecord(NOW, cells, -1.5, 2.5, 0.05),
        RoomRecord(NOW, PLAN),
    )
    parsed = parse_occupancy_grid(NOW, occupancy_grid(CoverageRecord(NOW, cells, -1.5, 2.5, 0.05)))
    assert np.array_equal(parsed.cells, cells)
    assert (parsed.origin_x_m, parsed.origin_y_m) == (-1.5, 2.5)
    assert parsed.resolution_m == pytest.approx(0.05)
    assert (swept.info.width, swept.info.height) == (3, 2)
    assert swept.info.resolution == pytest.approx(0.05)
    assert (swept.info.origin.position.x, swept.info.origin.position.y) == (-1.5, 2.5)
    assert swept.info.origin.orientation.w == 1.0
    assert list(swept.data) == cells.ravel().tolist()
    grid = np.array(room.data).reshape(room.info.height, room.info.width)
    area = room.info.resolution**2
    assert (grid == 0).sum() * area == pytest.approx(2.06 * 2.057 - 0.4, abs=0.03)

    def at(x_m: float, y_m: float) -> int:
        column = int((x_m - room.info.origin.position.x) / room.info.resolution)
        row = int((y_m - room.info.origin.position.y) / room.info.resolution)
        return int(grid[row, column])

    assert (at(0.2, 0.2), at(1.3, 1.25), at(0.01 - 0.02, 1.0)) == (0, 100, 100)
    assert set(grid[0]) == {-1}


@pytest.mark.parametrize("frame_id", ["", "map", "odom", "a/longer/frame"])
def test_a_grid_of_another_program_is_read_too(frame_id: str) -> None:
    encode = serialize_dynamic(OCCUPANCY_GRID, schema_text(OCCUPANCY_GRID))[OCCUPANCY_GRID]
    origin = {"position": {"x": 1.0, "y": 2.0}, "orientation": {"w": 1.0}}
    info = {"resolution": 0.5, "width": 3, "height": 2, "origin": origin}
    data = encode({"header": {"frame_id": frame_id}, "info": info, "data": [0, 1, 2, -1, 4, 100]})
    grid = parse_occupancy_grid(NOW, bytes(data))
    assert grid.cells.tolist() == [[0, 1, 2], [-1, 4, 100]]
    assert grid[2:] == (1.0, 2.0, 0.5)
    for cut in range(len(data)):
        with pytest.raises(ValueError, match=r"\w"):
            parse_occupancy_grid(NOW, bytes(data[:cut]))
