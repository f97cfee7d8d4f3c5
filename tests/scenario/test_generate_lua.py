"""The Wireshark dissector, by what tshark makes of captures."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from protocol.can_frames import CAN_FULL_STAMP, can_type, from_record, is_native
from protocol.can_link import CanLink
from protocol.catalogue import CATALOGUE
from protocol.codec import Codec
from protocol.generate import render
from protocol.link import Link
from protocol.message import Direction
from protocol.uart import encode_frame
from support import reference_codec as ref
from support.captures import (
    SOCKETCAN,
    USER0,
    USER1,
    Packet,
    Seen,
    Tshark,
    line_of_log,
    socketcan,
    write_pcap,
    write_pcapng,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.can_frames import CanFrame
    from protocol.fields import Field
    from protocol.message import Message, MessageSpec

    Dissect = Callable[[int, list[Packet]], list[Seen]]

Vector = dict[str, Any]
VECTORS = Path(__file__).parent.parent / "vectors"
PER_MESSAGE = 12
DAMAGE_FINDING = {"cobs": "bad_cobs", "length": "bad_length", "crc": "bad_crc"}
SENDER = {Direction.DEVICE: "device to host", Direction.HOST: "host to device"}


def load(name: str) -> list[Vector]:
    vectors: list[Vector] = json.loads((VECTORS / f"{name}.json").read_text(encoding="utf-8"))
    return vectors


@pytest.fixture(scope="module")
def tshark(tmp_path_factory: pytest.TempPathFactory) -> Tshark:
    folder = tmp_path_factory.mktemp("wireshark")
    (text,) = render("lua").values()
    script = folder / "sweepctl.lua"
    script.write_text(text, encoding="utf-8")
    return Tshark(script, folder / "settings")


@pytest.fixture
def dissect(tshark: Tshark, tmp_path: Path) -> Dissect:
    def through(link_type: int, packets: list[Packet]) -> list[Seen]:
        write_pcap(tmp_path / "made.pcap", link_type, packets)
        return tshark.dissect(tmp_path / "made.pcap")

    return through


# ---- what a frame should show -----------------------------------------------------------


def random_value(field: Field, rng: random.Random) -> object:
    wire = field.wire
    if wire.is_text:
        return "".join(rng.choice("aZ09 ,.±°é漢🤖") for _ in range(rng.randrange(20)))
    if not wire.is_integer:
        return rng.randbytes(wire.size)
    edges = [wire.low, wire.high, field.low, field.high, 0, field.none or 0]
    return rng.choice([*edges, *(rng.randint(wire.low, wire.high) for _ in range(6))])


def random_message(spec: MessageSpec, rng: random.Random) -> Message:
    return spec.cls(*(random_value(f, rng) for f in spec.fields))


def random_messages(seed: int) -> list[tuple[MessageSpec, Message]]:
    rng = random.Random(seed)
    made = [(s, random_message(s, rng)) for s in CATALOGUE for _ in range(PER_MESSAGE)]
    rng.shuffle(made)
    return made


def assert_field(seen: Seen, spec: MessageSpec, field: Field, value: object) -> None:
    """One field of the payload, as a filter finds it and as a person reads it."""
    name = f"{spec.name}.{field.name}"
    if isinstance(value, str):
        assert (seen.get(name) or "") == value
    elif isinstance(value, bytes):
        assert bytes.fromhex((seen.get(name) or "").replace(":", "")) == value
    else:
        assert isinstance(value, int)
        assert_number(seen, name, field, value)
        odd = value != field.none and not field.low <= value <= field.high
        assert not odd or "out_of_range" in seen.experts


def assert_number(seen: Seen, name: str, field: Field, value: int) -> None:
    if field.si_suffix is None:
        assert seen.number(name) == value
        if field.unit == "enum" and field.enum is not None:
            known = {int(v): v.name.lower() for v in field.enum}
            assert seen.text_of(name) == f"{field.name}: {known.get(value, 'Unknown')} ({value})"
        elif field.unit == "bits":
            for bit in field.enum or ():
                assert seen.number(f"{name}.{(bit.name or '').lower()}") == int(bool(value & bit))
        return
    assert seen.number(f"{name}.raw") == value
    shown = seen.get(name)
    if value == field.none:
        assert shown is None
        assert seen.text_of(f"{name}.raw") == f"{field.name}: none (raw {value})"
    else:
        assert shown is not None
        exact = value * field.scale + field.offset
        assert float(shown) == pytest.approx(float(exact), rel=1e-12, abs=1e-12)
        assert seen.text_of(name).startswith(f"{field.name}: ")
        assert seen.text_of(name).endswith(f" {field.unit}")


def assert_message(seen: Seen, spec: MessageSpec, message: Message) -> None:
    assert seen.number("type") == spec.type_id
    assert seen.get("direction") == SENDER[spec.direction]
    assert seen.get("damage") is None
    assert seen.experts <= {"out_of_range"}
    for field, value in zip(spec.fields, message, strict=True):
        assert_field(seen, spec, field, value)


# ---- serial line ------------------------------------------------------------------------


def test_intact_vectors_show_every_field(dissect: Dissect) -> None:
    vectors = load("messages") + load("edges")
    packets = [Packet(bytes.fromhex(v["hex"]).strip(b"\0")) for v in vectors]
    seen = dissect(USER0, packets)
    assert len(seen) == len(vectors)
    for vector, frame in zip(vectors, seen, strict=True):
        assert {k: frame.number(k) for k in vector["header"]} == vector["header"], vector["name"]
        assert frame.number("flags.authenticated") == vector["header"]["flags"] & 1
        assert frame.number("flags.retry") == vector["header"]["flags"] >> 1 & 1
        assert frame.get("damage") is None
        check_vector_values(vector, frame)


def check_vector_values(vector: Vector, frame: Seen) -> None:
    """Hold a frame against the vector's own numbers: nothing of the catalogue is used."""
    message = vector["message"]
    for name, raw in vector["raw"].items():
        shown = frame.get(f"{message}.{name}.raw") or frame.get(f"{message}.{name}")
        if isinstance(raw, int):
            assert shown is not None
            assert int(shown, 0) == raw, (vector["name"], name)
        elif name == "uid":
            assert (shown or "").replace(":", "") == raw
        elif "\0" not in raw:  # a display string ends there
            assert (shown or "") == raw, (vector["name"], name)
    for name, value in vector["si"].items():
        field = max((f for f in vector["raw"] if name.startswith(f)), key=len)
        shown = frame.get(f"{message}.{field}")
        if value is None:
            assert shown is None
        else:
            assert shown is not None
            turned = frame.text_of(f"{message}.{field}").endswith("deg/s")
            number = math.radians(float(shown)) if turned else float(shown)
            assert number == pytest.approx(value, rel=1e-9), (vector["name"], name)


