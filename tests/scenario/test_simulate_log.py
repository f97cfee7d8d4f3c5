"""The log of a simulated run, read with the MCAP library and an independent codec."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import pytest
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader

from support.cli import Plain, Recorded, attachments, decoded, plain_messages, short_runs
from support.reference_codec import (
    LAYOUTS,
    RefDamage,
    RefFrame,
    decode_payload,
    parse_stream,
    si_values,
)

pytestmark = pytest.mark.slow

EPOCH_NS = 1_767_225_600_000_000_000
"""Start of virtual time, Unix ns: 2026-01-01, when the device boots."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recorded, Recorded, Recorded]:
    return short_runs(tmp_path_factory)


@pytest.fixture(scope="module")
def recorded(runs: tuple[Recorded, Recorded, Recorded]) -> Recorded:
    return runs[0]


# ---- equal seeds -----------------------------------------------------------------------


def test_equal_seeds_give_equal_runs(runs: tuple[Recorded, Recorded, Recorded]) -> None:
    first, again, _ = (plain_messages(run.log) for run in runs)
    assert len(first) > 5000
    assert first == again
    reported = [{**run.done.json, "log": None} for run in runs]
    assert reported[0] == reported[1]


def test_another_seed_gives_another_run(runs: tuple[Recorded, Recorded, Recorded]) -> None:
    def content(run: Recorded, topic: str) -> list[bytes]:
        return [message.data for message in plain_messages(run.log, topic)]

    first, _, other = runs
    for topic in ("/device/imu", "/device/range", "/truth/pose", "/raw/uart/rx"):
        assert content(first, topic) != content(other, topic)
    assert first.done.json["path_m"] != other.done.json["path_m"]
    for run in runs:
        assert run.done.status == 1
        assert run.done.json["outcome"] == "timeout"


# ---- every byte through the codec ------------------------------------------------------


def wire(run: Recorded, direction: str) -> list[RefFrame]:
    data = b"".join(value.data for _, value in decoded(run.log, f"/raw/uart/{direction}"))
    frames = parse_stream(data)
    assert not any(isinstance(frame, RefDamage) for frame in frames)
    return [frame for frame in frames if isinstance(frame, RefFrame)]


def test_device_messages_match_their_bytes(recorded: Recorded) -> None:
    """The log has no hello and no answers, because the session does not pass them on."""
    topics = {f"/device/{name}" for name, _, _ in LAYOUTS.values()}
    in_log = list(decoded(recorded.log, *topics))
    logged = {plain.topic for plain, _ in in_log}
    on_wire = [
        frame for frame in wire(recorded, "rx") if f"/device/{LAYOUTS[frame.type_id][0]}" in logged
    ]
    assert {LAYOUTS[frame.type_id][0] for frame in wire(recorded, "rx")} - {
        topic.removeprefix("/device/") for topic in logged
    } <= {"hello", "describe_reply"}
    assert len(in_log) == len(on_wire) > 2000
    for (plain, value), frame in zip(in_log, on_wire, strict=True):
        assert plain.topic == f"/device/{LAYOUTS[frame.type_id][0]}"
        assert (plain.sequence, value.t_us, value.node) == (frame.seq, frame.t_us, frame.node)
        raw = decode_payload(frame.type_id, frame.payload)
        for name, expected in raw.items():
            assert getattr(value, name) == expected
        for name, si in si_values(frame.type_id, raw).items():
            if si is None:
                assert not value.HasField(name)
            else:
                assert getattr(value, name) == pytest.approx(si, rel=1e-12, abs=1e-12)


def test_sequence_numbers_miss_nothing(recorded: Recorded) -> None:
    for direction in ("rx", "tx"):
        frames = wire(recorded, direction)
        assert all((b.seq - a.seq) % 256 == 1 for a, b in pairwise(frames))
        assert recorded.done.json["wire"]["frames"][direction] == len(frames)


