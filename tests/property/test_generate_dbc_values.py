"""The values that cantools reads in a frame equal those of our codec."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frames import from_record
from protocol.can.link import CanLink
from protocol.generate import render
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import RateClass
from support.strategies import message_of, nodes, t_us_values, values_of

if TYPE_CHECKING:
    from cantools.database.can import Database
    from hypothesis.strategies import SearchStrategy

    from protocol.can.frames import CanFrame
    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec

PERIODIC = [s.type_id for s in CATALOGUE if s.rate is RateClass.STREAM]
# Factor from the wire's unit to the unit in the property's name.
TO_SI = {"deg/s": math.pi / 180}


def _database(node: int) -> Database:
    (text,) = render("dbc", node=node).values()
    loaded = cantools.database.load_string(text, "dbc", strict=True)
    assert isinstance(loaded, cantools.database.can.Database)
    return loaded


DATABASES = {node: _database(node) for node in range(1, 16)}

periodic: SearchStrategy[tuple[int, dict[str, object]]] = st.sampled_from(PERIODIC).flatmap(
    lambda t: st.tuples(st.just(t), values_of(t))
)


def frames_of(spec: MessageSpec, message: Message, node: int, t_us: int) -> list[CanFrame]:
    link = CanLink(spec.direction)
    link.send(message, t_us, node=node)
    data = link.data_to_send()
    frames = [from_record(data[at : at + 16]) for at in range(0, len(data), 16)]
    return [f for f in frames if f is not None]


def check(field: Field, message: Message, value: object, unit: str | None) -> None:
    raw = getattr(message, field.name)
    if field.si_suffix is None:
        assert getattr(value, "value", value) == raw
        return
    assert unit == field.unit
    expected = getattr(message, field.name + field.si_suffix)
    if expected is None:
        assert str(value) == "none"
    else:
        assert isinstance(value, int | float)
        turned = value * TO_SI.get(field.unit, 1.0)
        assert turned == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(periodic, nodes.filter(bool), t_us_values)
def test_every_signal_has_the_message_s_value(
    typed: tuple[int, dict[str, object]], node: int, t_us: int
) -> None:
    spec = CATALOGUE.by_type[typed[0]]
    message = message_of(*typed)
    database = DATABASES[node]
    seen: set[str] = set()
    for frame in frames_of(spec, message, node, t_us):
        described = database.get_message_by_frame_id(frame.can_id)
        assert described.length == len(frame.data)
        signals: dict[str, Any] = dict(described.decode(frame.data))  # type: ignore[arg-type]  # no multiplexing
        if "t_us" in signals:
            assert signals.pop("t_us") == t_us
            assert signals.pop("frame_count") == 1  # the link sets the count
            seen.add("frame_count")
        else:
            stamp = signals.pop("t16")
            assert stamp == pytest.approx((t_us >> 4 & 0xFFFF) * 16e-6, rel=1e-12)
        for name, value in signals.items():
            (field,) = (f for f in spec.fields if f.name == name)
            check(field, message, value, described.get_signal_by_name(name).unit)
            assert name not in seen
            seen.add(name)
    assert seen == {f.name for f in spec.fields}


@given(periodic)
def test_a_value_with_a_meaning_lies_in_its_signal_s_range(
    typed: tuple[int, dict[str, object]],
) -> None:
    spec = CATALOGUE.by_type[typed[0]]
    for frame in frames_of(spec, message_of(*typed), 1, 0):
        described = DATABASES[1].get_message_by_frame_id(frame.can_id)
        decoded: dict[str, Any] = dict(described.decode(frame.data, decode_choices=False))  # type: ignore[arg-type]  # no multiplexing
        for signal in described.signals:
            field = next((f for f in spec.fields if f.name == signal.name), None)
            raw = typed[1].get(signal.name)
            if field is None or signal.name == "frame_count" or not isinstance(raw, int):
                continue
            assert signal.minimum is not None
            assert signal.maximum is not None
            slack = 1e-9
            inside = signal.minimum - slack <= decoded[signal.name] <= signal.maximum + slack
            assert inside == (field.low <= raw <= field.high)