def test_random_messages_show_every_field(dissect: Dissect) -> None:
    made = random_messages(seed=1)
    rng = random.Random(2)
    heads, packets = [], []
    for spec, message in made:
        head = (rng.randrange(16), spec.type_id, rng.randrange(256), rng.randrange(1 << 32))
        flags = rng.randrange(16)
        _, payload = Codec().encode(message)
        packets.append(Packet(encode_frame(*head, payload, flags)[:-1]))
        heads.append((*head, flags))
    seen = dissect(USER0, packets)
    assert len(seen) == len(made) == PER_MESSAGE * len(CATALOGUE.specs)
    for (spec, message), head, frame in zip(made, heads, seen, strict=True):
        shown = tuple(frame.number(k) for k in ("node", "type", "seq", "t_us", "flags"))
        assert shown == head
        assert frame.get("version") == "1"
        assert_message(frame, spec, message)


def test_damaged_vectors_are_marked(dissect: Dissect) -> None:
    vectors = load("damaged")
    seen = dissect(USER1, [Packet(bytes.fromhex(v["hex"])) for v in vectors])
    assert len(seen) == len(vectors)
    for vector, frame in zip(vectors, seen, strict=True):
        if "damage" in vector:
            assert frame.get("damage") == vector["damage"], vector["name"]
            assert frame.experts == {DAMAGE_FINDING[vector["damage"]]}
            assert frame.get("type") is None
            continue
        assert frame.get("damage") is None
        wanted = {"version": "other_version", "type": "unknown_type", "payload": "payload_length"}
        finding = wanted.get(vector["rejected"])  # a direction is right or wrong for a receiver
        assert frame.experts == ({finding} if finding else set()), vector["name"]


