"""The log as a file: name, chunks, index and order of the records."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as RosFactory

from bridge.errors import OutputExistsError
from bridge.motion.geometry import Pose2
from bridge.record.chunk import CHUNK_BYTES
from bridge.record.chunked_file import ChunkedFile
from bridge.record.errors import LogWriteError
from bridge.record.log_writer import RunWriter
from bridge.session.records import (
    CommandRecord,
    DeviceMessage,
    PoseRecord,
    RawBytes,
    Record,
    TruthRecord,
)
from protocol.messages.device import Encoders
from support.synthetic_run import EPOCH_NS, run_info, summary, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path

from support.read_log import read_all

NOW = EPOCH_NS + 123_456_789


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    with pytest.raises(OutputExistsError, match=r"run\.mcap exists"):
        RunWriter(path, run_info())
    assert path.read_text() == "precious"
    RunWriter(path, run_info(), force=True).close()
    assert read_all(path) == []


@pytest.mark.parametrize(
    ("name", "reason"),
    [("no/such/folder/run.mcap", "there is no folder"), (".", "Is a directory")],
)
def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(LogWriteError) as caught:
        RunWriter(tmp_path / name, run_info(), force=True)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.reason.startswith(reason)


def test_a_chunk_closes_by_log_time_and_by_size(tmp_path: Path) -> None:
    file = ChunkedFile(tmp_path / "x.mcap")
    channel = file.add_channel("/a", "", ("", "", b""))
    for i in range(100):  # 10 ms apart: a chunk closes every 0.25 s
        file.add_message(channel, NOW + i * 10_000_000, NOW, i, b"x")
    for i in range(10):  # at one time: a chunk closes by its size
        file.add_message(channel, NOW + 10**9, NOW, i, bytes(CHUNK_BYTES // 4))
    file.add_message(channel, NOW, NOW, 0, b"the clock was set back")
    file.finish()
    with (tmp_path / "x.mcap").open("rb") as stream:
        stats = make_reader(stream).get_summary()
    assert stats is not None
    spans = [
        (c.message_end_time - c.message_start_time, c.uncompressed_size)
        for c in stats.chunk_indexes
    ]
    assert [span for span, _ in spans[:4]] == [240_000_000] * 4
    assert all(size < CHUNK_BYTES + CHUNK_BYTES // 4 + 1000 for _, size in spans)
    assert len(spans) == 4 + 3 + 1
    assert stats.statistics is not None
    assert stats.statistics.message_count == 111


def test_a_whole_run_is_indexed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    records = list(synthetic_run())
    writer = RunWriter(path, run_info())
    for record in records:
        writer.write(record)
    writer.close(summary())
    middle = (records[0].log_ns + records[-1].log_ns) // 2
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [
            m.log_time
            for _, _, m in reader.iter_messages(
                topics=["/truth/pose"], starting_at=middle, ending_before=middle + 10**9
            )
        ]
    expected = [
        r.log_ns
        for r in records
        if isinstance(r, TruthRecord) and middle <= r.log_ns < middle + 10**9
    ]
    assert found == expected


def test_rows_and_messages_keep_their_order_over_many_chunks(
    tmp_path: Path,
) -> None:
    records: list[Record] = []
    for i in range(60):  # 1.2 s, so five chunks; each of them begins with another kind
        at = NOW + 20_000_000 * i
        covariance = (0.0,) * 9
        some: list[Record] = [
            RawBytes(at, False, bytes([i])),  # noqa: FBT003 - False: received
            DeviceMessage(at, at - 5000, 2000, 1, i % 256, i, "encoders", Encoders(i, i)),
            PoseRecord(at, Pose2(float(i), 0.0, 0.0), 0.0, 0.0, covariance, 0.0, 1.0),
            TruthRecord(at, Pose2(float(i), 1.0, 0.0)),
            CommandRecord(at, float(i), 0.0, 0.0, 0.0),
        ]
        records += some[i % 5 :] + some[: i % 5]
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, run_info())
    for record in records:
        writer.write(record)
    writer.close()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufFactory(), RosFactory()])
        summary = reader.get_summary()
        found = [
            (d.channel.topic, d.decoded_message)
            for d in reader.iter_decoded_messages(log_time_order=False)
        ]
    assert summary is not None
    assert len(summary.chunk_indexes) >= 5
    firsts = {
        RawBytes: "/raw/uart/rx",
        DeviceMessage: "/device/encoders",
        PoseRecord: "/pose",
        TruthRecord: "/truth/pose",
        CommandRecord: "/cmd",
    }
    assert [topic for topic, _ in found if topic in firsts.values()] == [
        firsts[type(record)] for record in records
    ]
    truths = [value.pose.position.x for topic, value in found if topic == "/truth/pose"]
    commands = [value.v_m_s for topic, value in found if topic == "/cmd"]
    assert truths == commands == [float(i) for i in range(60)]
