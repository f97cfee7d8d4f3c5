"""Exported tables against what the libraries decode, message by message."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as RosWriter

from bridge.record.errors import LogExistsError
from bridge.record.export import NoSuchTopicError, export
from bridge.record.reader import LogReader
from bridge.record.writer import RunWriter
from support.cli import sweepctl
from support.synthetic_run import EPOCH_NS, run_info, summary, synthetic_run

if TYPE_CHECKING:
    from google.protobuf.message import Message


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five seconds of a made-up run."""
    path = tmp_path_factory.mktemp("export") / "run.mcap"
    writer = RunWriter(path, run_info())
    for record in synthetic_run():
        if record.log_ns > EPOCH_NS + 5_000_000_000:
            break
        writer.write(record)
    writer.close(summary())
    return path


def table(path: Path) -> list[dict[str, Any]]:
    """A table's rows."""
    read = pq.read_table(path)
    for name in ("log_time", "publish_time"):
        assert read.schema.field(name).type == pa.timestamp("ns", "UTC")
        index = read.schema.get_field_index(name)
        read = read.set_column(index, name, read[name].cast(pa.int64()))
    rows: list[dict[str, Any]] = read.to_pylist()
    return rows


def value(message: Any, dotted: str) -> Any:  # noqa: ANN401 - decoded
    """A field by its dotted name, None where it is absent."""
    for name in dotted.split("."):
        descriptor = getattr(message, "DESCRIPTOR", None)
        if descriptor is not None:
            field = descriptor.fields_by_name[name]
            if field.has_presence and not message.HasField(name):
                return None
        message = getattr(message, name)
    return message


def same(a: Any, b: Any) -> bool:  # noqa: ANN401 - decoded
    """Equal, NaN to itself included."""
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


def test_csv_says_the_same(log: Path, tmp_path: Path) -> None:
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


def protobuf_log(path: Path, *messages: Message) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for i, message in enumerate(messages):
            name = message.DESCRIPTOR.full_name
            if name not in channels:
                found: Any = build_file_descriptor_set(type(message))
                schema = writer.register_schema(name, "protobuf", found.SerializeToString())
                channels[name] = writer.register_channel(f"/{name}", "protobuf", schema)
            writer.add_message(channels[name], i, message.SerializeToString(), i, i)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated


def test_protobuf_of_other_programs(tmp_path: Path) -> None:
    """Defaults that are left out, enumerations, texts of any length, lists of messages."""
    levels: list[Any] = [0, 1, 5, 3] * 30
    logs = [
        Log(level=level, message="x" * i + "é", name="", line=i) for i, level in enumerate(levels)
    ]
    clouds = []
    for i in range(5):
        cloud = PointCloud(frame_id=f"frame{i}", point_stride=12, data=bytes(range(i * 12)))
        cloud.fields.add(name="x", offset=0, type="FLOAT32")
        clouds.append(cloud)
    scenes = [SceneUpdate() for _ in range(3)]
    scenes[1].entities.add(id="a").metadata.add(key="k", value="v")
    path = tmp_path / "log.mcap"
    protobuf_log(path, *logs, *clouds, *scenes)
    result = export(path, tmp_path / "out")
    assert result.problems == []
    rows = table(result.files["/foxglove.Log"])
    assert [row["level"] for row in rows] == [0, 1, 5, 3] * 30
    assert [row["message"] for row in rows] == ["x" * i + "é" for i in range(120)]
    assert [row["line"] for row in rows] == list(range(120))
    assert {row["timestamp.seconds"] for row in rows} == {None}, "no stamp at all"
    points = table(result.files["/foxglove.PointCloud"])
    assert [row["data"] for row in points] == [bytes(range(i * 12)) for i in range(5)]
    assert json.loads(points[0]["fields"]) == [{"name": "x", "type": "FLOAT32"}]
    updates = table(result.files["/foxglove.SceneUpdate"])
    assert json.loads(updates[1]["entities"])[0]["metadata"] == [{"key": "k", "value": "v"}]


INTEGERS = ("int32", "int64", "uint32", "uint64", "sint32", "sint64", "bool")
EDGES: dict[str, list[Any]] = {
    "int32": [0, 1, -1, 127, 128, -(2**31), 2**31 - 1],
    "int64": [0, 1, -1, 300, -300, -(2**63), 2**63 - 1],
    "uint32": [0, 1, 127, 128, 2**14, 2**31, 2**32 - 1],
    "uint64": [0, 1, 127, 128, 2**35, 2**63, 2**64 - 1],
    "sint32": [0, 1, -1, 63, -64, -(2**31), 2**31 - 1],
    "sint64": [0, 1, -1, 2**40, -(2**40), -(2**63), 2**63 - 1],
    "bool": [False, True, False, True, False, True, True],
}


def test_integers_of_any_length_and_packed_lists(tmp_path: Path) -> None:
    files = FileDescriptorSet()
    file = files.file.add(name="t.proto", package="t", syntax="proto2")
    declared = file.message_type.add(name="Edges")
    kinds = FieldDescriptorProto
    for number, name in enumerate(INTEGERS, 1):
        declared.field.add(
            name=name, number=number, type=getattr(kinds, f"TYPE_{name.upper()}"), label=1
        )
    declared.field.add(name="many", number=20, type=kinds.TYPE_SINT32, label=3)
    pool = DescriptorPool()
    pool.Add(file)
    message_class = GetMessageClass(pool.FindMessageTypeByName("t.Edges"))
    path = tmp_path / "log.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start()
        schema = writer.register_schema("t.Edges", "protobuf", files.SerializeToString())
        channel = writer.register_channel("/edges", "protobuf", schema)
        for i in range(140):
            values = {name: EDGES[name][i % 7] for name in INTEGERS}
            made: Any = message_class(**values)
            if i >= 70:
                made.many.extend(range(-i, i))
            if i % 7 == 6:
                made.ClearField("int64")
            writer.add_message(channel, i, made.SerializeToString(), i, i)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    result = export(path, tmp_path / "out")
    rows = table(result.files["/edges"])
    for i, row in enumerate(rows):
        for name in INTEGERS:
            absent = name == "int64" and i % 7 == 6
            assert row[name] == (None if absent else EDGES[name][i % 7]), (i, name)
        assert row["many"] == (list(range(-i, i)) if i >= 70 else [])