def test_damage_is_found_by_a_display_filter(tshark: Tshark, tmp_path: Path) -> None:
    good = encode_frame(1, 0x13, 0, 0, bytes(4))[:-1]
    bad = good[:-1] + bytes([good[-1] ^ 1])
    write_pcap(tmp_path / "x.pcap", USER0, [Packet(good), Packet(bad), Packet(good)])
    out = tshark.run(
        tmp_path / "x.pcap", "-Y", "sweepctl.damage", "-T", "fields",
        "-e", "frame.number", "-e", "sweepctl.damage", "-e", "_ws.expert.severity",
    )  # fmt: skip
    assert out.split() == ["2", "crc", str(0x00800000)]
    values = tshark.run(
        tmp_path / "x.pcap", "-Y", "sweepctl.encoders.left == 0", "-T", "json"
    )
    assert [p["_source"]["layers"]["sweepctl"]["sweepctl.seq"] for p in json.loads(values)] == [
        "0",
        "0",
    ]


@pytest.mark.parametrize("step", [1, 5, 10_000])
def test_stream_vectors_give_their_events(step: int, tshark: Tshark, tmp_path: Path) -> None:
    vectors = load("streams")
    packets = []
    for interface, vector in enumerate(vectors):
        data = bytes.fromhex(vector["hex"])
        packets += [
            Packet(data[at : at + step], at, interface) for at in range(0, len(data), step)
        ]
    write_pcapng(tmp_path / "streams.pcapng", [USER1] * len(vectors), packets)
    got: list[list[dict[str, object]]] = [[] for _ in vectors]
    for seen in tshark.dissect(tmp_path / "streams.pcapng"):
        damage = seen.get("damage")
        frame = None if damage else {"type": seen.number("type"), "seq": seen.number("seq")}
        got[packets[seen.packet - 1].interface].append({"damage": damage, "frame": frame})
    assert got == [
        [{"damage": e.get("damage"), "frame": e.get("frame")} for e in v["events"]]
        for v in vectors
    ]


def test_lines_of_two_interfaces_are_kept_apart(tshark: Tshark, tmp_path: Path) -> None:
    frames = [encode_frame(1, 0x13, seq, 0, bytes(4)) for seq in range(2)]
    halves = [
        Packet(frames[0][:9], 0, 0),
        Packet(frames[1][:9], 1, 1),
        Packet(frames[0][9:], 2, 0),
        Packet(frames[1][9:], 3, 1),
    ]
    write_pcapng(tmp_path / "two.pcapng", [USER1, USER1], halves)
    seen = tshark.dissect(tmp_path / "two.pcapng")
    assert [(s.packet, s.number("seq"), s.number("begun")) for s in seen] == [(3, 0, 1), (4, 1, 2)]
    assert seen == tshark.dissect(tmp_path / "two.pcapng", "-2")  # a second pass shows the same


def test_a_packet_cut_by_the_capture_is_marked(dissect: Dissect) -> None:
    wire = encode_frame(1, 0x13, 0, 0, bytes(4))[:-1]
    (seen,) = dissect(USER0, [Packet(wire, cut=3)])
    assert (seen.get("damage"), seen.experts) == ("cut", {"cut"})


