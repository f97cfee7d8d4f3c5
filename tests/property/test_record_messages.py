"""Google's protobuf decodes every message of the catalogue, with any values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.unknown_fields import UnknownFieldSet
from hypothesis import given
from hypothesis import strategies as st

from bridge.record.encode.layout import FieldKind, FlatField, FlatMessage
from bridge.record.encode.schemas import DeviceEncoder
from bridge.session.records import DeviceMessage
from protocol.schema.catalogue import CATALOGUE
from support.strategies import message_of, nodes, seqs, t_us_values, typed_values

if TYPE_CHECKING:
    from google.protobuf.message import Message as ProtoMessage

ENCODERS = {spec.type_id: DeviceEncoder(spec) for spec in CATALOGUE}


def parse(layout: FlatMessage, data: bytes) -> Any:  # noqa: ANN401 - a class made at run time
    """Decode with google.protobuf alone, from the layout's descriptor set."""
    files = descriptor_pb2.FileDescriptorSet.FromString(layout.descriptor_set())
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    cls = message_factory.GetMessageClass(pool.FindMessageTypeByName(layout.full_name))
    message: ProtoMessage = cls()
    assert message.ParseFromString(data) == len(data)
    assert len(UnknownFieldSet(message)) == 0
    return message


@given(typed_values, nodes, seqs, t_us_values, st.none() | st.integers(0, 2**63))
def test_a_device_message_equals_the_bytes_on_the_link(
    typed: tuple[int, dict[str, object]], node: int, seq: int, t_us: int, bound_ns: int | None
) -> None:
    type_id, values = typed
    message = message_of(type_id, values)
    spec = CATALOGUE.by_type[type_id]
    record = DeviceMessage(1, None, bound_ns, node, seq, t_us, spec.name, message)
    decoded = parse(ENCODERS[type_id].layout, ENCODERS[type_id].encode(record))
    assert (decoded.t_us, decoded.node) == (t_us, node)
    assert decoded.HasField("bound_ns") == (bound_ns is not None)
    assert decoded.bound_ns == (bound_ns or 0)
    for name, value in values.items():
        assert getattr(decoded, name) == value
    for field in spec.fields:
        if field.si_suffix is None:
            continue
        name = field.name + field.si_suffix
        expected = getattr(message, name)
        assert decoded.HasField(name) == (expected is not None)
        if expected is not None:
            assert getattr(decoded, name) == expected


@pytest.mark.parametrize("spec", list(CATALOGUE), ids=lambda spec: str(spec.name))
def test_fields_that_a_peer_leaves_out_are_absent(spec: Any) -> None:  # noqa: ANN401 - a MessageSpec
    message = spec.cls._make([None] * len(spec.fields))
    record = DeviceMessage(1, None, None, 3, 4, 5, spec.name, message)
    layout = ENCODERS[spec.type_id].layout
    decoded = parse(layout, ENCODERS[spec.type_id].encode(record))
    assert {d.name for d, _ in decoded.ListFields()} == {"t_us", "node"}


@given(
    st.lists(
        st.sampled_from(list(FieldKind)).flatmap(
            lambda kind: st.tuples(
                st.just(kind),
                st.none()
                | {
                    FieldKind.DOUBLE: st.floats(allow_nan=False),
                    FieldKind.FIXED32: st.integers(0, 2**32 - 1),
                    FieldKind.SFIXED32: st.integers(-(2**31), 2**31 - 1),
                    FieldKind.FIXED64: st.integers(0, 2**64 - 1),
                    FieldKind.SFIXED64: st.integers(-(2**63), 2**63 - 1),
                    FieldKind.STRING: st.text(max_size=200),
                    FieldKind.BYTES: st.binary(max_size=200),
                }[kind],
            )
        ),
        min_size=1,
        max_size=40,
    )
)
def test_any_flat_message_decodes_with_googles_protobuf(
    fields: list[tuple[FieldKind, Any]],
) -> None:
    layout = FlatMessage(
        "Any", [FlatField(f"f{i}", kind, i) for i, (kind, _) in enumerate(fields, 1)]
    )
    decoded = parse(layout, layout.encode([value for _, value in fields]))
    for i, (_, value) in enumerate(fields, 1):
        assert decoded.HasField(f"f{i}") == (value is not None)
        if value is not None:
            assert getattr(decoded, f"f{i}") == value
