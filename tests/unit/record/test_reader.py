"""Reading of complete, truncated, damaged and foreign logs."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from bridge.record.errors import LogReadError
from bridge.record.info import describe
from bridge.record.reader import LogReader
from bridge.session.records import RawBytes, TruthRecord
from support.synthetic_run import EPOCH_NS, summary, synthetic_run, write_synthetic_log

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a complete log."""
    return write_synthetic_log(tmp_path_factory.mktemp("log") / "run.mcap")


def record_starts(data: bytes) -> list[tuple[int, int]]:
    """Return offset and opcode of every record of a file."""
    starts, position = [], 8
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        starts.append((position, opcode))
        position += 9 + length
    return starts


def test_a_whole_log_reads_back(log: Path) -> None:
    reader = LogReader(log)
    assert not reader.truncated
    assert reader.summary == summary()
    assert reader.run["planner"] == "u-shape"
    assert set(reader.attachments) == {
        "robot.toml", "room.json", "catalogue.json", "summary.json",
    }  # fmt: skip
    records = list(synthetic_run())
    raw = [m.decoded.data for m in reader.messages({"/raw/uart/rx", "/raw/uart/tx"})]
    assert raw == [r.data for r in records if isinstance(r, RawBytes)]
    truth = list(reader.messages(["/truth/pose"]))
    expected = [r for r in records if isinstance(r, TruthRecord)]
    assert [m.log_ns for m in truth] == [r.log_ns for r in expected]
    assert [m.decoded.pose.position.x for m in truth] == [r.pose.x_m for r in expected]
    imu = next(m for m in reader.messages(["/ros/imu"]))
    assert imu.decoded.linear_acceleration.z == pytest.approx(9.80665)
    assert reader.problems == []


def test_a_log_cut_anywhere_reads_up_to_the_cut(log: Path, tmp_path: Path) -> None:
    data = log.read_bytes()
    whole = [(m.topic, m.log_ns, m.data) for m in LogReader(log).messages()]
    last = 0
    for cut in range(8, len(data), len(data) // 37):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        reader = LogReader(path)
        got = [(m.topic, m.log_ns, m.data) for m in reader.messages()]
        assert got == whole[: len(got)]
        assert reader.truncated
        assert not reader.problems
        assert len(got) >= last
        last = len(got)
    assert last > 0.9 * len(whole)


def test_a_damaged_chunk_is_stepped_over_and_named(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    chunks = [at for at, opcode in record_starts(bytes(data)) if opcode == Opcode.CHUNK]
    data[chunks[len(chunks) // 2] + 200] ^= 0x55
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    reader = LogReader(path)
    got, whole = list(reader.messages()), list(LogReader(log).messages())
    assert len(reader.problems) == 1
    assert 0 < len(whole) - len(got) < 300
    assert got[-1].log_ns == whole[-1].log_ns
    assert not reader.truncated


def test_an_invalid_log_is_rejected_in_one_line(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    for content, reason in ((b"", "not an MCAP"), (b"\x00" * 100, "not an MCAP")):
        other.write_bytes(content)
        with pytest.raises(LogReadError, match=reason) as caught:
            LogReader(other)
        assert "\n" not in str(caught.value)
    with pytest.raises(LogReadError, match="No such file"):
        LogReader(tmp_path / "missing.mcap")
    with pytest.raises(LogReadError, match="directory"):
        LogReader(tmp_path)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
@pytest.mark.parametrize("chunked", [True, False])
def test_logs_of_other_programs_read_too(
    tmp_path: Path,
    compression: CompressionType,
    chunked: bool,  # noqa: FBT001 - parametrised
) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunked)
        writer.start()
        channel = writer.register_channel("/json", "json", 0)
        for i in range(10):
            writer.add_message(channel, i * 10**8, b'{"a": 1}', i, i)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    reader = LogReader(path)
    messages = list(reader.messages())
    assert [(m.topic, m.sequence, m.data) for m in messages] == [
        ("/json", i, b'{"a": 1}') for i in range(10)
    ]
    assert not reader.truncated
    with pytest.raises(ValueError, match="no decoder"):
        _ = messages[0].decoded
    description = describe(path)
    assert description.whole
    assert description.metadata == {}
    assert description.topics[0].rate_hz == pytest.approx(10.0)


def test_a_few_messages_at_one_moment_have_no_rate(tmp_path: Path) -> None:
    path = tmp_path / "few.mcap"
    moments_ms = {"/two": (0, 9000), "/burst": (1, 2, 3, 4), "/slow": (0, 5000, 10_000)}
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, moments in moments_ms.items():
            channel = writer.register_channel(topic, "json", 0)
            for ms in moments:
                writer.add_message(channel, ms * 10**6, b"{}", ms * 10**6)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    rates = {t.topic: t.rate_hz for t in describe(path).topics}
    assert rates == {"/two": None, "/burst": None, "/slow": pytest.approx(0.2)}


def test_describe_counts_the_runs_messages(log: Path, tmp_path: Path) -> None:
    records = list(synthetic_run())
    description = describe(log)
    assert description.whole
    assert description.outcome == "complete"
    topics = {t.topic: t for t in description.topics}
    assert topics["/truth/pose"].count == sum(isinstance(r, TruthRecord) for r in records)
    assert topics["/device/imu"].rate_hz == pytest.approx(50.0)
    assert description.start_ns == EPOCH_NS
    assert description.duration_s == pytest.approx((records[-1].log_ns - EPOCH_NS) / 1e9)
    assert description.wire["received_bytes"] == sum(
        len(r.data) for r in records if isinstance(r, RawBytes) and not r.outgoing
    )
    assert description.wire["lost"] is None
    assert description.as_json()["messages"] == sum(t.count for t in description.topics)

    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:200_000])
    description = describe(cut)
    assert not description.whole
    assert description.outcome is None
    assert description.message_count > 100
