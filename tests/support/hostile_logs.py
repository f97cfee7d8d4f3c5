"""Malicious log files, which try to harm their readers."""

from __future__ import annotations

import io
import json
import struct
import zlib
from typing import TYPE_CHECKING

import lz4.frame
import zstandard
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, DataEnd, Footer, Header, Metadata, Schema
from mcap.writer import CompressionType, Writer

from bridge.record.encode import foxglove, schemas
from bridge.record.encode.layout import FieldKind, FlatField, FlatMessage
from bridge.record.encode.packer import Packer
from bridge.record.encode.ros import OCCUPANCY_GRID, schema_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from mcap.records import McapRecord

MAGIC = b"\x89MCAP0\r\n"
MIB = 1 << 20
HEAD_BYTES = 9
"""Size of a record's opcode and length, bytes."""
_MESSAGE = struct.Struct("<BQHIQQ")
_LAST_NS = (1 << 64) - 1
GOOD = b'{"good": 1}'
"""The valid message in every file."""


def record(made: McapRecord) -> bytes:
    """Return the bytes of a record."""
    builder = RecordBuilder()
    made.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it unannotated


def message(channel: int, data: bytes, log_ns: int = 5, length: int | None = None) -> bytes:
    """Return a message record; ``length`` is its stated length, which may be false."""
    size = 22 + len(data) if length is None else length
    return _MESSAGE.pack(5, size, channel, 1, log_ns, log_ns) + data


def chunk(content: bytes, packed: bytes, compression: bytes, claimed: int | None = None) -> bytes:
    """Return a chunk record with the stated sizes and CRC, which may be false."""
    size = len(content) if claimed is None else claimed
    return packed_chunk(packed, compression, size, zlib.crc32(content))


def packed_chunk(packed: bytes, compression: bytes, size: int, crc: int) -> bytes:
    """Return a chunk record with compressed bytes."""
    body = struct.pack("<QQQI", 5, 5, size, crc)
    body += struct.pack("<I", len(compression)) + compression + struct.pack("<Q", len(packed))
    return struct.pack("<BQ", 6, len(body) + len(packed)) + body + packed


def file_of(records: Iterable[bytes]) -> bytes:
    """Return a file without a summary, with one valid message before all others."""
    head = [
        record(Header("", "hostile")),
        record(Schema(id=1, data=b"{}", encoding="jsonschema", name="thing")),
        record(Channel(1, "/good", "json", {}, 1)),
        message(1, GOOD),
    ]
    tail = [record(DataEnd(0)), record(Footer(0, 0, 0)), MAGIC]
    return MAGIC + b"".join((*head, *records, *tail))


