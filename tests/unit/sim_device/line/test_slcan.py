"""The emulated serial CAN adapter: commands, rejections, and frames in both directions."""

from __future__ import annotations

import pytest

from protocol.can.frames import RECORD
from sim_device.line.slcan import LONGEST_LINE, SlcanAdapter

FRAME = RECORD.pack(0x121, 3, b"\x0a\xbc\xff")


def opened(bitrate: int = 500_000) -> SlcanAdapter:
    adapter = SlcanAdapter(bitrate)
    assert adapter.feed(b"S6\rO\r") == (b"", b"\r\r")
    return adapter


@pytest.mark.parametrize(
    ("line", "record"),
    [
        (b"t12130ABCFF\r", FRAME),
        (b"t12130abcff\r", FRAME),
        (b"t0000\r", RECORD.pack(0, 0, b"")),
        (b"T1ABCDEF0155\r", RECORD.pack(0x9ABC_DEF0, 1, b"\x55")),
        (b"r1213\r", RECORD.pack(0x4000_0121, 3, b"")),
        (b"R000001213\r", RECORD.pack(0xC000_0121, 3, b"")),
    ],
)
def test_frames_both_ways(line: bytes, record: bytes) -> None:
    adapter = opened()
    assert adapter.feed(line) == (record, b"\r")
    assert adapter.from_bus(record).upper() == line.upper()


@pytest.mark.parametrize(
    "line",
    [
        b"t1219\r",
        b"t1211\r",
        b"t12110\r"[:5] + b"\r",
        b"t1210AA\r",
        b"t8000\r",
        b"tXYZ0\r",
        b"t12\r",
        b"t121100ZZ\r",
        b"T200000000\r",
        b"O\r",
        b"S6\r",
        b"S99\r",
        b"?\r",
        b"t121\xff\r",
        b"t1211" + b"0" * LONGEST_LINE + b"\r",
    ],
)
def test_rejected(line: bytes) -> None:
    assert opened().feed(line) == (b"", b"\a")


def test_closed_listening_and_asked() -> None:
    adapter = SlcanAdapter()
    assert adapter.feed(b"t12100\r"[:6] + b"\r") == (b"", b"\a")
    assert adapter.from_bus(FRAME) == b""
    assert adapter.feed(b"V\rN\r\r") == (b"", b"V1013\rNSW01\r\r")
    assert adapter.feed(b"F\rC\r") == (b"", b"\a\a")
    assert adapter.feed(b"L\rt1210\r") == (b"", b"\r\a")
    assert adapter.from_bus(FRAME) == b"t12130ABCFF\r"
    assert adapter.feed(b"C\rO\rF\r") == (b"", b"\r\rF00\r")


def test_another_bit_rate_than_the_bus_receives_nothing() -> None:
    adapter = SlcanAdapter()
    adapter.feed(b"S4\rO\r")
    assert adapter.feed(b"t1210\r") == (b"", b"\a")
    assert adapter.from_bus(FRAME) == b""
    assert adapter.feed(b"F\rF\r") == (b"", b"F80\rF00\r")


def test_byte_by_byte_and_without_an_end() -> None:
    adapter = opened()
    records = answers = b""
    for byte in b"t12130ABCFF\rV\r":
        record, answer = adapter.feed(bytes([byte]))
        records, answers = records + record, answers + answer
    assert (records, answers) == (FRAME, b"\rV1013\r")
    for _ in range(100):
        assert adapter.feed(b"x" * 100) == (b"", b"")
    assert adapter.feed(b"\rt1210\r") == (RECORD.pack(0x121, 0, b""), b"\a\r")