ROS = """\
# a comment
uint8 OK=0
string name "nobody"
geometry_msgs/Point[2] corners
int16[] counts
float32[3] fixed
Inner inner
Inner[] inners
string[] words
bool flag
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
================================================================================
MSG: test_msgs/Inner
builtin_interfaces/Time stamp
uint8[] data
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
PLAIN_ROS = "int8 small\nfloat64 big\nint16[] counts\nstring[] words\nbool flag\nstring name"


def test_ros_of_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    inner: dict[str, Any] = {"stamp": {"sec": 3, "nanosec": 4}, "data": bytes([1, 2, 3])}
    with path.open("wb") as file:
        writer = RosWriter(file)
        nested = writer.register_msgdef("test_msgs/msg/Outer", ROS)
        plain = writer.register_msgdef("test_msgs/msg/Plain", PLAIN_ROS)
        for i in range(40):
            message: dict[str, Any] = {
                "name": "n" * i,
                "corners": [{"x": 1.0, "y": i}, {"x": 2.0, "y": -i}],
                "counts": list(range(i)),
                "fixed": [0.5, i, 2.0],
                "inner": inner,
                "inners": [inner] * (i % 3),
                "words": ["a", "bc"],
                "flag": i % 2 == 0,
            }
            writer.write_message("/nested", nested, message, i, i, i)
            few = {k: message[k] for k in ("counts", "words", "flag", "name")}
            writer.write_message("/plain", plain, {"small": -i, "big": i / 3, **few}, i, i, i)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    result = export(path, tmp_path / "out")
    assert result.problems == []
    for i, row in enumerate(table(result.files["/plain"])):
        assert (row["small"], row["big"], row["flag"]) == (-i, i / 3, i % 2 == 0)
        assert (row["counts"], row["words"], row["name"]) == (list(range(i)), ["a", "bc"], "n" * i)
    for i, row in enumerate(table(result.files["/nested"])):
        assert (row["name"], row["counts"], row["fixed"]) == (
            "n" * i,
            list(range(i)),
            [0.5, i, 2.0],
        )
        assert row["inner.stamp.nanosec"] == 4
        assert list(row["inner.data"]) == [1, 2, 3]
        assert json.loads(row["corners"])[1] == {"x": 2.0, "y": float(-i)}
        assert len(json.loads(row["inners"])) == i % 3


def test_encodings_that_are_not_known(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        text = writer.register_channel("/a/json", "json", 0)
        raw = writer.register_channel("/a.json", "mystery", 0)
        for i in range(9):
            writer.add_message(text, i, json.dumps({"i": i}).encode(), i, i)
            writer.add_message(raw, i, bytes([i]) * i, i, i)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    result = export(path, tmp_path / "out")
    assert len(set(result.files.values())) == 2, "names that would be the same"
    assert [json.loads(r["json"])["i"] for r in table(result.files["/a/json"])] == list(range(9))
    assert [row["data"] for row in table(result.files["/a.json"])] == [
        bytes([i]) * i for i in range(9)
    ]


def _deep(wide: int, deep: int) -> str:
    """A definition whose messages nest: wide ** deep values in all."""
    levels = ["".join(f"p/L1 f{i}\n" for i in range(wide))]
    for level in range(1, deep):
        kind = "uint8" if level == deep - 1 else f"p/L{level + 1}"
        fields = "".join(f"{kind} f{i}\n" for i in range(wide))
        levels.append(f"MSG: p/L{level}\n{fields}")
    return f"{'=' * 80}\n".join(levels)


@pytest.mark.parametrize(
    ("name", "definition"),
    [("NoPackage", "float64[4000000000] x"), ("p/Deep", _deep(10, 9)), ("p/Itself", "p/Itself x")],
    ids=["does not parse", "a billion columns", "within itself"],
)
def test_hostile_definitions_are_kept_as_bytes(tmp_path: Path, name: str, definition: str) -> None:
    log = tmp_path / "log.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name, "ros2msg", definition.encode())
        channel = writer.register_channel("/a", "cdr", schema)
        writer.add_message(channel, 5, b"\0\1\0\0abcd", 5)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    result = export(log, tmp_path / "out")
    table = pq.read_table(result.files["/a"])
    assert table.num_columns == 4
    assert table.column("data").to_pylist() == [b"\0\1\0\0abcd"]


def test_a_damaged_log(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 0xFF
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data[: len(data) * 9 // 10])
    result = export(broken, tmp_path / "out", topics=["/pose"])
    assert len(result.problems) == 1
    reader = LogReader(broken)
    assert result.messages == sum(1 for _ in reader.messages({"/pose"})) > 100


def test_what_cannot_be(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(log, out, topics=["/cmd"])
    with pytest.raises(LogExistsError):
        export(log, out, topics=["/cmd"])
    export(log, out, topics=["/cmd"], force=True)
    with pytest.raises(NoSuchTopicError, match=r"no topic matches '/none'; there are: /clock/sync"):
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
        assert "no topic matches '/none'; there are: " in done.line
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
