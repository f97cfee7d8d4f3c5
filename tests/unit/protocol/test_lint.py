"""The catalogue obeys its rules, and the lint detects each violation."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from enum import IntEnum
from typing import Annotated

import pytest

from bridge.record.encode import schemas
from bridge.record.encode.layout import FlatMessage
from protocol.errors import UnknownMessageError
from protocol.generate.c_text import snake
from protocol.messages.device import Imu, LogText, Power, Range, Status
from protocol.messages.host import SetMode, VelocitySetpoint
from protocol.schema import lint
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.fields import I16, TEXT, U8, U16, Field, number, si, si_or_none, text
from protocol.schema.lint import RESERVED_MESSAGES, findings
from protocol.schema.message import (
    CanPart,
    Direction,
    Message,
    MessageSpec,
    RateClass,
    message,
    specify,
)
from protocol.uart import framing
from support.root import ROOT

RAW = number(U8, "count", "a number")


def layout(fields: tuple[Field, ...]) -> struct.Struct:
    return struct.Struct("<" + "".join(f.wire.code for f in fields))


def with_field(cls: type[Message], field: str, /, **change: object) -> MessageSpec:
    """Return the message's specification with one field declared differently."""
    spec = CATALOGUE.spec(cls)
    fields = tuple(
        replace(f, **change) if f.name == field else f  # type: ignore[arg-type]  # any attribute
        for f in spec.fields
    )
    return replace(spec, fields=fields, layout=layout(fields))


def with_more(cls: type[Message], *more: Field) -> MessageSpec:
    spec = CATALOGUE.spec(cls)
    fields = (*spec.fields, *more)
    return replace(spec, fields=fields, layout=layout(fields))


def test_the_maximum_payload_is_that_of_a_frame() -> None:
    assert lint.MAX_PAYLOAD == framing.MAX_PAYLOAD


def test_ours_is_clean() -> None:
    assert findings(CATALOGUE) == []


def test_type_and_name_declared_twice() -> None:
    imu = CATALOGUE.spec(Imu)
    assert findings([imu, imu]) == [
        "type 0x13 is declared 2 times",
        "name imu is declared 2 times",
    ]


