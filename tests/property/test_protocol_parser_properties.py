"""The stream parser and the link, with any bytes in any split."""

from __future__ import annotations

import tracemalloc
from random import Random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocol.link import LinkEvent, Received, Rejected
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame, Frame, UartParser
from protocol.uart.link import Link
from support import reference_codec as ref
from support import strategies as wire
from support.hostile import (
    BitFlips,
    Burst,
    Chunked,
    CutTail,
    Duplicating,
    Garbage,
    Lossy,
    Pipe,
    Wire,
)

pytestmark = pytest.mark.slow

LONGEST_KEPT = 254


def as_reference(events: list[Frame | DamagedFrame]) -> list[object]:
    """Return events without a frame's offset, which the parser does not report."""
    return [
        (e.version, e.flags, e.node, e.type_id, e.seq, e.t_us, e.payload)
        if isinstance(e, Frame)
        else (e.damage.value, e.offset, e.length)
        for e in events
    ]


def from_reference(events: list[ref.RefFrame | ref.RefDamage]) -> list[object]:
    return [
        (e.version, e.flags, e.node, e.type_id, e.seq, e.t_us, e.payload)
        if isinstance(e, ref.RefFrame)
        else (e.damage, e.offset, e.length)
        for e in events
    ]


@given(wire.streams)
@example(b"\0" + b"\x11" * 254 + b"\0")
@example(b"\0" + b"\xff" + b"\x11" * 254 + b"\0")
def test_the_parser_equals_the_reference_scan(stream: bytes) -> None:
    parser = UartParser()
    events = parser.feed(stream)
    assert as_reference(events) == from_reference(ref.parse_stream(stream))
    assert parser.bytes_seen == len(stream)
    assert parser.frames == sum(isinstance(e, Frame) for e in events)
    assert parser.damaged == sum(isinstance(e, DamagedFrame) for e in events)
    for event in events:
        if isinstance(event, DamagedFrame):
            kept = min(event.length, LONGEST_KEPT)
            assert event.data == stream[event.offset : event.offset + kept]


@given(wire.streams, st.lists(st.integers(0, 5000), max_size=30))
def test_events_are_the_same_however_the_bytes_are_cut(stream: bytes, places: list[int]) -> None:
    whole = UartParser().feed(stream)
    for pieces in (wire.cut(stream, places), [bytes([b]) for b in stream]):
        parser = UartParser()
        assert [e for piece in pieces for e in parser.feed(piece)] == whole


@given(
    st.lists(st.one_of(st.binary(max_size=400), wire.streams, wire.reference_frames()), max_size=6),
    st.sampled_from(list(Direction)),
    st.lists(st.integers(0, 5000), max_size=8),
)
def test_nothing_that_arrives_raises_and_all_of_it_is_accounted_for(
    parts: list[bytes], sends: Direction, places: list[int]
) -> None:
    link = Link(sends)
    events: list[LinkEvent] = []
    for piece in wire.cut(b"".join(parts), places):
        events += link.receive(piece)
    statistics = link.statistics
    assert statistics.bytes_in == sum(map(len, parts))
    assert statistics.damaged == sum(isinstance(e, DamagedFrame) for e in events)
    assert statistics.rejected == sum(isinstance(e, Rejected) for e in events)
    for event in events:
        if isinstance(event, Received):
            assert event.spec.direction is not sends
            assert ref.LAYOUTS[event.frame.type_id][1] == event.spec.direction.value


@given(st.binary(max_size=2000), wire.reference_frames())
def test_a_frame_after_garbage_and_a_delimiter_is_always_found(
    garbage: bytes, framed: bytes
) -> None:
    expected = as_reference(UartParser().feed(framed))
    assert len(expected) == 1
    parser = UartParser()
    parser.feed(garbage)
    assert as_reference(parser.feed(framed))[-1:] == expected  # the frame begins with a delimiter


def test_memory_is_bounded_for_any_input() -> None:
    parser = UartParser()
    framed = ref.frame_bytes(flags=0, node=1, type_id=7, seq=1, t_us=2, payload=b"\x2a")
    megabyte = b"\x11" * (1 << 20)
    tracemalloc.start()
    try:
        for _ in range(8):
            for start in range(0, len(megabyte), 4096):
                assert parser.feed(megabyte[start : start + 4096]) == []
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 16_384
    damage, frame = parser.feed(framed)
    assert isinstance(damage, DamagedFrame)
    assert (damage.offset, damage.length, len(damage.data)) == (0, 8 << 20, LONGEST_KEPT)
    assert isinstance(frame, Frame)


def test_a_link_keeps_bounded_accounts_of_unknown_senders_and_types() -> None:
    rng = Random(5)
    link = Link(Direction.HOST)
    for _ in range(3000):
        body = bytes([0x10, rng.randrange(256), rng.randrange(256)]) + rng.randbytes(9)
        link.receive(b"\0" + ref.cobs_encode(body + ref.crc32(body).to_bytes(4, "little")) + b"\0")
    assert link.statistics.rejected + link.statistics.frames_in >= 3000
    assert len(link.statistics.by_type) <= 256


# ---- damage on an idle-separated line -------------------------------------------------------


