"""Exported tables, compared message by message with the values that the libraries decode."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bridge.convert.export import NoSuchTopicError, export
from bridge.errors import OutputExistsError
from bridge.record.reader import LogReader
from support.cli import sweepctl
from support.exported import table
from support.synthetic_run import first_records, write_synthetic_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return five seconds of an artificial run."""
    path = tmp_path_factory.mktemp("export") / "run.mcap"
    return write_synthetic_log(path, first_records(5.0))


def value(message: Any, dotted: str) -> Any:  # noqa: ANN401 - decoded
    """Return a field by its dotted name, or None if the message does not have it."""
    for name in dotted.split("."):
        descriptor = getattr(message, "DESCRIPTOR", None)
        if descriptor is not None:
            field = descriptor.fields_by_name[name]
            if field.has_presence and not message.HasField(name):
                return None
        message = getattr(message, name)
    return message


def same(a: Any, b: Any) -> bool:  # noqa: ANN401 - decoded
    """Return whether both values are equal; here NaN equals NaN."""
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a):
        return math.isnan(b)
    return bool(a == b)


@pytest.mark.parametrize("block_bytes", [1 << 24, 40_000])
def test_every_message_of_a_run_field_by_field(log: Path, tmp_path: Path, block_bytes: int) -> None:
    result = export(log, tmp_path, block_bytes=block_bytes)
    assert result.problems == []
    tables = {topic: table(path) for topic, path in result.files.items()}
    at = dict.fromkeys(tables, 0)
    for message in LogReader(log).messages():
        topic = message.topic
        row = tables[topic][at[topic]]
        at[topic] += 1
        assert row.pop("sequence") == message.sequence
        assert row.pop("log_time") == message.log_ns
        assert row.pop("publish_time") == message.publish_ns
        decoded = message.decoded
        for name, found in row.items():
            expected = value(decoded, name)
            if isinstance(expected, (list, tuple, bytes)) and isinstance(found, list):
                expected = list(expected)
            assert same(found, expected), f"{topic} {name}: {found!r}, not {expected!r}"
    assert at == {topic: len(rows) for topic, rows in tables.items()} == result.rows
    assert result.messages > 3_000


def test_columns_have_the_types_of_their_fields(log: Path, tmp_path: Path) -> None:
    result = export(log, tmp_path, topics=["/device/imu", "/raw/*", "/ros/joint_states"])
    assert sorted(result.files) == [
        "/device/imu",
        "/raw/uart/rx",
        "/raw/uart/tx",
        "/ros/joint_states",
    ]
    assert result.files["/raw/uart/rx"].name == "raw.uart.rx.parquet"
    imu = pq.read_schema(result.files["/device/imu"])
    assert imu.field("log_time").type == pa.timestamp("ns", "UTC")
    assert imu.field("gyro_z").type == pa.int32()
    assert imu.field("gyro_z_rad_s").type == pa.float64()
    assert imu.metadata[b"sweepctl.topic"] == b"/device/imu"
    assert imu.metadata[b"sweepctl.schema"] == b"sweepctl.Imu"
    assert pq.read_schema(result.files["/raw/uart/rx"]).field("data").type == pa.binary()
    joints = pq.read_schema(result.files["/ros/joint_states"])
    assert joints.field("position").type == pa.list_(pa.float64())


def test_csv_has_the_same_values(log: Path, tmp_path: Path) -> None:
    topics = ["/device/range", "/ros/joint_states", "/raw/uart/tx", "/events"]
    parquet = export(log, tmp_path / "p", topics=topics)
    result = export(log, tmp_path / "c", topics=topics, file_format="csv")
    for topic, path in result.files.items():
        assert path.suffix == ".csv"
        expected = table(parquet.files[topic])
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(expected)
        for row, want in zip(rows, expected, strict=True):
            assert row.pop("log_time").endswith("Z")
            row.pop("publish_time")
            for name, text in row.items():
                cell = want[name]
                match cell:
                    case None:
                        assert text == ""
                    case bytes():
                        assert bytes.fromhex(text) == cell
                    case list():
                        nulls = [None if isinstance(v, float) and v != v else v for v in cell]  # noqa: PLR0124 - NaN
                        assert json.loads(text) == nulls
                    case float():
                        assert float(text) == cell
                    case _:
                        assert text == str(cell)


def test_a_damaged_log(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    data[len(data) // 3] ^= 0xFF
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data[: len(data) * 9 // 10])
    result = export(broken, tmp_path / "out", topics=["/pose"])
    stepped, cut = result.problems
    assert "skipped" in stepped
    assert cut.endswith("the rest is truncated or damaged")
    reader = LogReader(broken)
    assert result.messages == sum(1 for _ in reader.messages({"/pose"})) > 100


def test_what_cannot_be(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(log, out, topics=["/cmd"])
    with pytest.raises(OutputExistsError):
        export(log, out, topics=["/cmd"])
    export(log, out, topics=["/cmd"], force=True)
    with pytest.raises(
        NoSuchTopicError, match=r"no topic matches '/none'; the log has: /clock/sync"
    ):
        export(log, out, topics=["/none"])
    done = sweepctl("export", log, "--out", "/proc/none", "--topic", "/cmd")
    assert done.status == 1
    assert "cannot write /proc/none" in done.line
    fresh = tmp_path / "fresh"
    asked = ("--out", fresh, "--topic", "/cmd", "--topic", "/none")
    cut = tmp_path / "cut.mcap"  # its summary is missing
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    for file in (log, cut):
        done = sweepctl("export", file, *asked)
        assert done.status == 2
        assert "no topic matches '/none'; the log has: " in done.line
        assert not fresh.exists(), "nothing is written, not even what there is"
    assert sweepctl("export", cut, "--out", fresh, "--topic", "/cmd").status == 0


def test_the_command(log: Path, tmp_path: Path) -> None:
    done = sweepctl(
        "export", log, "--out", tmp_path, "--topic", "/pose*", "--format", "csv", "--json"
    )
    assert done.status == 0
    assert sorted(done.json["files"]) == ["/pose", "/pose/estimate"]
    file = done.json["files"]["/pose"]
    with Path(file["file"]).open() as text:
        assert sum(1 for _ in text) == file["rows"] + 1


@pytest.mark.parametrize("name", ["parquet", "csv"])
def test_a_full_disk_is_reported_with_the_written_part(
    log: Path, tmp_path: Path, name: str
) -> None:
    out = tmp_path / "tables"
    out.mkdir()
    (out / f"pose.{name}").symlink_to("/dev/full")
    form = ["--format", name]
    done = sweepctl("export", log, "--out", out, "--topic", "/pose", "--force", "--json", *form)
    assert done.status == 1
    assert done.json["reason"].startswith(f"cannot write {out}")