@pytest.mark.parametrize(
    ("spec", "finding"),
    [
        (replace(CATALOGUE.spec(Imu), type_id=0x7F), "imu: type 0x7f is out of range"),
        (replace(CATALOGUE.spec(Imu), type_id=-1), "imu: type -0x1 is out of range"),
        (replace(CATALOGUE.spec(Imu), doc=""), "imu: has no description"),
        (
            replace(CATALOGUE.spec(Imu), to_all=True),
            "imu: a device's message has the node of its device, never all",
        ),
        (replace(CATALOGUE.spec(Imu), default_hz=0.0), "imu: a stream needs a default rate"),
        (
            replace(CATALOGUE.spec(LogText), rate=RateClass.STREAM, default_hz=1.0),
            "log_text: a stream may not carry text",
        ),
        (
            with_more(Imu, RAW.named("more")),
            "imu: CAN part 0 of 7 B exceeds 6 B",
        ),
        (
            with_more(SetMode, *(RAW.named(f"more_{i}") for i in range(239))),
            "set_mode: payload of 242 B exceeds 241 B",
        ),
        (
            with_field(SetMode, "command_id", name="ident"),
            "set_mode: a command starts with its command_id",
        ),
        (
            replace(CATALOGUE.spec(SetMode), fields=(), layout=layout(())),
            "set_mode: a command starts with its command_id",
        ),
        (with_field(Power, "battery", doc=""), "power.battery: has no description"),
        (with_field(Status, "load", unit="furlong"), "status.load: unit 'furlong' is not known"),
        (
            with_field(Status, "load", high=256),
            "status.load: range 0..256 does not fit u8",
        ),
        (
            with_field(Status, "load", low=-1),
            "status.load: range -1..100 does not fit u8",
        ),
        (
            with_field(Range, "ultrasonic", none=4000),
            "range.ultrasonic: sentinel 4000 lies inside the range",
        ),
        (with_field(Status, "mode", enum=None), "status.mode: an enum needs its names"),
        (
            with_field(Status, "load", scale=2),
            "status.load: a scaled value needs a physical unit, not 'percent'",
        ),
        (
            with_field(Status, "load", unit="V"),
            "status.load: lacks its SI property load_v",
        ),
        (  # a field with a sentinel needs si_or_none
            with_field(Power, "logic", none=255, high=254),
            "power.logic: lacks its SI property logic_v",
        ),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_a_planted_fault_is_found_alone(spec: MessageSpec, finding: str) -> None:
    assert findings([spec]) == [finding]


def test_a_stream_too_long_for_its_frame_and_for_the_types_of_its_parts() -> None:
    more = (replace(RAW, name=f"more_{i}", can_part=3 + i // 6) for i in range(12))
    assert findings([with_more(Imu, *more)]) == [
        "imu: stream of 26 B exceeds 25 B",
        "imu: CAN part 3 has no type of its own",
        "imu: CAN part 4 has no type of its own",
    ]


def test_types_of_parts_are_held_against_all_others() -> None:
    def findings_of(*types: int) -> list[str]:
        parts = tuple(CanPart(t, f"part {t}") for t in types)
        return findings([replace(s, can_parts=parts) if s.cls is Imu else s for s in CATALOGUE])

    apart = "imu: the types of CAN parts must be consecutive"
    assert findings_of(0x13, 0x14, 0x15) == []
    assert findings_of(0x13, 0x16, 0x29, 0x7F) == [
        "CAN part type 0x29 is declared 2 times",
        "CAN part type 0x16 is a message's too",
        "CAN part type 0x7f is out of range",
        apart,
    ]
    assert findings_of(0x13, 0x15, 0x14) == [apart]


def test_a_host_s_message_has_no_slow_part() -> None:
    spec = CATALOGUE.spec(VelocitySetpoint)
    parts = (CanPart(0x02, "one"), CanPart(0x03, "two", slow_us=1))
    assert findings([replace(spec, can_parts=parts)]) == [
        "velocity_setpoint: a host's message has a slow CAN part: a device needs all parts at once"
    ]


def test_types_of_makers_are_theirs() -> None:
    spec = replace(CATALOGUE.spec(Power), type_id=0x50, can_parts=(CanPart(0x50), CanPart(0x5F)))
    theirs = type("Power", (Power,), {"__module__": "maker.messages"})
    wanted = [f"power: type {t} is one of the makers' own messages" for t in ("0x50", "0x5f")]
    assert [f for f in findings([spec]) if "makers" in f] == wanted
    assert not [f for f in findings([replace(spec, cls=theirs)]) if "makers" in f]


# ---- declaring ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["clock_sync", "parser"])
def test_a_message_name_that_a_log_or_the_c_code_uses(name: str) -> None:
    assert findings([replace(CATALOGUE.spec(Power), name=name)]) == [
        f"{name}: the name is reserved"
    ]


def test_field_names_that_other_columns_have() -> None:
    node = replace(RAW, name="node")
    again = replace(RAW, name="battery_v")
    assert {
        "power: the field name node is reserved",
        "power: two values have the name battery_v",
    } <= set(findings([with_more(Power, node, again)]))


def test_every_other_name_of_logs_and_c_code_is_reserved() -> None:
    header = (ROOT / "sim_device/firmware/protocol/sweepctl_protocol.h").read_text()
    types = set(re.findall(r"} sp_(\w+)_t;", header)) - CATALOGUE.by_name.keys()
    own = [each for each in vars(schemas).values() if isinstance(each, FlatMessage)]
    logged = {snake(each.full_name.rpartition(".")[2]) for each in own}
    assert types | logged <= RESERVED_MESSAGES


def test_two_enumerations_of_one_name() -> None:
    mode = IntEnum("Mode", ["OTHER"])  # type: ignore[misc]  # the name of another enumeration
    own = with_field(Status, "mode", enum=mode)
    assert "enumeration Mode is declared 2 times" in findings([CATALOGUE.spec(SetMode), own])


def test_a_field_without_declaration_is_rejected() -> None:
    with pytest.raises(TypeError, match=r"Bare\.value: needs exactly one field declaration"):

        @message(0x70, Direction.HOST, RateClass.RARE)
        class Bare(Message):
            """No declaration."""

            value: int


def test_text_before_the_last_field_is_rejected() -> None:
    @message(0x70, Direction.HOST, RateClass.RARE)
    class TextFirst(Message):
        """Text, then a number."""

        line: Annotated[str, text("some text")]
        value: Annotated[int, RAW]

    with pytest.raises(TypeError, match=r"TextFirst\.line: only the last field may be text"):
        specify(TextFirst)


def test_an_undeclared_class_is_rejected() -> None:
    class Nobody(Message):
        """Not declared."""

    with pytest.raises(TypeError, match="Nobody is not declared as a message"):
        specify(Nobody)


def test_an_si_property_of_no_field_is_rejected() -> None:
    @message(0x70, Direction.HOST, RateClass.RARE)
    class Misnamed(Message):
        """A property that names no field."""

        value: Annotated[int, number(U16, "V", "a voltage")]
        volts_v = si("volts")

    with pytest.raises(AttributeError, match="no field 'volts'"):
        specify(Misnamed)


def test_a_message_of_another_catalogue_is_unknown() -> None:
    with pytest.raises(UnknownMessageError, match="Imu is not in the catalogue") as raised:
        Catalogue([Power]).spec(Imu)
    assert raised.value.message == "Imu"


def test_an_appended_field_may_be_absent_and_its_property_too() -> None:
    @message(0x70, Direction.DEVICE, RateClass.RARE)
    class Grown(Message):
        """A message with a field that was added later."""

        value: Annotated[int, number(I16, "V", "a voltage", scale="0.5")]
        later: Annotated[int | None, number(U8, "A", "a current", scale="0.1")] = None
        value_v = si("value")
        later_a = si_or_none("later")

    assert findings(Catalogue([Grown])) == []
    assert Grown(-3) == Grown(-3, None)
    assert Grown(-3).value_v == -1.5
    assert Grown(-3).later_a is None
    assert Grown(-3, 20).later_a == pytest.approx(2.0)


def test_messages_of_two_types_are_never_equal() -> None:
    @message(0x70, Direction.HOST, RateClass.RARE)
    class One(Message):
        """A message with the same fields as the next."""

        value: Annotated[int, RAW]

    @message(0x71, Direction.HOST, RateClass.RARE)
    class Two(Message):
        """A message with the same fields as the one before."""

        value: Annotated[int, RAW]

    one, again, two = One(1), One(1), Two(1)
    assert one == again
    assert not one != again  # noqa: SIM202 - both operators are tested
    assert one != two
    assert not one == two  # noqa: SIM201 - both operators are tested
    assert one != (1,)
    assert len({one, again, two}) == 2
    assert TEXT.is_text