def test_commands_match_their_bytes(recorded: Recorded) -> None:
    """A velocity in /cmd equals the setpoint on the wire, to the wire's resolution."""
    commands = [value for _, value in decoded(recorded.log, "/cmd")]
    sent = [f for f in wire(recorded, "tx") if LAYOUTS[f.type_id][0] == "velocity_setpoint"]
    assert len(sent) == len(commands) > 500
    for command, frame in zip(commands, sent, strict=True):
        raw = decode_payload(frame.type_id, frame.payload)
        si = si_values(frame.type_id, raw)
        assert si["v_m_s"] == pytest.approx(command.v_m_s, abs=0.00011)
        assert si["yaw_rate_rad_s"] == pytest.approx(command.yaw_rate_rad_s, abs=0.00021)
        assert raw["time_to_live"] == 200
        assert abs(command.v_m_s) <= 0.3
    counters = [decode_payload(frame.type_id, frame.payload)["counter"] for frame in sent]
    assert all((b - a) % 256 == 1 for a, b in pairwise(counters) if isinstance(a, int))  # type: ignore[operator]  # both are


# ---- time ------------------------------------------------------------------------------


def test_publish_time_is_the_devices_moment_within_its_bound(recorded: Recorded) -> None:
    """The device boots at the epoch of virtual time, so its own stamp gives the true Unix time."""
    bounded = 0
    for name, _, _ in LAYOUTS.values():
        for plain, value in decoded(recorded.log, f"/device/{name}"):
            true_ns = EPOCH_NS + value.t_us * 1000
            assert plain.log_ns > true_ns, "nothing is heard before it was so"
            if value.HasField("bound_ns"):
                bounded += 1
                assert abs(plain.publish_ns - true_ns) <= value.bound_ns
                assert plain.publish_ns <= plain.log_ns + value.bound_ns
            else:
                assert plain.publish_ns == plain.log_ns, "unknown: the moment of receipt"
    assert bounded > 2000


def test_the_wires_delay_is_there(recorded: Recorded) -> None:
    delays_ms = [
        (plain.log_ns - EPOCH_NS) / 1e6 - value.t_us / 1e3
        for plain, value in decoded(recorded.log, "/device/imu")
    ]
    assert min(delays_ms) >= 1.0
    assert max(delays_ms) < 20.0


def test_rates(recorded: Recorded) -> None:
    for topic, rate_hz in (
        ("/device/encoders", 50),
        ("/device/imu", 100),
        ("/device/range", 20),
        ("/device/power", 5),
        ("/device/status", 10),
        ("/device/sync", 10),
        ("/truth/pose", 25),
        ("/pose", 50),
        ("/tf", 50),
    ):
        times = [message.log_ns for message in plain_messages(recorded.log, topic)]
        assert (len(times) - 1) * 1e9 / (times[-1] - times[0]) == pytest.approx(rate_hz, rel=0.03)


# ---- reports ----------------------------------------------------------------------------


def test_decisions_have_reasons(recorded: Recorded) -> None:
    decisions = [v for _, v in decoded(recorded.log, "/events") if v.source == "planner"]
    kinds = [decision.kind for decision in decisions]
    assert kinds[0] == "start"
    assert "lane" in kinds
    for decision in decisions:
        assert len(decision.text) > 10
        assert isinstance(json.loads(decision.data_json), dict)
    lane = next(decision for decision in decisions if decision.kind == "lane")
    assert json.loads(lane.data_json)["distance_m"] > 0.5
    states = [value for _, value in decoded(recorded.log, "/planner")]
    assert {state.planner for state in states} == {"paper"}
    assert {"lane", "step"} <= {state.state for state in states}


def test_a_run_is_reported_from_its_first_step_to_its_stop(recorded: Recorded) -> None:
    events = [(v.source, v.kind, v.text) for _, v in decoded(recorded.log, "/events")]
    phases = [text.removeprefix("run is ") for _, kind, text in events if kind == "phase"]
    assert phases[-2:] == ["driving", "ending"] or phases[-3:] == ["driving", "ending", "done"]
    assert ("safety", "stop", "not finished after 12 s") in events


def test_frames(recorded: Recorded) -> None:
    for topic in ("/truth/pose", "/pose"):
        for plain, value in decoded(recorded.log, topic):
            assert value.frame_id == "map"
            assert value.timestamp.ToNanoseconds() == plain.log_ns
            turn = value.pose.orientation
            assert math.hypot(turn.z, turn.w) == pytest.approx(1.0)
            assert turn.x == turn.y == value.pose.position.z == 0.0


