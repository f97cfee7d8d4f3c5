"""Captures of other programs, read as logs: candump logs and raw bytes."""

from __future__ import annotations

import os
import tracemalloc
from typing import TYPE_CHECKING

import pytest

from bridge.convert.file_kinds import CANDUMP, MCAP, RAW, kind_of
from bridge.convert.sources import describe_any, readable
from bridge.record.errors import LogReadError
from bridge.record.reader import LogReader
from support.cli import plain_messages, short_runs, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

# A status and half an IMU sample of node 1, computed by hand from PROTOCOL.md. The identifier is
# the type << 4 | node. The last two bytes are the stamp in units of 16 µs.
CANDUMP_LOG = """\
(1700000000.000100) can0 101#00000000000100000000
(1700000000.010200) can0 101#00E1F50501000000
(1700000000.020300) can0 7FF#0102
(1700000000.030000) can0 121#0100020003003412
(1700000000.030500) can0 221#0400050006003412
(1700000000.040000) can0 1ABCDEF0#11
(1700000000.050000) can0 123#R
(1700000000.055000) can0 124#R8
(1700000000.057000) can0 125#1122334455667788_9
(1700000000.060000) can0 123##1AABBCC
(1700000000.070000) can0 123#AABBC
not a line of candump
"""


def test_kinds(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    log = short_runs(tmp_path_factory)[0].log
    assert kind_of(log) == MCAP
    dump = tmp_path / "candump.log"
    dump.write_text(CANDUMP_LOG)
    assert kind_of(dump) == CANDUMP
    shown = tmp_path / "shown.txt"
    shown.write_text(" (1700000000.000100)  can0  101   [3]  00 E1 F5\n")
    assert kind_of(shown) == CANDUMP
    noise = tmp_path / "noise.bin"
    noise.write_bytes(bytes(range(256)))
    assert kind_of(noise) == RAW
    with pytest.raises(LogReadError):
        kind_of(tmp_path / "none")


def test_a_candump_log_frame_by_frame(tmp_path: Path) -> None:
    dump = tmp_path / "candump.log"
    dump.write_text(CANDUMP_LOG)
    with readable(dump) as made:
        frames = [(m.log_ns, m.decoded) for m in LogReader(made).messages({"/raw/can"})]
    assert [(ns - 1_700_000_000_000_000_000) // 1000 for ns, _ in frames] == [
        *(10_200, 20_300, 30_000, 30_500, 40_000, 50_000, 55_000, 57_000)
    ], "the first has ten bytes, which is no classic frame"
    assert [frame.can_id for _, frame in frames] == [
        *(0x101, 0x7FF, 0x121, 0x221, 0x9ABCDEF0, 0x4000_0123, 0x4000_0124, 0x125)
    ]
    assert frames[2][1].data == bytes.fromhex("0100020003003412")
    assert not frames[2][1].outgoing


def test_a_raw_capture_gives_the_messages_of_its_log(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = short_runs(tmp_path_factory)[0].log
    reader = LogReader(log)
    raw = b"".join(m.decoded.data for m in reader.messages({"/raw/uart/rx"}))
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"login: \xff\xfe" + raw + b"\x07half")
    os.utime(capture, ns=(0, 1_750_000_000_000_000_000))

    def content(path: Path, topic: str) -> list[tuple[int, tuple[int, int]]]:
        return [
            (m.sequence, (m.decoded.t_us, m.decoded.node))
            for m in LogReader(path).messages({topic})
        ]

    with readable(capture) as made:
        for topic in ("/device/imu", "/device/encoders", "/device/range", "/device/status"):
            assert content(made, topic) == content(log, topic)
        again = b"".join(m.decoded.data for m in LogReader(made).messages({"/raw/uart/rx"}))
        assert again == capture.read_bytes(), "every byte, bad ones included"
        imu = [m.log_ns for m in LogReader(made).messages({"/device/imu"})]
        poses = list(LogReader(made).messages({"/pose"}))
    stamps = [t_us for _, (t_us, _) in content(log, "/device/imu")]
    assert imu[-1] - imu[0] == pytest.approx((stamps[-1] - stamps[0]) * 1000, abs=2e7)
    assert imu[-1] <= 1_750_000_000_000_000_000
    assert len(poses) > 500, "odometry of what was recorded"


def test_info_of_captures(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    log = short_runs(tmp_path_factory)[0].log
    raw = b"".join(m.decoded.data for m in LogReader(log).messages({"/raw/uart/rx"}))
    capture = tmp_path / "capture.bin"
    capture.write_bytes(raw)
    reported = sweepctl("info", capture, "--json")
    assert reported.status == 0
    assert (reported.json["format"], reported.json["path"]) == ("raw", str(capture))
    assert reported.json["file_bytes"] == len(raw)
    counts = {t["topic"]: t["count"] for t in reported.json["topics"]}
    assert counts["/device/imu"] == len(plain_messages(log, "/device/imu"))
    people = sweepctl("info", capture)
    assert "a raw capture" in people.out


@pytest.mark.parametrize("content", [b"", b"hello\n" * 99, bytes(1000), b"\xff" * 5000])
def test_captures_without_a_sweepers_frames(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(LogReadError, match=r"not an MCAP file or a candump log, and has no frame"):
        describe_any(path)
    path.write_text("(1700000000.000100) can0 7FF#00\n")
    with pytest.raises(LogReadError, match="none of its frames"):
        describe_any(path)


@pytest.mark.parametrize(
    "content",
    [
        b"(1700000000.000100) can0 7FF#" + b"A" * 1_000_000,
        b"(" + b"9" * 5000 + b".0) can0 7FF#00\n",
        bytes(100_000),
        b"\x01\0" * 40_000,
    ],
    ids=["a line of 1 MB", "a moment of 5000 digits", "zeros", "every other byte a zero"],
)
def test_hostile_captures_take_no_more_memory_than_they_have_bytes(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"")
    with pytest.raises(LogReadError):
        describe_any(path)  # this call imports the libraries that it needs
    path.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(LogReadError):
            describe_any(path)
        _, maximum = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert maximum < 3 * path.stat().st_size + 2_000_000


def test_an_impossible_time_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "candump.log"
    path.write_text("(9999999999.0) can0 123#00\n" + CANDUMP_LOG)
    with readable(path) as made:
        assert len(list(LogReader(made).messages({"/raw/can"}))) == 8
