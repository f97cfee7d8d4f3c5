"""The codec against the reference codec: every message round-trips, everything else is rejected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.errors import FieldRangeError, PayloadError
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.codec import Codec
from protocol.uart.framing import MAX_PAYLOAD, Frame, FrameSizeError, UartParser, encode_frame
from support import reference_codec as ref
from support import strategies as wire

if TYPE_CHECKING:
    from protocol.schema.message import MessageSpec

pytestmark = pytest.mark.slow

SPECS = list(CATALOGUE)
RANGES = {"u8": (0, 255), "u16": (0, 65535), "u32": (0, 2**32 - 1), "i16": (-32768, 32767)}


def spec_id(spec: MessageSpec) -> str:
    return spec.name


def test_the_reference_table_lists_the_catalogue() -> None:
    ours = {
        s.type_id: (s.name, s.direction.value, [(f.name, f.wire.name) for f in s.fields])
        for s in SPECS
    }
    theirs = {
        t: (name, side, [(row[0], row[1]) for row in rows])
        for t, (name, side, rows) in ref.LAYOUTS.items()
    }
    assert ours == theirs


@pytest.mark.parametrize("spec", SPECS, ids=spec_id)
@settings(max_examples=40)
@given(data=st.data())
def test_round_trip_and_the_reference_agree(spec: MessageSpec, data: st.DataObject) -> None:
    values = data.draw(wire.values_of(spec.type_id))
    node, seq = data.draw(wire.nodes), data.draw(wire.seqs)
    t_us, flags = data.draw(wire.t_us_values), data.draw(wire.flags)
    message = wire.message_of(spec.type_id, values)

    type_id, payload = Codec().encode(message)
    assert payload == ref.encode_payload(spec.type_id, values)
    framed = b"\0" + encode_frame(node, type_id, seq, t_us, payload, flags)
    assert framed == ref.frame_bytes(
        flags=flags, node=node, type_id=type_id, seq=seq, t_us=t_us, payload=payload
    )

    (frame,) = UartParser().feed(framed)
    assert frame == Frame(0x20 + flags, node, type_id, seq, t_us, payload)
    back = Codec().decode(spec, payload)
    assert back == message
    assert type(back) is spec.cls
    assert ref.decode_payload(spec.type_id, payload) == values


@pytest.mark.parametrize("spec", SPECS, ids=spec_id)
@settings(max_examples=40)
@given(data=st.data())
def test_si_values_are_those_of_the_reference(spec: MessageSpec, data: st.DataObject) -> None:
    values = data.draw(wire.values_of(spec.type_id))
    message = wire.message_of(spec.type_id, values)
    for name, expected in ref.si_values(spec.type_id, values).items():
        value = getattr(message, name)
        assert value == (expected if expected is None else pytest.approx(expected, rel=1e-12))


@given(spec=st.sampled_from(SPECS), payload=st.binary(max_size=60))
def test_any_payload_decodes_or_raises_payload_error(spec: MessageSpec, payload: bytes) -> None:
    size = spec.layout.size
    more_is_fine = spec.text_field is not None or spec.bootstrap
    if len(payload) < size or (len(payload) > size and not more_is_fine):
        with pytest.raises(PayloadError) as raised:
            Codec().decode(spec, payload)
        error = raised.value
        assert (error.message, error.length, error.expected) == (spec.name, len(payload), size)
        return
    message = Codec().decode(spec, payload)
    for field in spec.fields:
        if field.si_suffix:
            getattr(message, field.name + field.si_suffix)  # a property never raises


@given(
    data=st.data(),
    wrong=st.sampled_from(["above", "below", "float", "text", "none"]),
)
def test_encode_rejects_values_out_of_range_by_name(data: st.DataObject, wrong: str) -> None:
    type_id, values = data.draw(wire.typed_values.filter(lambda drawn: bool(drawn[1])))
    name, kind = data.draw(st.sampled_from([row[:2] for row in ref.LAYOUTS[type_id][2]]))
    if kind in RANGES:
        low, high = RANGES[kind]
        bad: object = {
            "above": data.draw(st.integers(high + 1, 2**70)),
            "below": data.draw(st.integers(-(2**70), low - 1)),
            "float": 1.5,
            "text": "1",
            "none": None,
        }[wrong]
    elif kind == "uid96":
        bad = {"above": bytes(13), "below": bytes(11), "text": "x" * 12}.get(wrong)
    else:
        bad = {"above": 7, "below": b"bytes"}.get(wrong)
    with pytest.raises(FieldRangeError) as raised:
        Codec().encode(wire.message_of(type_id, {**values, name: bad}))
    assert raised.value.message == ref.LAYOUTS[type_id][0]
    assert raised.value.field == name
    assert raised.value.value == bad


@given(
    node=st.integers(-1, 17),
    type_id=st.integers(-1, 0x82),
    flags=st.integers(-1, 17),
    size=st.one_of(st.integers(0, 300), st.sampled_from([MAX_PAYLOAD, MAX_PAYLOAD + 1])),
)
def test_a_header_rejects_values_out_of_range(
    node: int, type_id: int, flags: int, size: int
) -> None:
    values = {"node": (node, 15), "type_id": (type_id, 0x7E), "flags": (flags, 15)}
    unfit = [name for name, (value, high) in values.items() if not 0 <= value <= high]
    if size > MAX_PAYLOAD:
        with pytest.raises(FrameSizeError) as too_long:
            encode_frame(node, type_id, 0, 0, bytes(size), flags)
        assert too_long.value.length == size
    elif unfit:
        with pytest.raises(FieldRangeError) as raised:
            encode_frame(node, type_id, 0, 0, bytes(size), flags)
        assert raised.value.field in unfit
    else:
        (frame,) = UartParser().feed(encode_frame(node, type_id, 0, 0, bytes(size), flags))
        assert frame == Frame(0x20 + flags, node, type_id, 0, 0, bytes(size))


# ---- older and newer peers ----------------------------------------------------------------


@st.composite
def cut_messages(draw: st.DrawFn) -> tuple[MessageSpec, dict[str, object], int]:
    """Draw a message without text, its values, and the number of shared leading fields."""
    spec = draw(st.sampled_from([s for s in SPECS if s.text_field is None]))
    return spec, draw(wire.values_of(spec.type_id)), draw(st.integers(0, len(spec.fields)))


@given(cut_messages())
def test_an_older_peer_gives_and_gets_the_shared_fields(
    case: tuple[MessageSpec, dict[str, object], int],
) -> None:
    spec, values, shared = case
    codec = Codec()
    codec.limit(spec.type_id, shared)
    sizes = [ref.SIZES[row[1]] for row in ref.LAYOUTS[spec.type_id][2]]
    whole = ref.encode_payload(spec.type_id, values)
    prefix = whole[: sum(sizes[:shared])]

    message = wire.message_of(spec.type_id, values)
    assert codec.encode(message) == (spec.type_id, prefix)
    absent = [None] * (len(sizes) - shared)
    decoded = codec.decode(spec, prefix)
    assert list(decoded) == [*list(values.values())[:shared], *absent]
    assert codec.extra_bytes == 0
    assert codec.encode(decoded) == (spec.type_id, prefix)
    if prefix:
        with pytest.raises(PayloadError):
            codec.decode(spec, prefix[:-1])
    codec.limit(spec.type_id, None)
    assert codec.encode(message) == (spec.type_id, whole)


@given(cut_messages(), st.binary(min_size=1, max_size=20))
def test_a_newer_peers_fields_are_skipped_and_counted(
    case: tuple[MessageSpec, dict[str, object], int], extra: bytes
) -> None:
    spec, values, _ = case
    payload = ref.encode_payload(spec.type_id, values) + extra
    codec = Codec()
    if not spec.bootstrap:
        with pytest.raises(PayloadError):  # allowed only after the peer declared more fields
            codec.decode(spec, payload)
    codec.limit(spec.type_id, len(spec.fields))
    assert list(codec.decode(spec, payload)) == list(values.values())
    assert codec.decode(spec, payload) == wire.message_of(spec.type_id, values)
    assert codec.extra_bytes == 2 * len(extra)