def frames_of(rng: Random, count: int, *, leading: bool) -> list[bytes]:
    """Return ``count`` different frames, with or without the leading zero."""
    made: list[bytes] = []
    types = sorted(
        t for t, (_, _, rows) in ref.LAYOUTS.items() if all(row[1] != "text" for row in rows)
    )
    for index in range(count):
        type_id = rng.choice(types)
        size = sum(ref.SIZES[row[1]] for row in ref.LAYOUTS[type_id][2])
        framed = ref.frame_bytes(
            flags=0,
            node=1,
            type_id=type_id,
            seq=index & 255,
            t_us=index,  # identifies the frame
            payload=rng.choice([rng.randbytes(size), bytes(size)]),
        )
        made.append(framed if leading else framed[1:])
    return made


def spoil(rng: Random, stream: bytearray, first: int, last: int) -> tuple[int, int]:
    """Damage a stretch that begins in ``first:last``; return the range of damaged bytes."""
    at = rng.randrange(first, last)
    match rng.randrange(5):
        case 0:
            stream[at] ^= 1 << rng.randrange(8)
            return at, at + 1
        case 1:  # two to five single bits, which the CRC is made to detect
            end = min(last, at + 8)
            for _ in range(rng.randint(2, 5)):
                stream[rng.randrange(at, end)] ^= 1 << rng.randrange(8)
            return at, end
        case 2:  # a burst, which may reach into the next frame
            end = min(len(stream), at + rng.randint(2, 16))
            stream[at:end] = rng.randbytes(end - at)
            return at, end
        case 3:  # bytes lost up to the frame's end, including the closing delimiter
            del stream[at:last]
            return at, last
        case _:
            stream[at:at] = rng.randbytes(rng.randint(1, 12))
            return at, at


def campaign(
    seed: int, count: int, *, leading: bool, tails_only: bool = False
) -> tuple[int, int, int]:
    """Damage every second frame; count damaged, lost intact and wrongly accepted frames."""
    rng = Random(seed)
    damaged = lost = wrong = 0
    for _ in range(count // 20):
        frames = frames_of(rng, 20, leading=leading)
        sent = {f.t_us: f for f in ref_frames(frames)}
        stream = bytearray()
        starts: list[int] = []
        for framed in frames:
            starts.append(len(stream))
            stream += framed
        touched: set[int] = set()
        for index in range(18, -1, -2):  # from the back, so that earlier offsets stay valid
            first, last = starts[index], starts[index] + len(frames[index])
            if tails_only:
                del stream[rng.randrange(first + 2, last - 1) : last]
                touched.add(index)
                continue
            low, high = spoil(rng, stream, first, last)
            touched.add(index)
            # Damage to a leading zero does not count, because that zero belongs to the gap.
            if high > low and index + 1 < 20 and high > starts[index + 1] + 1:
                touched.add(index + 1)
        got = [f for f in UartParser().feed(bytes(stream)) if isinstance(f, Frame)]
        damaged += len(touched)
        stamps = {f.t_us for f in got}
        lost += sum(i not in touched and i not in stamps for i in range(20))
        for frame in got:
            twin = sent.get(frame.t_us)
            wrong += twin is None or (twin.type_id, twin.seq, twin.payload) != (
                frame.type_id,
                frame.seq,
                frame.payload,
            )
    return damaged, lost, wrong


def ref_frames(frames: list[bytes]) -> list[Frame]:
    return [f for f in UartParser().feed(b"\0" + b"".join(frames)) if isinstance(f, Frame)]


def test_damage_costs_no_neighbour_and_lets_no_wrong_message_in() -> None:
    damaged, lost, wrong = campaign(11, 20_000, leading=True)
    assert damaged >= 10_000
    assert wrong == 0
    assert lost / damaged <= 0.03


def test_a_cut_tail_costs_nothing_with_the_leading_zero_and_a_neighbour_without() -> None:
    damaged, lost, wrong = campaign(12, 4_000, leading=True, tails_only=True)
    assert (damaged, lost, wrong) == (2_000, 0, 0)
    damaged, lost, wrong = campaign(12, 4_000, leading=False, tails_only=True)
    assert wrong == 0
    assert lost / damaged > 0.9  # otherwise this test shows nothing


@given(st.integers(0, 2**32), st.integers(1, 40))
def test_a_link_over_a_hostile_wire_delivers_only_sent_messages(seed: int, chunk: int) -> None:
    rng = Random(seed)
    line: Wire = Duplicating(Lossy(Pipe(), p=0.1, rng=rng), p=0.1, rng=rng)
    line = Garbage(Burst(CutTail(line, p=0.1, rng=rng), p=0.1, rng=rng), p=0.1, rng=rng)
    line = Lossy(Chunked(BitFlips(line, p=0.1, rng=rng), chunk), p=0.05, rng=rng)
    receiver = Link(Direction.HOST)
    frames = frames_of(rng, 60, leading=True)
    sent = {(f.type_id, f.seq, f.t_us, f.payload) for f in ref_frames(frames)}
    for index, framed in enumerate(frames):
        line.push(framed, index)
        for piece in line.pull(index):
            for event in receiver.receive(piece):
                if isinstance(event, Received):
                    frame = event.frame
                    assert (frame.type_id, frame.seq, frame.t_us, frame.payload) in sent
