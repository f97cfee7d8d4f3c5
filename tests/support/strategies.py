"""Hypothesis strategies for messages, frames and streams.

They draw raw values from the table of the reference codec. If the catalogue lays out a field
differently, a test finds the difference.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import strategies as st

from protocol.schema.catalogue import CATALOGUE
from support import reference_codec as ref

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

    from protocol.schema.message import Message

_BOUNDS = {"u8": (0, 0xFF), "u16": (0, 0xFFFF), "u32": (0, 0xFFFFFFFF), "i16": (-32768, 32767)}

type_ids = st.sampled_from(sorted(ref.LAYOUTS))
t_us_values = st.integers(0, 0xFFFFFFFF)
seqs = st.integers(0, 255)
nodes = st.integers(0, 15)
flags = st.integers(0, 15)


def field_values(kind: str) -> SearchStrategy[object]:
    """Draw any raw value of a wire type, often at the ends of its range."""
    if kind == "text":
        return st.text(max_size=50)
    if kind == "uid96":
        return st.binary(min_size=12, max_size=12)
    low, high = _BOUNDS[kind]
    return st.one_of(st.integers(low, high), st.sampled_from([low, high, 0]))


def values_of(type_id: int) -> SearchStrategy[dict[str, object]]:
    """Draw field values of one message type, by name, in wire order."""
    rows = ref.LAYOUTS[type_id][2]
    drawn = st.tuples(*(field_values(row[1]) for row in rows))
    return drawn.map(lambda values: {row[0]: v for row, v in zip(rows, values, strict=True)})


def message_of(type_id: int, values: dict[str, object]) -> Message:
    """Return the project's message with these values."""
    return CATALOGUE.by_type[type_id].cls(**values)


typed_values = type_ids.flatmap(lambda t: st.tuples(st.just(t), values_of(t)))
"""Draws a message type and values for all its fields."""


@st.composite
def reference_frames(draw: st.DrawFn) -> bytes:
    """Draw a valid delimited frame of any message, written by the reference codec."""
    type_id, values = draw(typed_values)
    return ref.frame_bytes(
        flags=draw(flags),
        node=draw(nodes),
        type_id=type_id,
        seq=draw(seqs),
        t_us=draw(t_us_values),
        payload=ref.encode_payload(type_id, values),
    )


@st.composite
def damaged(draw: st.DrawFn, frame: bytes) -> bytes:
    """Damage ``frame`` in one way: invert a bit, or replace, remove or insert bytes."""
    at = draw(st.integers(0, len(frame) - 1))
    match draw(st.sampled_from(["flip", "noise", "cut tail", "cut head", "insert", "drop"])):
        case "flip":
            bit = 1 << draw(st.integers(0, 7))
            return frame[:at] + bytes([frame[at] ^ bit]) + frame[at + 1 :]
        case "noise":
            noise = draw(st.binary(min_size=1, max_size=8))
            return frame[:at] + noise + frame[at + len(noise) :]
        case "cut tail":
            return frame[:at]
        case "cut head":
            return frame[at:]
        case "insert":
            return frame[:at] + draw(st.binary(min_size=1, max_size=300)) + frame[at:]
        case _:
            return frame[:at] + frame[at + 1 :]


streams = st.lists(
    st.one_of(
        reference_frames(),
        reference_frames().flatmap(damaged),
        st.binary(max_size=40),
        st.binary(min_size=250, max_size=300).map(lambda b: b.replace(b"\0", b"\1")),
        st.integers(1, 4).map(bytes),
    ),
    max_size=8,
).map(b"".join)
"""Draws content of a serial line: intact and damaged frames, garbage, too long frames, zeros."""


def cut(data: bytes, places: list[int]) -> list[bytes]:
    """Split ``data`` at these positions, modulo its length."""
    ends = sorted(p % (len(data) + 1) for p in places)
    return [data[a:b] for a, b in zip([0, *ends], [*ends, len(data)], strict=True)]
