"""The link between chip and plant: valid, invalid and damaged frames."""

from __future__ import annotations

import binascii
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_device.ports import qemu_link as link
from sim_device.sensors.contacts import Bumpers
from sim_device.sensors.imu import ImuCounts
from sim_device.sensors.power_monitor import PowerReading
from sim_device.sensors.rangers import Ranges


def framed(kind: int, payload: bytes) -> bytes:
    """Return a frame that is built without the module under test."""
    body = bytes([kind, len(payload)]) + payload
    return b"\xa5" + body + binascii.crc32(body).to_bytes(4, "little")


SENT = {
    link.ChipBoot(1): framed(0x01, b"\x01"),
    link.PlantRequest(70_000, 80_000, 60_000, -10_000, 2500, 7000, drivers=True): framed(
        0x02, bytes.fromhex("70110100 80380100 60ea0000 f0d8 c409 581b 01")
    ),
    link.Motors(0xFFFF_FFFF, 1, -1, drivers=False): framed(
        0x03, bytes.fromhex("ffffffff 0100 ffff 00")
    ),
    link.Erase(1): framed(0x04, b"\x01"),
    link.Write(1, 1020, b"\x01\x02\x03\x04"): framed(0x05, bytes.fromhex("01 fc03 01020304")),
    link.ChipReset(3): framed(0x06, b"\x03"),
}


@pytest.mark.parametrize("message", SENT, ids=lambda m: type(m).__name__)
def test_each_message_of_the_chip(message: link.Message) -> None:
    assert list(link.Parser().feed(SENT[message])) == [message]


@given(
    st.lists(st.one_of(st.sampled_from(list(SENT.values())), st.binary(max_size=40)), max_size=8),
    st.lists(st.integers(1, 60), max_size=12),
)
def test_the_same_however_the_bytes_are_split(parts: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(parts)
    whole = link.Parser()
    expected = list(whole.feed(stream))
    split = link.Parser()
    found: list[link.Message] = []
    rest = stream
    for cut in cuts:
        found += split.feed(rest[:cut])
        rest = rest[cut:]
    found += split.feed(rest)
    assert found == expected
    assert split.damaged == whole.damaged


QUIET = st.binary(max_size=64).filter(lambda noise: b"\xa5" not in noise)


@given(QUIET, st.integers(0, 26 * 8 - 1))
def test_a_damaged_frame_costs_itself_only(noise: bytes, bit: int) -> None:
    frames = list(SENT.values())
    broken = bytearray(frames[1])
    assert len(broken) == 26
    broken[bit // 8] ^= 1 << bit % 8
    parser = link.Parser()
    found = list(parser.feed(noise + bytes(broken) + b"".join(frames) * 14))
    # A wrong length covers at most 255 later bytes, which the parser then parses again.
    assert found == list(SENT) * 14


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (0x07, b""),  # no such type
        (0x02, bytes(17)),  # one byte short
        (0x04, b"\x02"),  # no such page
        (0x05, struct.pack("<BH", 0, 1021) + bytes(4)),  # beyond the page's end
        (0x05, b"\x00"),
    ],
)
def test_missing_entries_are_ignored(kind: int, payload: bytes) -> None:
    parser = link.Parser()
    assert list(parser.feed(framed(kind, payload) + SENT[link.ChipBoot(1)])) == [link.ChipBoot(1)]
    assert parser.damaged == 1


def test_a_reset_drops_half_a_frame() -> None:
    parser = link.Parser()
    assert not list(parser.feed(SENT[link.Motors(0xFFFF_FFFF, 1, -1, drivers=False)][:-1]))
    parser.clear()
    assert list(parser.feed(SENT[link.ChipBoot(1)])) == [link.ChipBoot(1)]


def test_a_sample() -> None:
    imu = ImuCounts(-1, 2, 16384, -3000, 131, -131, 0)
    data = link.sample(
        (1 << 32) + 10_000,
        (65_535, 7),
        imu,
        Ranges(1.2345, 0.05004, None, 54_321),
        Bumpers(left=False, right=True),
        cliff=True,
        imu_age_us=9_999,
    )
    payload = bytes.fromhex(
        "10270000 ffff 0700 ffff 0200 0040 48f4 8300 7dff 0000 d204 f401 ffff 06 0f270000 31d40000"
    )
    assert data == framed(0x83, payload)


def test_power_has_no_sign_and_fits() -> None:
    data = link.power(5, PowerReading(15.9994, 4.9996, -0.1234, 70.0))
    assert data == framed(0x84, bytes.fromhex("05000000 7f3e 8813 7b00 ffff"))


def test_identity() -> None:
    uid = bytes(range(12))
    expected = framed(0x81, uid + bytes.fromhex("efbeadde 04 0f 03"))
    assert link.identity(uid, 0xDEADBEEF, 4, 15, 3) == expected


def test_pages_are_sent_as_far_as_they_are_written() -> None:
    empty = bytes(b"\xff" * 1024)
    assert link.pages([empty, empty]) == []
    page = bytearray(empty)
    page[0:130] = bytes(130)
    assert link.pages([empty, page]) == [
        framed(0x82, struct.pack("<BH", 1, 0) + bytes(128)),
        framed(0x82, struct.pack("<BH", 1, 128) + bytes(2)),
    ]