def test_peers_with_fewer_and_more_fields_show_what_they_share(
    dissect: Dissect,
) -> None:
    older, newer, bare = (
        encode_frame(1, 0x13, 0, 0, payload)[:-1] for payload in (b"\1\2", b"\1\2\3\4\5\6", b"")
    )
    less, more, none = dissect(USER0, [Packet(older), Packet(newer), Packet(bare)])
    assert (less.number("encoders.left"), less.get("encoders.right")) == (0x0201, None)
    assert (more.number("encoders.right"), more.get("undeclared")) == (0x0403, "05:06")
    assert none.get("encoders.left") is None
    assert less.experts == more.experts == none.experts == {"payload_length"}


def test_garbage_never_upsets_it(tshark: Tshark, tmp_path: Path) -> None:
    rng = random.Random(3)
    frames = [encode_frame(1, t, 0, 0, rng.randbytes(12)) for t in CATALOGUE.by_type]
    garbage = []
    for _ in range(400):
        data = bytearray(rng.choice(frames) if rng.random() < 0.7 else rng.randbytes(300))
        for _ in range(rng.randrange(4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        whole = rng.random() < 0.5
        cut = slice(None) if whole else slice(rng.randrange(2), rng.randrange(2, len(data)))
        garbage.append(Packet(bytes(data[cut])))
    garbage += [Packet(bytes(n)) for n in range(4)]
    for link_type in (USER0, USER1):
        write_pcap(tmp_path / "noise.pcap", link_type, garbage)
        seen = tshark.dissect(tmp_path / "noise.pcap")
        assert sum(s.get("damage") is not None for s in seen) > 100
        intact = [s for s in seen if s.get("damage") is None and s.get("crc") is not None]
        assert 0 < len(intact) < len(seen)


def test_any_frame_with_a_check_that_holds_is_dissected(dissect: Dissect) -> None:
    # Payloads of every length under every type, the unknown too: no length reads past the end.
    rng = random.Random(4)
    packets = [
        Packet(encode_frame(rng.randrange(16), type_id, 0, 0, rng.randbytes(size))[:-1])
        for type_id in range(0x7F)
        for size in {0, 1, rng.randrange(60), rng.randrange(242)}
    ]
    seen = dissect(USER0, packets)
    assert [s.get("damage") for s in seen] == [None] * len(packets)
    known = [s for s in seen if s.number("type") in CATALOGUE.by_type]
    assert all("unknown_type" not in s.experts for s in known)
    assert all("unknown_type" in s.experts for s in seen if s not in known)


def test_a_run_s_log_shows_the_frames_that_went_over_its_line(
    tshark: Tshark, tmp_path: Path
) -> None:
    rng = random.Random(5)
    path = tmp_path / "run.mcap"
    counts = record_line(path, rng)
    write_pcapng(tmp_path / "run.pcapng", [USER1, USER1], line_of_log(path))
    seen = tshark.dissect(tmp_path / "run.pcapng")
    assert [s for s in seen if s.get("damage")] == []
    by_direction = [s.get("direction") for s in seen]
    assert (by_direction.count("device to host"), by_direction.count("host to device")) == counts
    packets = line_of_log(path)
    assert {(packets[s.packet - 1].interface, s.get("direction")) for s in seen} == {
        (0, "device to host"),
        (1, "host to device"),
    }


def record_line(path: Path, rng: random.Random) -> tuple[int, int]:
    """Log some traffic in reads that end anywhere; gives the messages of both directions."""
    from bridge.record.writer import RunWriter  # noqa: PLC0415 - slow to load, for one test
    from bridge.telemetry import RawBytes  # noqa: PLC0415
    from support.synthetic_run import EPOCH_NS, run_info, summary  # noqa: PLC0415

    writer = RunWriter(path, run_info())
    counts = []
    for direction in (Direction.DEVICE, Direction.HOST):
        link = Link(direction)
        made = [m for s, m in random_messages(6) if s.direction is direction]
        for message in made:
            link.send(message, 0, node=1)
        data, at = link.data_to_send(), 0
        while at < len(data):
            size = rng.randrange(1, 60)
            outgoing = direction is Direction.HOST
            writer.write(RawBytes(EPOCH_NS + at * 1000, outgoing, data[at : at + size]))
            at += size
        counts.append(len(made))
    writer.close(summary())
    return counts[0], counts[1]


# ---- CAN --------------------------------------------------------------------------------


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
    for i, (spec, message) in enumerate(made):
        node, t_us = rng.randrange(1, 16), rng.randrange(1 << 32)
        frames = sent_over_can(message, spec.direction, node, t_us)
        packets += can_packets(frames, i * 2_000_000)  # apart: equal frames are no doubles
        plan.append((spec, message, node, t_us, len(frames)))
    seen = iter(dissect(SOCKETCAN, packets))
    for spec, message, node, t_us, count in plan:
        group = [next(seen) for _ in range(count)]
        assert {s.number("type") for s in group} == {spec.type_id}
        assert {s.number("node") for s in group} == {node}
        if is_native(spec):
            check_native(group, spec, message, t_us)
        else:
            check_transfer(group, spec, message, t_us)
    assert next(seen, None) is None


def check_native(group: list[Seen], spec: MessageSpec, message: Message, t_us: int) -> None:
    parts = sorted({f.can_part for f in spec.fields})
    assert len(group) == len(parts)
    in_order = sorted(group, key=lambda s: int(s.get("can.part") or 0))
    for part, seen in zip(parts, in_order, strict=True):
        if can_type(spec.type_id, part) in CAN_FULL_STAMP:
            assert (seen.number("t_us"), seen.get("t16")) == (t_us, None)
        else:
            assert seen.number("t16") == t_us >> 4 & 0xFFFF
        assert seen.get("can.part") == (str(part) if len(parts) > 1 else None)
        assert seen.experts <= {"out_of_range"}
        for field, value in zip(spec.fields, message, strict=True):
            if field.can_part != part:
                assert seen.get(f"{spec.name}.{field.name}") is None
            elif spec.name != "sync":  # the link writes its own count
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


def test_sync_shows_the_count_of_frames(dissect: Dissect) -> None:
    data = (0x12345678).to_bytes(4, "little") + (70000).to_bytes(4, "little")
    (seen,) = dissect(SOCKETCAN, [Packet(socketcan(0x101, data))])
    assert (seen.number("t_us"), seen.number("sync.frame_count")) == (0x12345678, 70000)


def hello_segments(node: int = 1) -> list[CanFrame]:
    spec = CATALOGUE.by_name["hello"]
    message = random_message(spec, random.Random(9))
    return sent_over_can(message, Direction.DEVICE, node, 123)


def test_a_doubled_segment_does_no_harm(dissect: Dissect) -> None:
    frames = hello_segments()
    frames.insert(2, frames[1])
    seen = dissect(SOCKETCAN, can_packets(frames))
    assert [s.get("can.segment") for s in seen[:4]] == ["first", "middle", "double", "middle"]
    assert seen[-1].get("direction") == "device to host"
    assert not any(s.experts - {"out_of_range"} for s in seen)


@pytest.mark.parametrize("gone", [0, 1, 2, 4])
def test_a_lost_segment_is_told_and_gives_no_message(
    gone: int, dissect: Dissect
) -> None:
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


def test_other_frames_of_a_bus_are_left_alone(dissect: Dissect) -> None:
    packets = [
        Packet(socketcan(0x7F1, bytes(8))),
        Packet(socketcan(0x121, bytes(8), extended=True)),
        Packet(socketcan(0x121, bytes(8))),
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