def test_covariances_are_ones(recorded: Recorded) -> None:
    estimates = list(decoded(recorded.log, "/pose/estimate"))
    assert len(estimates) > 500
    for _, value in estimates:
        xx, yy, tt = value.covariance_xx, value.covariance_yy, value.covariance_theta_theta
        assert min(xx, yy, tt) >= 0.0
        assert value.covariance_xy**2 <= xx * yy * (1 + 1e-9) + 1e-15


# ---- the file --------------------------------------------------------------------------


def records(run: Recorded) -> list[McapRecord]:
    with run.log.open("rb") as file:
        return list(StreamReader(file, emit_chunks=True).records)


def test_first_in_the_file_is_its_own_description(recorded: Recorded) -> None:
    kinds: list[type[Any]] = [type(record) for record in records(recorded)]
    assert kinds[:5] == [Header, Attachment, Attachment, Attachment, Metadata]
    found = records(recorded)
    names = [record.name for record in found if isinstance(record, Attachment)]
    assert names == ["robot.toml", "room.json", "catalogue.json", "summary.json"]
    reported = next(record.metadata for record in found if isinstance(record, Metadata))
    assert reported["seed"] == "4"
    assert reported["planner"] == "paper"
    assert reported["port"] == "virtual"
    assert reported["noise"] == "typical"
    assert {"version", "python", "protocol_version", "catalogue_hash"} <= set(reported)


def test_last_in_the_file_is_the_summary(recorded: Recorded) -> None:
    found = records(recorded)
    last = max(i for i, record in enumerate(found) if isinstance(record, Chunk))
    end = next(i for i, record in enumerate(found) if isinstance(record, DataEnd))
    between = [r for r in found[last + 1 : end] if not isinstance(r, MessageIndex)]
    assert [r.name for r in between if isinstance(r, Attachment)] == ["summary.json"]
    assert len(between) == 1
    assert json.loads(attachments(recorded.log)["summary.json"]) == recorded.done.json


def test_chunks_are_short(recorded: Recorded) -> None:
    """A kill loses messages outside complete chunks: a quarter of a second, or 256 KiB.

    The message that comes after that time closes a chunk, and there is one every 10 ms.
    """
    chunks = [record for record in records(recorded) if isinstance(record, Chunk)]
    assert len(chunks) > 40
    for chunk in chunks:
        assert chunk.compression == "zstd"
        assert chunk.message_end_time - chunk.message_start_time <= 260_000_000
        assert chunk.uncompressed_size <= 256 * 1024 + 64 * 1024
    times = [chunk.message_start_time for chunk in chunks]
    assert times == sorted(times)


def test_no_message_stands_outside_a_chunk(recorded: Recorded) -> None:
    kinds = {type(record).__name__ for record in records(recorded)}
    assert "Message" not in kinds
    assert kinds >= {"Statistics", "ChunkIndex", "AttachmentIndex", "MetadataIndex"}


def test_channels_are_drawn_by_others(recorded: Recorded) -> None:
    found = records(recorded)
    schemas = {r.id: r for r in found if isinstance(r, Schema)}
    channels = {r.topic: schemas[r.schema_id] for r in found if isinstance(r, Channel)}
    assert {schema.encoding for schema in channels.values()} == {"protobuf", "ros2msg"}
    for topic, name in (
        ("/pose", "foxglove.PoseInFrame"),
        ("/truth/pose", "foxglove.PoseInFrame"),
        ("/tf", "foxglove.FrameTransform"),
        ("/log", "foxglove.Log"),
        ("/map/coverage", "nav_msgs/msg/OccupancyGrid"),
        ("/map/room", "nav_msgs/msg/OccupancyGrid"),
    ):
        assert channels[topic].name == name
    for topic in ("/cmd", "/planner", "/events", "/clock/sync", "/pose/estimate", "/raw/uart/rx"):
        assert channels[topic].encoding == "protobuf"


def test_log_time_never_runs_backwards_in_a_topic(recorded: Recorded) -> None:
    last: dict[str, Plain] = {}
    for message in plain_messages(recorded.log):
        before = last.get(message.topic)
        assert before is None or message.log_ns >= before.log_ns
        last[message.topic] = message
    assert len(last) > 10
