"""The Wireshark dissector for the serial line, tested by tshark's output for captures."""

from __future__ import annotations

import json
import math
import random
from typing import TYPE_CHECKING, Any

import pytest

from protocol.authentication import Authenticator
from protocol.messages.host import VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.framing import encode_frame
from protocol.uart.link import Link
from support import reference_codec as ref
from support.captures import (
    USER0,
    USER1,
    Packet,
    Seen,
    Tshark,
    line_of_log,
    write_pcap,
    write_pcapng,
)
from support.dissected import PER_MESSAGE, assert_message, random_messages
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Dissect = Callable[[int, list[Packet]], list[Seen]]

pytestmark = [pytest.mark.slow, pytest.mark.needs("tshark")]

Vector = dict[str, Any]
VECTORS = ROOT / "tests" / "vectors"
DAMAGE_FINDING = {"cobs": "bad_cobs", "length": "bad_length", "crc": "bad_crc"}


def load(name: str) -> list[Vector]:
    vectors: list[Vector] = json.loads((VECTORS / f"{name}.json").read_text(encoding="utf-8"))
    return vectors


@pytest.fixture(scope="module")
def tshark(tmp_path_factory: pytest.TempPathFactory) -> Tshark:
    return Tshark(tmp_path_factory.mktemp("wireshark"))


@pytest.fixture
def dissect(tshark: Tshark) -> Dissect:
    return tshark.dissect_packets


def test_intact_vectors_show_every_field(dissect: Dissect) -> None:
    vectors = load("messages") + load("edges")
    packets = [Packet(bytes.fromhex(v["hex"]).strip(b"\0")) for v in vectors]
    seen = dissect(USER0, packets)
    assert len(seen) == len(vectors)
    for vector, frame in zip(vectors, seen, strict=True):
        assert {k: frame.number(k) for k in vector["header"]} == vector["header"], vector["name"]
        assert frame.number("flags.authenticated") == vector["header"]["flags"] & 1
        assert frame.get("damage") is None
        check_vector_values(vector, frame)


def check_vector_values(vector: Vector, frame: Seen) -> None:
    """Compare a frame with the numbers in the vector, without the catalogue."""
    message = vector["message"]
    for name, raw in vector["raw"].items():
        shown = frame.get(f"{message}.{name}.raw") or frame.get(f"{message}.{name}")
        if isinstance(raw, int):
            assert shown is not None
            assert int(shown, 0) == raw, (vector["name"], name)
        elif name == "uid":
            assert (shown or "").replace(":", "") == raw
        elif "\0" not in raw:  # a NUL ends a displayed string
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
    heads, packets, trailers = [], [], []
    for spec, message in made:
        head = (rng.randrange(16), spec.type_id, rng.randrange(256), rng.randrange(1 << 32))
        flags = rng.randrange(16)
        _, payload = Codec().encode(message)
        trailer = rng.randbytes(12) if flags & 1 else b""
        packets.append(Packet(encode_frame(*head, payload + trailer, flags)[:-1]))
        heads.append((*head, flags))
        trailers.append(trailer)
    seen = dissect(USER0, packets)
    assert len(seen) == len(made) == PER_MESSAGE * len(CATALOGUE.specs)
    for (spec, message), wanted, trailer, frame in zip(made, heads, trailers, seen, strict=True):
        shown = tuple(frame.number(k) for k in ("node", "type", "seq", "t_us", "flags"))
        assert shown == wanted
        assert frame.get("version") == "2"
        counter = frame.get("auth.counter")
        assert (counter is None) == (trailer == b"")
        if counter is not None:
            assert int(counter) == int.from_bytes(trailer[:4], "little")
            assert (frame.get("auth.tag") or "").replace(":", "") == trailer[4:].hex()
        assert_message(frame, spec, message)


def test_a_signed_setpoint_shows_its_counter_and_tag(dissect: Dissect) -> None:
    link = Link(Direction.HOST)
    link.key = Authenticator(bytes(range(16)))
    link.key.begin(1, 2, 0xFFFF_FFFF)
    link.send(VelocitySetpoint(2000, -3000, 200, 7), 5, node=1)
    wire = link.data_to_send().strip(b"\0")
    frame, bare = dissect(USER0, [Packet(wire), Packet(encode_frame(1, 2, 0, 0, bytes(6), 1)[:-1])])
    assert frame.number("flags.authenticated") == 1
    assert frame.number("velocity_setpoint.v.raw") == 2000
    assert frame.number("auth.counter") == 0  # the challenge's was the largest 32-bit value
    assert len((frame.get("auth.tag") or "").replace(":", "")) == 16
    assert (frame.get("undeclared"), frame.experts) == (None, set())
    # The dissector reports a frame that is marked as signed but has no tag.
    assert (bare.get("auth.tag"), bare.experts) == (None, {"no_tag"})


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
    good = encode_frame(1, 0x16, 0, 0, bytes(4))[:-1]
    bad = good[:-1] + bytes([good[-1] ^ 1])
    write_pcap(tmp_path / "x.pcap", USER0, [Packet(good), Packet(bad), Packet(good)])
    out = tshark.run(
        tmp_path / "x.pcap", "-Y", "sweepctl.damage", "-T", "fields",
        "-e", "frame.number", "-e", "sweepctl.damage", "-e", "_ws.expert.severity",
    )  # fmt: skip
    assert out.split() == ["2", "crc", str(0x00800000)]
    values = tshark.run(tmp_path / "x.pcap", "-Y", "sweepctl.encoders.left == 0", "-T", "json")
    assert [p["_source"]["layers"]["sweepctl"]["sweepctl.seq"] for p in json.loads(values)] == [
        "0",
        "0",
    ]


