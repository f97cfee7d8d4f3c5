"""A capture decoded with numpy equals the result of the streaming parser and the codec."""

from __future__ import annotations

import io
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from protocol.errors import PayloadError
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.codec import Codec
from protocol.uart.batch import REASONS, BatchResult, decode_capture
from protocol.uart.framing import DamagedFrame, UartParser, encode_frame
from support import reference_codec as ref
from support import strategies as wire

if TYPE_CHECKING:
    from protocol.uart.framing import Frame

pytestmark = pytest.mark.slow

Event = tuple[object, ...]


def streamed(stream: bytes) -> list[Event]:
    """Return every event of the streaming parser and codec, with the offset of its first byte."""
    events: list[Event] = []
    stretches = stream.split(b"\0")[:-1]  # bytes after the last zero are an incomplete frame
    ends = accumulate(len(stretch) + 1 for stretch in stretches)
    offsets = [end - len(s) - 1 for end, s in zip(ends, stretches, strict=True) if s]
    for offset, event in zip(offsets, UartParser().feed(stream), strict=True):
        if isinstance(event, DamagedFrame):
            assert event.offset == offset
            events.append((offset, "damaged", event.damage, event.length))
        else:
            events.append((offset, *interpreted(event)))
    return events


def interpreted(frame: Frame) -> Event:
    head = (frame.flags, frame.node, frame.seq, frame.t_us)
    spec = CATALOGUE.by_type.get(frame.type_id)
    reason = (
        "version" if frame.version != PROTOCOL_VERSION else "type" if spec is None else "payload"
    )
    if spec is not None and frame.version == PROTOCOL_VERSION:
        try:
            return (*head, spec.name, *Codec().decode(spec, frame.payload))
        except PayloadError:
            pass
    return (*head, "rejected", frame.version, frame.type_id, reason)


def batched(result: BatchResult) -> list[Event]:
    """Return the events of a decoded capture in the form of ``streamed``."""
    events: list[Event] = [
        (offset, "damaged", result.damage_of(damage), length)
        for offset, length, damage in result.damaged.tolist()
    ]
    for offset, version, flags, node, type_id, seq, t_us, reason in result.rejected.tolist():
        head = (offset, flags, node, seq, t_us)
        events.append((*head, "rejected", version, type_id, REASONS[reason]))
    for name, rows in result.messages.items():
        assert rows["offset"].tolist() == sorted(rows["offset"].tolist())
        for offset, flags, node, seq, t_us, *values in rows.tolist():
            events.append((offset, flags, node, seq, t_us, name, *values))
    return sorted(events, key=lambda event: str(event[0]).zfill(20))


@st.composite
def odd_frames(draw: st.DrawFn) -> bytes:
    """Draw intact frames of any version, type and payload; few of them are valid messages."""
    type_id = draw(st.one_of(wire.type_ids, st.integers(0, 255)))
    size = draw(st.sampled_from([0, 1, 6, 14, 31, 60, 237, 241]))
    return ref.frame_bytes(
        flags=draw(wire.flags),
        node=draw(st.integers(0, 255)),
        type_id=type_id,
        seq=draw(wire.seqs),
        t_us=draw(wire.t_us_values),
        payload=draw(st.one_of(st.just(bytes(size)), st.binary(max_size=241))),
        version=draw(st.sampled_from([0, 1, 1, 1, 2, 15])),
    )


_parts = st.one_of(wire.streams, odd_frames(), odd_frames().flatmap(wire.damaged))
captures = st.lists(_parts, max_size=12).map(b"".join)


@given(captures)
@example(b"")
@example(b"\0" + b"\x11" * 254 + b"\0")
@example(b"\0" + b"\x11" * 255 + b"\0\x02\x01\0\xff")
@example(b"\0" + b"\xff" + b"\x11" * 254 + b"\0")
def test_a_capture_equals_the_streaming_parsers_result(stream: bytes) -> None:
    result = decode_capture(stream)
    assert batched(result) == streamed(stream)
    assert result.bytes_seen == len(stream)


@given(captures, st.integers(1, 700), st.lists(st.integers(0, 5000), max_size=20))
def test_the_result_is_independent_of_the_chunks(
    stream: bytes, chunk_bytes: int, places: list[int]
) -> None:
    expected = batched(decode_capture(stream))
    pieces = wire.cut(stream, places)
    for source in (stream, io.BytesIO(stream), pieces, iter(pieces)):
        result = decode_capture(source, chunk_bytes=chunk_bytes)
        assert batched(result) == expected
        assert result.bytes_seen == len(stream)


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 2**16), captures), min_size=1, max_size=3))
def test_long_captures_use_the_fast_path_with_equal_results(parts: list[tuple[int, bytes]]) -> None:
    stream = b""
    for seed, odd in parts:  # enough frames of one length for the column-wise check
        rng = np.random.default_rng(seed)
        payloads = rng.integers(0, rng.choice([2, 256]), (300, 14), dtype=np.uint8)
        sent = [b"\0" + encode_frame(1, 0x13, i, i, p.tobytes()) for i, p in enumerate(payloads)]
        hurt = bytearray(b"".join(sent))
        for place in rng.integers(0, len(hurt), 40):
            hurt[place] ^= 1 << int(rng.integers(8))
        stream += bytes(hurt) + odd
    assert batched(decode_capture(stream)) == streamed(stream)