def zeros(size: int, *, sized: bool) -> bytes:
    """Return ``size`` zeros as one zstd frame that is 100 000 times smaller."""
    work = zstandard.ZstdCompressor(level=1, write_content_size=sized)
    out = io.BytesIO()
    with work.stream_writer(out, size=size if sized else -1, closefd=False) as stream:
        for _ in range(size // MIB):
            stream.write(bytes(MIB))
    return out.getvalue()


def lz4_zeros(size: int) -> bytes:
    """Return ``size`` zeros as one lz4 frame that is 255 times smaller."""
    work = lz4.frame.LZ4FrameCompressor()
    out = work.begin() + b"".join(work.compress(bytes(MIB)) for _ in range(size // MIB))
    return bytes(out + work.flush())


def bombs() -> dict[str, bytes]:
    """Return chunks that decompress to much more than their own size."""
    sized, unsized = zeros(3072 * MIB, sized=True), zeros(3072 * MIB, sized=False)
    truthful = bytes(120 * MIB)
    tiny = message(1, b"") * (18 * MIB // 31)
    private = struct.pack("<BQ", 0x80, 0) * (60 * MIB // 9)
    return {
        "zstd that claims 1000": file_of([packed_chunk(sized, b"zstd", 1000, 1)]),
        "zstd without a size": file_of([packed_chunk(unsized, b"zstd", 1000, 1)]),
        "zstd that says it all": file_of([packed_chunk(sized, b"zstd", 3072 * MIB, 0)]),
        "zstd that claims 2^64-1": file_of([packed_chunk(sized, b"zstd", _LAST_NS, 0)]),
        "lz4 that claims 1000": file_of([packed_chunk(lz4_zeros(512 * MIB), b"lz4", 1000, 0)]),
        "forty of them": file_of([packed_chunk(unsized, b"zstd", 1000, 1)] * 40),
        "cut zstd": file_of([packed_chunk(sized, b"zstd", 1000, 0)])[: -len(sized) // 2],
        "padding of zeros": file_of([chunk(truthful, zstandard.compress(truthful), b"zstd")]),
        "half a million empty messages": file_of([chunk(tiny, zstandard.compress(tiny), b"zstd")]),
        "records of no kind": file_of([chunk(private, zstandard.compress(private), b"zstd")]),
    }


def declarations() -> dict[str, bytes]:
    """Return files with too many or too large schemas, channels, attachments and metadata."""
    schema = record(Schema(id=2, data=bytes(100 * MIB), encoding="protobuf", name="big"))
    many = b"".join(
        record(Schema(id=n, data=b"{}", encoding="jsonschema", name=f"s{n}"))
        + record(Channel(n, f"/t{n}", "json", {}, n))
        for n in range(2, 60_000)
    )
    return {
        "a schema of 100 MiB": file_of([chunk(schema, zstandard.compress(schema), b"zstd")]),
        "60 000 channels": file_of([chunk(many, zstandard.compress(many), b"zstd")]),
        "an attachment of 2^60": file_of([struct.pack("<BQ", 9, 1 << 60) + bytes(64)]),
        "lengths beyond the record": file_of(
            [
                struct.pack("<BQQQI", 9, 24, 1, 1, 0xFFFF_FFFF) + bytes(4),
                struct.pack("<BQI", 12, 8, 0xFFFF_FFFF) + bytes(4),
                struct.pack("<BQHI", 3, 12, 9, 0xFFFF_FFFF) + bytes(6),
                message(1, b"", length=0xFFFF_FFFF),
            ]
        ),
        "metadata that lies": file_of(
            [
                record(Metadata(name="sweepctl", metadata={"clock_offset_ns": "9" * 4000})),
                record(Metadata(name="device", metadata={"node": "x" * 10_000})),
            ]
        ),
    }


def _ours(topic: str, data: Iterable[tuple[int, bytes]], *attachments: tuple[str, bytes]) -> bytes:
    """Return messages on a topic of sweepctl, with its schema."""
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start()
    good = writer.register_channel("/good", "json", 0)
    writer.add_message(good, 5, GOOD, 5)
    if topic.startswith("/map"):
        text = schema_text(OCCUPANCY_GRID).encode()
        schema = writer.register_schema(OCCUPANCY_GRID, "ros2msg", text)
        channel = writer.register_channel(topic, "cdr", schema)
    else:
        layout = {"/events": schemas.EVENT, "/pose/estimate": schemas.POSE_ESTIMATE}[topic]
        schema = writer.register_schema(layout.full_name, "protobuf", layout.descriptor_set())
        channel = writer.register_channel(topic, "protobuf", schema)
    for log_ns, one in data:
        writer.add_message(channel, log_ns, one, log_ns)
    for name, content in attachments:
        writer.add_attachment(5, 5, name, "application/json", content)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return file.getvalue()


def _grid(columns: int, rows: int, cells: int, count: int) -> bytes:
    """Return a grid that claims a size, followed by another number of cells."""
    head = struct.pack("<4sIII", b"\0\1\0\0", 1, 0, 4) + b"map\0"
    info = struct.pack("<IIfII", 1, 0, 0.02, columns, rows) + struct.pack("<4x7d", *[0.0] * 7)
    return head + info + struct.pack("<I", cells) + bytes(count)


def _event(text: bytes) -> bytes:
    """Return an event with the given text."""
    out = b""
    for number, value in enumerate((b"warning", b"planner", b"occlusion", text, text), 1):
        out += bytes([number << 3 | 2]) + _varint(len(value)) + value
    return out


def _varint(value: int) -> bytes:
    out = b""
    while value >= 0x80:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def contents() -> dict[str, bytes]:
    """Return our messages with absurd values."""
    nan = schemas.POSE_ESTIMATE.encode([float("nan")] * len(schemas.POSE_ESTIMATE.fields))
    huge = schemas.POSE_ESTIMATE.encode([1e308] * len(schemas.POSE_ESTIMATE.fields))
    numbers = {
        "room": "x" * 100_000, "planner": "y", "outcome": "complete", "reason": None,
        "duration_s": 10**400, "path_m": 1e308, "turns": 10**30, "seed": 10**300,
        "collisions": -1, "energy_wh": 10**350, "t90_s": 1, "t99_s": 1, "largest_hole_cm2": 1,
        "coverage": {"mouth_sweepable": 10**310},
        "pose_error_m": {"end": 1, "max": 1},
        "wire": {
            "lost": 10**310, "crc_errors": 10**310,
            "frames": {"rx": 10**310, "tx": 1}, "bytes": {"rx": 10**310, "tx": 10**309},
        },
    }  # fmt: skip
    room = {
        "name": "n" * 100_000,
        "walls": [[0, 0], [1e9, 0], [1e9, 1e9], [0, 1e9]],
        "obstacles": [],
        "start": [1, 1, 0],
    }
    grids = [_grid(0xFFFF_FFFF, 0xFFFF_FFFF, 0xFFFF_FFFF, 9), _grid(1 << 31, 2, 9, 9)]
    grids += [_grid(0, 0xFFFF_FFFF, 0, 0), _grid(3, 3, 9, 9), _grid(70_000, 70_000, 9, 9)]
    times = [0, 5, 1 << 62, 1 << 63, _LAST_NS]
    return {
        "grids of any size": _ours("/map/coverage", list(enumerate(grids))),
        "poses that are no numbers": _ours("/pose/estimate", [(6, nan), (7, huge), (8, nan)]),
        "times of 2^64-1": _ours("/pose/estimate", [(t, huge) for t in times]),
        "events at the end of time": _ours("/events", [(t, _event(b"{}")) for t in times]),
        "events of a mebibyte": _ours(
            "/events", [(6, _event(b"[" * MIB)), (7, _event(b'{"x_m": "a"}'))]
        ),
        "a varint without an end": _ours("/events", [(6, b"\x08" + b"\xff" * 300_000)]),
        "a summary of large numbers": _ours(
            "/events", [], ("summary.json", json.dumps(numbers).encode())
        ),
        "a room of a million kilometres": _ours(
            "/pose/estimate", [(6, huge)], ("room.json", json.dumps(room).encode())
        ),
        "a robot file that is none": _ours("/events", [], ("robot.toml", b"\xff\0[[[")),
    }


def impostors() -> dict[str, bytes]:
    """Return our topics and schemas with fields of other types, and frames at the end of time."""
    layouts = {
        "/pose/estimate": schemas.POSE_ESTIMATE,
        "/cmd": schemas.COMMAND,
        "/planner": schemas.PLANNER_STATE,
        "/events": schemas.EVENT,
        "/clock/sync": schemas.CLOCK_SYNC,
        "/raw/uart/rx": schemas.RAW_BYTES,
        "/raw/uart/tx": schemas.RAW_BYTES,
        "/raw/can": schemas.RAW_CAN,
    } | {f"/device/{name}": layout for name, layout in _device_layouts().items()}
    made = {}
    for kind, value in (
        (FieldKind.STRING, "x"),
        (FieldKind.DOUBLE, 1e308),
        (FieldKind.FIXED64, _LAST_NS),
    ):
        file = io.BytesIO()
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        good = writer.register_channel("/good", "json", 0)
        writer.add_message(good, 5, GOOD, 5)
        for topic, layout in layouts.items():
            fields = [FlatField(f.name, kind, f.number) for f in layout.fields]
            other = FlatMessage(layout.name, fields)
            schema = writer.register_schema(other.full_name, "protobuf", other.descriptor_set())
            channel = writer.register_channel(topic, "protobuf", schema)
            for log_ns in (6, 7, 1 << 62, _LAST_NS):
                writer.add_message(channel, log_ns, other.encode([value] * len(fields)), log_ns)
        poses = writer.register_channel("/pose", "json", 0)
        writer.add_message(poses, 6, b"{}", 6)
        writer.add_attachment(5, 5, "room.json", "application/json", _ROOM)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
        made[f"fields that are all {kind.name}"] = file.getvalue()
    made["poses far away"] = _poses()
    return made


_ROOM = (
    b'{"name": "r", "walls": [[0, 0], [2, 0], [2, 2], [0, 2]], "obstacles": [], "start": [1, 1, 0]}'
)


def _device_layouts() -> dict[str, FlatMessage]:
    """Return the layout of each device message, as a log declares it."""
    return {name: encoder.layout for name, encoder in schemas.device_encoders().items()}


def _poses() -> bytes:
    """Return poses of foxglove's own type far outside any room."""
    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    good = writer.register_channel("/good", "json", 0)
    writer.add_message(good, 5, GOOD, 5)
    name, encoding, data = foxglove.schema(PoseInFrame)
    schema = writer.register_schema(name, encoding, data)
    values = [float("nan"), float("inf"), 1e308, -1e308, 1e9, 1.0, 1.1]
    for topic in ("/pose", "/truth/pose"):
        channel = writer.register_channel(topic, "protobuf", schema)
        for n, value in enumerate(values):
            one = Packer(foxglove.POSE_PARTS).pack([bytes(12), value, value, value, value])
            writer.add_message(channel, n, one, n)
            writer.add_message(channel, _LAST_NS - n, one, n)
    writer.add_attachment(5, 5, "room.json", "application/json", _ROOM)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return file.getvalue()


def definitions() -> dict[str, bytes]:
    """Return schemas that expand."""
    deep = "".join(
        f"================\nMSG: a/T{n}\n" + "".join(f"a/T{n + 1} f{i}\n" for i in range(10))
        for n in range(11)
    )
    deep = "a/T0 x\n" + deep + "================\nMSG: a/T11\n"
    return {
        name: file_of(
            [
                record(Schema(id=2, data=text.encode(), encoding="ros2msg", name="a/Top")),
                record(Channel(2, "/bomb", "cdr", {}, 2)),
                message(2, b"\0\1\0\0" + b"\xff\xff\xff\x7f" * 9),
            ]
        )
        for name, text in {
            "a definition that unfolds": deep,
            "arrays of four billion": "float64[4000000000] x\nstring[] y\n",
            "a type within itself": "a/Top x\n================\nMSG: a/Top\na/Top x\n",
        }.items()
    }


def searches() -> dict[str, bytes]:
    """Return small files in which each record starts a search up to the file's end."""
    unknown = struct.pack("<BQ", 0x20, 0) * 30_000 + b"\x21" * 30
    count, size = 120_000, 60
    within = bytearray()
    for n in range(count):  # content that looks like an attachment up to the file's end
        rest = max(0, (count - n) * size - 80)
        content = struct.pack("<QQIIQ", 0, 0, 0, 0, rest).ljust(size - HEAD_BYTES, b"Z")
        within += struct.pack("<BQ", 0x90, len(content)) + content
    return {
        "records of a reserved kind": file_of([unknown]),
        "attachments within each other": file_of([bytes(within)]),
        "a chunk that claims to be empty": file_of([claims_to_be_empty()]),
    }


def claims_to_be_empty() -> bytes:
    """Return a chunk in which neither the claim nor the frame's head gives the content's size."""
    work = zstandard.ZstdCompressor(write_content_size=False)
    return packed_chunk(work.compress(bytes(500)), b"zstd", 0, 0)


GROUPS: dict[str, Callable[[], dict[str, bytes]]] = {
    "bombs": bombs,
    "declarations": declarations,
    "contents": contents,
    "impostors": impostors,
    "definitions": definitions,
    "searches": searches,
}


def attachment_of(size: int) -> bytes:
    """Return an attachment that is too large to be kept."""
    return file_of([record(Attachment(1, 1, "huge.bin", "x", bytes(size)))])