def ended(event: ref.RefFrame | ref.RefDamage) -> dict[str, object]:
    if isinstance(event, ref.RefDamage):
        return {"damage": event.damage, "frame": None}
    return {"damage": None, "frame": {"type": event.type_id, "seq": event.seq}}


def read(seen: Seen) -> dict[str, object]:
    damage = seen.get("damage")
    frame = None if damage else {"type": seen.number("type"), "seq": seen.number("seq")}
    return {"damage": damage, "frame": frame}


@pytest.mark.parametrize("step", [1, 5, 10_000])
def test_stream_vectors_give_their_events(step: int, dissect: Dissect) -> None:
    packets, wanted = [], []
    for vector in load("streams"):
        # A delimiter after each, so that an unfinished frame ends before the next.
        data = bytes.fromhex(vector["hex"])
        wanted += [{"damage": e.get("damage"), "frame": e.get("frame")} for e in vector["events"]]
        wanted += [ended(e) for e in ref.parse_stream(data[data.rfind(b"\0") + 1 :] + b"\0")]
        data += b"\0"
        packets += [Packet(data[at : at + step]) for at in range(0, len(data), step)]
    assert [read(seen) for seen in dissect(USER1, packets)] == wanted


def test_both_directions_of_a_line_are_kept_apart(tshark: Tshark, tmp_path: Path) -> None:
    frames = [encode_frame(1, 0x16, seq, 0, bytes(4)) for seq in range(3)]
    halves = [
        Packet(frames[0], 0, 1),
        Packet(frames[1][:9], 1, 1),
        Packet(frames[2][:9], 2, 2),
        Packet(frames[1][9:], 3, 1),
        Packet(frames[2][9:], 4, 2),
    ]
    write_pcapng(tmp_path / "two.pcapng", USER1, halves)
    seen = tshark.dissect(tmp_path / "two.pcapng")
    reported = [(s.packet, s.number("seq"), s.get("begun")) for s in seen]
    assert reported == [(1, 0, None), (4, 1, "2"), (5, 2, "3")]
    assert seen == tshark.dissect(tmp_path / "two.pcapng", "-2")  # a window shows the same


def test_a_packet_cut_by_the_capture_is_marked(dissect: Dissect) -> None:
    wire = encode_frame(1, 0x16, 0, 0, bytes(4))[:-1]
    (seen,) = dissect(USER0, [Packet(wire, cut=3)])
    assert (seen.get("damage"), seen.experts) == ("cut", {"cut"})


def test_peers_with_fewer_and_more_fields_use_the_shared_ones(
    dissect: Dissect,
) -> None:
    older, newer, bare = (
        encode_frame(1, 0x16, 0, 0, payload)[:-1] for payload in (b"\1\2", b"\1\2\3\4\5\6", b"")
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
    garbage += [Packet(bytes(n)) for n in range(1, 4)]
    write_pcap(tmp_path / "noise.pcap", USER1, garbage)
    seen = tshark.dissect(tmp_path / "noise.pcap")
    expected = [ended(e) for e in ref.parse_stream(b"".join(p.data for p in garbage) + b"\0")]
    assert [read(s) for s in seen] == expected
    assert {str(e["damage"]) for e in expected} == {"cobs", "length", "crc", "None"}
    write_pcap(tmp_path / "noise.pcap", USER0, garbage)
    seen = tshark.dissect(tmp_path / "noise.pcap")
    assert len(seen) == len(garbage)
    assert 100 < sum(s.get("damage") is not None for s in seen) < len(seen)


def test_any_frame_with_a_check_that_holds_is_dissected(dissect: Dissect) -> None:
    # Payloads of every length under every type, unknown types included: no read passes the end.
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
    write_pcapng(tmp_path / "run.pcapng", USER1, line_of_log(path))
    seen = tshark.dissect(tmp_path / "run.pcapng")
    assert [s for s in seen if s.get("damage")] == []
    by_direction = [s.get("direction") for s in seen]
    assert (by_direction.count("device to host"), by_direction.count("host to device")) == counts
    packets = line_of_log(path)
    assert {(packets[s.packet - 1].direction, s.get("direction")) for s in seen} == {
        (1, "device to host"),
        (2, "host to device"),
    }


def record_line(path: Path, rng: random.Random) -> tuple[int, int]:
    """Log some traffic in reads that end anywhere.

    Return the number of messages in each direction.
    """
    from bridge.record.log_writer import RunWriter  # noqa: PLC0415 - slow to load, for one test
    from bridge.session.records import RawBytes  # noqa: PLC0415
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
