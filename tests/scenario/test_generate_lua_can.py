"""The Wireshark dissector for CAN, tested by tshark's output for captures."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from protocol.authentication import Authenticator
from protocol.can.frames import from_record, is_native
from protocol.can.link import CanLink
from protocol.messages.host import VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from support.captures import SOCKETCAN, Packet, Seen, Tshark, socketcan, write_pcap
from support.dissected import assert_field, assert_message, random_message, random_messages

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from protocol.can.frames import CanFrame
    from protocol.schema.message import Message, MessageSpec

    Dissect = Callable[[int, list[Packet]], list[Seen]]


pytestmark = [pytest.mark.slow, pytest.mark.needs("tshark")]


@pytest.fixture(scope="module")
def tshark(tmp_path_factory: pytest.TempPathFactory) -> Tshark:
    return Tshark(tmp_path_factory.mktemp("wireshark"))


@pytest.fixture
def dissect(tshark: Tshark) -> Dissect:
    return tshark.dissect_packets


def can_packets(frames: list[CanFrame], t_us: int = 0) -> list[Packet]:
    return [Packet(socketcan(f.can_id, f.data), t_us + 300 * i) for i, f in enumerate(frames)]


def sent_over_can(message: Message, direction: Direction, node: int, t_us: int) -> list[CanFrame]:
    link = CanLink(direction)
    link.send(message, t_us, node=node)
    data = link.data_to_send()
    records = [from_record(data[i : i + 16]) for i in range(0, len(data), 16)]
    assert None not in records
    return [r for r in records if r is not None]


def test_messages_over_can_show_every_field(dissect: Dissect) -> None:
    made = random_messages(seed=7)
    rng = random.Random(8)
    packets: list[Packet] = []
    plan: list[tuple[MessageSpec, Message, int, int, int]] = []
    for number, (spec, message) in enumerate(made):
        node, t_us = rng.randrange(1, 16), rng.randrange(1 << 32)
        frames = sent_over_can(message, spec.direction, node, t_us)
        # The packets are far apart in time, so that equal frames are no duplicates.
        packets += can_packets(frames, number * 2_000_000)
        plan.append((spec, message, node, t_us, len(frames)))
    seen = iter(dissect(SOCKETCAN, packets))
    for spec, message, node, t_us, count in plan:
        group = [next(seen) for _ in range(count)]
        assert {s.number("type") for s in group} == {spec.type_id}
        assert {s.number("node") for s in group} == {node}
        if spec.is_bare:
            assert [s.experts for s in group] == [set()]
        elif is_native(spec):
            check_native(group, spec, message, t_us)
        else:
            check_transfer(group, spec, message, t_us)
    assert next(seen, None) is None


def check_native(group: list[Seen], spec: MessageSpec, message: Message, t_us: int) -> None:
    parts = sorted({f.can_part for f in spec.fields})
    assert len(group) == len(parts)
    in_order = sorted(group, key=lambda s: int(s.get("can.part") or 0))
    for part, seen in zip(parts, in_order, strict=True):
        if spec.full_stamp:
            assert (seen.number("t_us"), seen.get("t16")) == (t_us, None)
        else:
            assert seen.number("t16") == t_us >> 4 & 0xFFFF
        assert seen.get("can.part") == (str(part) if len(parts) > 1 else None)
        assert seen.experts <= {"out_of_range"}
        for field, value in zip(spec.fields, message, strict=True):
            if field.can_part != part:
                assert seen.get(f"{spec.name}.{field.name}") is None
            elif spec.name != "sync":  # the link itself writes the count of sync
                assert_field(seen, spec, field, value)


def check_transfer(group: list[Seen], spec: MessageSpec, message: Message, t_us: int) -> None:
    *before, last = group
    kinds = ["first"] + ["middle"] * (len(before) - 1) + ["last"] if before else ["single"]
    assert [s.get("can.segment") for s in group] == kinds
    assert all(s.get("direction") is None for s in before)
    assert [s.number("can.toggle") for s in group] == [(i + 1) % 2 for i in range(len(group))]
    if before:
        assert last.number("begun") == group[0].packet
    if last.number("flags.full_stamp"):
        assert last.number("t_us") == t_us
    else:
        assert last.number("t16") == t_us >> 4 & 0xFFFF
    assert_message(last, spec, message)


def test_a_tag_is_shown_with_counter_and_sender(dissect: Dissect) -> None:
    link = CanLink(Direction.HOST)
    link.key = Authenticator(bytes(range(16)))
    link.key.begin(1, 2, 0x0012_3456)
    link.send(VelocitySetpoint(2000, 0, 200, 1), 0, node=4)
    data = link.data_to_send()
    records = [from_record(data[at : at + 16]) for at in range(0, len(data), 16)]
    frames = [record for record in records if record is not None]
    setpoint, tag = dissect(SOCKETCAN, can_packets(frames))
    assert setpoint.number("velocity_setpoint.v.raw") == 2000
    assert (tag.number("type"), tag.number("node")) == (0x0F, 4)
    assert tag.number("auth.counter") == 0x3457
    assert (tag.get("auth.tag") or "").replace(":", "") == frames[1].data[2:].hex()
    assert tag.experts == set()
    (short,) = dissect(SOCKETCAN, [Packet(socketcan(0x0F4, bytes(7)))])
    assert (short.get("damage"), short.experts) == ("length", {"bad_length"})


def test_sync_shows_the_count_of_frames(dissect: Dissect) -> None:
    data = (0x12345678).to_bytes(4, "little") + (70000).to_bytes(4, "little")
    (seen,) = dissect(SOCKETCAN, [Packet(socketcan(0x101, data))])
    assert (seen.number("t_us"), seen.number("sync.frame_count")) == (0x12345678, 70000)


def test_a_second_pass_shows_the_same_of_can(tshark: Tshark, tmp_path: Path) -> None:
    frames = hello_segments()
    write_pcap(tmp_path / "can.pcap", SOCKETCAN, can_packets([*frames, *frames[1:]]))
    once, twice = (tshark.dissect(tmp_path / "can.pcap", *extra) for extra in ((), ("-2",)))
    assert once == twice
    assert [s.get("damage") for s in once].count("order") == len(frames) - 1


def hello_segments(node: int = 1) -> list[CanFrame]:
    spec = CATALOGUE.by_name["hello"]
    message = random_message(spec, random.Random(9))
    return sent_over_can(message, Direction.DEVICE, node, 123)


def test_a_duplicate_segment_does_no_harm(dissect: Dissect) -> None:
    frames = hello_segments()
    frames.insert(2, frames[1])
    seen = dissect(SOCKETCAN, can_packets(frames))
    assert [s.get("can.segment") for s in seen[:4]] == ["first", "middle", "double", "middle"]
    assert seen[-1].get("direction") == "device to host"
    assert not any(s.experts - {"out_of_range"} for s in seen)


@pytest.mark.parametrize("gone", [0, 1, 2, 4])
def test_a_lost_segment_is_reported_and_gives_no_message(gone: int, dissect: Dissect) -> None:
    frames = hello_segments()
    del frames[gone]
    seen = dissect(SOCKETCAN, can_packets(frames))
    assert any(s.get("damage") == "order" and "bad_order" in s.experts for s in seen)
    assert all(s.get("direction") is None for s in seen)


def test_an_even_number_of_lost_segments_fails_the_check(
    dissect: Dissect,
) -> None:
    frames = hello_segments()
    del frames[1:3]
    *_, last = dissect(SOCKETCAN, can_packets(frames))
    assert (last.get("damage"), last.experts) == ("crc", {"bad_crc"})
    assert last.get("direction") is None


def piece(tail: int, content: bytes = b"1234567", t_us: int = 0) -> Packet:
    """Return one segment of a hello with the given tail byte."""
    return Packet(socketcan(0x1B1, content + bytes([tail])), t_us)


@pytest.mark.parametrize(
    ("packets", "kinds", "damage"),
    [
        # (tail bytes: 0x80 start, 0x40 end, 0x20 toggle)
        ([piece(0x83)], ["first"], "order"),
        ([piece(0xC3)], ["single"], "order"),
        ([piece(0xA3), piece(0x04)], ["first", "middle"], "order"),
        ([piece(0xA3), piece(0x23)], ["first", "middle"], "order"),
        ([piece(0xA3), piece(0x03, b"")], ["first", "middle"], "order"),
        ([piece(0x43)], ["last"], "order"),
        ([piece(0xA3), piece(0x43, b"x")], ["first", "last"], "length"),
        ([piece(0xA3), piece(0x43)], ["first", "last"], "crc"),
        ([piece(0xA3, b"123"), piece(0x43, b"4567")], ["first", "last"], "length"),
        ([piece(0xA3), piece(0x03, t_us=999_000)], ["first", "middle"], None),
        ([piece(0xA3), piece(0x03, t_us=1_001_000)], ["first", "middle"], "order"),
        ([piece(0xA3), piece(0xA3, t_us=499_000)], ["first", "double"], None),
        ([piece(0xA3), piece(0xA3, t_us=501_000)], ["first", "first"], None),
        ([piece(0xE3, b"")], ["single"], "order"),
        ([piece(0xE3, b"\x18123")], ["single"], "length"),
        ([piece(0xE3, b"\x10")], ["single"], "length"),
    ],
)
def test_segments_are_checked_one_by_one(
    packets: list[Packet], kinds: list[str], damage: str | None, dissect: Dissect
) -> None:
    seen = dissect(SOCKETCAN, packets)
    assert [s.get("can.segment") for s in seen] == kinds
    assert seen[-1].get("damage") == damage
    assert all(s.get("damage") is None for s in seen[:-1])


def test_a_transfer_without_end_is_given_up(dissect: Dissect) -> None:
    toggles = [(i + 1) % 2 for i in range(37)]
    tails = [(0x80 if i == 0 else 0) | 0x20 * toggle for i, toggle in enumerate(toggles)]
    seen = dissect(SOCKETCAN, [piece(t, bytes([i] * 7), i) for i, t in enumerate(tails)])
    assert [s.get("damage") for s in seen] == [None] * 36 + ["order"]


def test_a_transfer_of_another_version_is_not_read(dissect: Dissect) -> None:
    ack = b"\x01\x02\x00"
    (seen,) = dissect(SOCKETCAN, [Packet(socketcan(0x191, b"\x30\0\0" + ack + b"\xe0"))])
    assert (seen.get("version"), seen.get("payload")) == ("3", "01:02:00")
    assert (seen.get("ack.command_id"), seen.experts) == (None, {"other_version"})


def test_other_frames_of_a_bus_are_left_alone(dissect: Dissect) -> None:
    packets = [
        Packet(socketcan(0x7F1, bytes(8))),
        Packet(socketcan(0x131, bytes(8), extended=True)),
        Packet(socketcan(0x131, bytes(8))),
    ]
    assert [s.packet for s in dissect(SOCKETCAN, packets)] == [3]


def test_can_garbage_never_upsets_it(dissect: Dissect) -> None:
    rng = random.Random(10)
    packets = [
        Packet(socketcan(rng.randrange(0x400), rng.randbytes(rng.randrange(9))), i * 100)
        for i in range(1500)
    ]
    packets += [Packet(rng.randbytes(rng.randrange(20))) for _ in range(100)]
    seen = dissect(SOCKETCAN, packets)
    assert len(seen) > 500
    assert any("bad_order" in s.experts for s in seen)
    assert any("payload_length" in s.experts for s in seen)
    assert any("bad_length" in s.experts for s in seen)
