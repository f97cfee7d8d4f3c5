"""Random messages, and the expected output of a dissector."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec
    from support.captures import Seen

PER_MESSAGE = 12
SENDER = {Direction.DEVICE: "device to host", Direction.HOST: "host to device"}


def random_value(field: Field, rng: random.Random) -> object:
    """Return a random raw value, often at the ends of its range."""
    wire = field.wire
    if wire.is_text:
        return "".join(rng.choice("aZ09 ,.±°é漢🤖") for _ in range(rng.randrange(20)))
    if not wire.is_integer:
        return rng.randbytes(wire.size)
    edges = [wire.low, wire.high, field.low, field.high, 0, field.none or 0]
    return rng.choice([*edges, *(rng.randint(wire.low, wire.high) for _ in range(6))])


def random_message(spec: MessageSpec, rng: random.Random) -> Message:
    """Return a random message of this kind."""
    return spec.cls(*(random_value(f, rng) for f in spec.fields))


def random_messages(seed: int) -> list[tuple[MessageSpec, Message]]:
    """Return every kind of message, several times, in random order."""
    rng = random.Random(seed)
    made = [(s, random_message(s, rng)) for s in CATALOGUE for _ in range(PER_MESSAGE)]
    rng.shuffle(made)
    return made


def assert_field(seen: Seen, spec: MessageSpec, field: Field, value: object) -> None:
    """Check one field of the payload, both for filters and for people."""
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
    """Check all fields of an undamaged message."""
    assert seen.number("type") == spec.type_id
    assert seen.get("direction") == SENDER[spec.direction]
    assert seen.get("damage") is None
    assert seen.experts <= {"out_of_range"}
    for field, value in zip(spec.fields, message, strict=True):
        assert_field(seen, spec, field, value)
