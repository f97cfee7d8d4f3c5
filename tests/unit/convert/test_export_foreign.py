"""Exported tables of logs by other programs, and of malicious logs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

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

from bridge.convert.export import export
from support.exported import table

if TYPE_CHECKING:
    from pathlib import Path

    from google.protobuf.message import Message


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
    """The messages have omitted defaults, enumerations, long texts and lists of messages."""
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


def test_unknown_encodings(tmp_path: Path) -> None:
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
    """Return a definition with nested messages: wide ** deep values in all."""
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
