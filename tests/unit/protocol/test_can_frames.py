"""CAN frames byte by byte: identifiers, payloads, time stamps, segments, and lengths in bits."""

from __future__ import annotations

from zlib import crc32

import pytest

from protocol.can.frames import (
    RECORD,
    CanFrame,
    from_record,
    nominal_bits,
    to_record,
    worst_bits,
)
from protocol.can.link import CanLink
from protocol.can.load import BITRATE, loads
from protocol.can.transfers import MAX_CONTENT, content, parse_content, segments
from protocol.link import Received
from protocol.messages.device import (
    Ack,
    Encoders,
    Hello,
    Imu,
    LogText,
    PlannerState,
    Power,
    Sync,
    TimeReply,
)
from protocol.messages.host import (
    PlannerCommand,
    SetParameter,
    Stop,
    StopAll,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.schema.message import Direction, Message
from support.can_bus import crc15, frame_bits

HOST, DEVICE = Direction.HOST, Direction.DEVICE
T_US = 0x0012_3456
T16 = (T_US >> 4 & 0xFFFF).to_bytes(2, "little").hex()


def frames_of(sends: Direction, *messages: Message, node: int = 1, flags: int = 0) -> list[str]:
    """Return the frames on the bus, ``id#data`` as candump writes them."""
    link = CanLink(sends)
    for message in messages:
        link.send(message, T_US, node=node, flags=flags)
    data = link.data_to_send()
    records = [data[i : i + RECORD.size] for i in range(0, len(data), RECORD.size)]
    frames = [from_record(record) for record in records]
    return [f"{f.can_id:03x}#{f.data.hex()}" for f in frames if f is not None]


def test_stops_are_one_frame_and_the_first_of_all() -> None:
    assert frames_of(HOST, StopAll(), node=0) == ["000#"], "the frame is the same from each sender"
    assert frames_of(HOST, Stop(0x0102, 3), node=5) == [f"015#20{T16}020103e0"]
    assert frames_of(HOST, Stop(0x0102, 3), node=5, flags=2) == [f"015#22{T16}020103e0"]
    busy = [VelocitySetpoint(1, 2, 200, 4), TimeRequest(1), Stop(9, 1), StopAll()]
    assert [f[:3] for f in frames_of(HOST, *busy)] == ["001", "011", "021", "071"]


def test_the_queue_leaves_by_rank_and_of_one_rank_in_its_order() -> None:
    link = CanLink(DEVICE)
    imu = Imu(1, 2, 3, 4, 5, 6, 7)
    link.send(LogText(0, "x" * 20), 0, node=1)
    link.send(Ack(1, 2), 0, node=1, rank=0x79)  # must not overtake the log line
    for t_us in (0, 160):
        link.send(imu, t_us, node=1)
    link.send(Ack(3, 4), 0, node=1)
    data = link.data_to_send()
    ids = [RECORD.unpack(data[i : i + 16])[0] >> 4 for i in range(0, len(data), 16)]
    assert ids == [0x15, 0x13, 0x14, 0x13, 0x14, 0x19, *[0x79] * 5, 0x19]


@pytest.mark.parametrize(
    ("message", "frames"),
    [
        (Encoders(0x1234, 0x5678), [f"161#{T16}34127856"]),
        (Power(16000, 200, 3, 4), [f"241#{T16}803ec80304"]),
        (
            Imu(1, 2, 3, 4, 5, 6, 7),
            [f"151#{T16}0400", f"131#{T16}010002000300", f"141#{T16}050006000700"],
        ),
        (
            PlannerState(1, 2, 3, -1, 5, 6, 7, 3),
            [f"2c1#{T16}01020300ffff", f"2d1#{T16}050006000703"],
        ),
        # the full time stamp, and the number of frames sent so far
        (Sync(99), ["101#5634120001000000"]),
        (Ack(7, 2), [f"191#20{T16}070002e0"]),
    ],
    ids=lambda v: type(v).__name__ if isinstance(v, Message) else "",
)
def test_device_frames(message: Message, frames: list[str]) -> None:
    assert frames_of(DEVICE, message) == frames


def test_host_frames() -> None:
    assert frames_of(HOST, VelocitySetpoint(-2, 3, 200, 9)) == [f"021#{T16}feff0300c809"]
    assert frames_of(HOST, TimeRequest(7), TimeRequest(8)) == [
        "071#285634120007e0",  # one byte of payload leaves room for the full stamp
        "071#285634120008e1",
    ]
    assert frames_of(HOST, PlannerCommand(1, 2, 3)) == [f"091#20{T16}01000203e0"]


def test_a_transfer_of_several_frames_ends_with_its_crc() -> None:
    whole = bytes.fromhex("285634120001000203") + (77).to_bytes(4, "little")
    ends = crc32(whole).to_bytes(4, "little")
    body = whole + ends
    assert frames_of(HOST, SetParameter(1, 2, 3, 77)) == [
        f"711#{body[:7].hex()}a0",
        f"711#{body[7:14].hex()}00",
        f"711#{body[14:].hex()}60",
    ]


def test_the_slow_part_goes_with_the_first_and_then_once_a_second() -> None:
    link = CanLink(DEVICE)
    sent_at = []
    for tick in range(0, 3_000_000, 10_000):
        link.send(Imu(1, 2, 3, 4, 5, 6, 7), 0xFFF0_0000 + tick, node=1)
        if len(link.data_to_send()) == 3 * RECORD.size:
            sent_at.append(tick)
    assert sent_at == [0, 1_000_000, 2_000_000]


def test_sync_counts_frames_in_the_order_of_leaving() -> None:
    frames = frames_of(DEVICE, LogText(0, "x" * 20), Sync(0), Imu(1, 2, 3, 4, 5, 6, 7), Sync(0))
    counts = [int.from_bytes(bytes.fromhex(f[12:]), "little") for f in frames if f[:4] == "101#"]
    assert counts == [frames.index(f) + 1 for f in frames if f[:4] == "101#"]


@pytest.mark.parametrize("size", [*range(30), 240, 241])
def test_content_prefers_the_whole_stamp_unless_that_costs_a_frame(size: int) -> None:
    data = content(0x12, 0xFEDC_BA98, bytes(size))
    parsed = parse_content(data)
    assert parsed is not None
    assert parsed.payload == bytes(size)
    assert parsed.version_flags == 0x12
    assert parsed.whole is (size not in {3, 4})
    assert parsed.stamp == (0xFEDC_BA98 if parsed.whole else 0xFEDC_BA98 >> 4 & 0xFFFF)
    assert len(data) <= MAX_CONTENT
    cut = segments(data, 33)
    assert all(2 <= len(piece) <= 8 for piece in cut)
    assert {piece[-1] & 0x1F for piece in cut} == {1}


@pytest.mark.parametrize("data", [b"", b"\x10", b"\x10\x00", b"\x18\x00\x00\x00"])
def test_contents_too_short_for_their_stamp(data: bytes) -> None:
    assert parse_content(data) is None


def test_records_are_those_of_linux() -> None:
    frame = CanFrame(0x121, b"abc")
    assert to_record(frame).hex() == "21010000" + "03000000" + "6162630000000000"
    assert from_record(to_record(frame)) == frame
    assert (frame.can_type, frame.node) == (0x12, 1)
    for flag in (0x8000_0000, 0x4000_0000, 0x2000_0000, 0x800):
        assert from_record(RECORD.pack(0x121 | flag, 3, b"abc")) is None
    assert from_record(RECORD.pack(0x121, 9, b"abc")) is None


def test_the_crc_is_that_of_can() -> None:
    assert crc15(int.from_bytes(b"123456789", "big"), 72) == 0x059E  # CRC-15/CAN's check value


def test_bits_of_known_frames() -> None:
    # The CRC of zeros is 0. The frame has 34 zeros from the start bit on, and a stuff bit after
    # each five of them.
    assert frame_bits(CanFrame(0, b"")) == 47 + 6
    for length in range(9):
        assert nominal_bits(length) == 47 + 8 * length
        for fill in (0x00, 0x55, 0xFF, 0x78):
            bits = frame_bits(CanFrame(0x555, bytes([fill]) * length))
            assert nominal_bits(length) <= bits <= worst_bits(length)
    assert worst_bits(8) == 135  # Davis, Burns, Bril and Lukkien 2007


def test_bus_load_at_default_rates_is_below_thirty_percent() -> None:
    """The load has streams in both directions, fast pings and ten log lines/s, at 500 kbit/s."""
    rows = loads()
    nominal = sum(row.bits_per_s for row in rows) / BITRATE
    worst = sum(row.worst_bits_per_s for row in rows) / BITRATE
    imu = next(row for row in rows if row.name == "imu")
    assert imu.bits_per_s == 200 * 111 + 79
    assert imu.worst_bits_per_s == 200 * 135 + 79 + 16
    assert nominal < worst < 0.30


def test_long_text_is_cut_and_joined() -> None:
    hello = Hello(1, bytes(range(12)), 2, 3, 0, 63, 0, 1, 0, "x" * 100)
    sender, receiver = CanLink(DEVICE), CanLink(HOST)
    sender.send(hello, T_US, node=3)
    (event,) = receiver.receive(sender.data_to_send(), 0)
    assert isinstance(event, Received)
    assert event.message == hello
    assert event.frame.t_us == T_US
    sender.send(TimeReply(1, 0xFFFF_FFFF), T_US + 7, node=3)
    (event,) = receiver.receive(sender.data_to_send(), 0)
    assert isinstance(event, Received)
    assert event.frame.t_us == T_US + 7, (
        "the stamp is not rounded, because it synchronises the clocks"
    )
