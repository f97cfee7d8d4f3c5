"""Hash chains of the message declarations, and their comparison between host and device."""

from __future__ import annotations

import zlib
from dataclasses import replace
from enum import IntEnum
from random import Random
from typing import Annotated

import pytest

from protocol.messages import ALL_MESSAGES
from protocol.messages.device import (
    UNKNOWN,
    DescribeEnumReply,
    DescribeReply,
    Encoders,
    Imu,
    Power,
    Status,
)
from protocol.messages.host import Describe, DescribeEnum
from protocol.messages.values import Mode, StopCause
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.comparison import Comparison, Match, describe
from protocol.schema.fields import I16, U8, U16, U32, Field, number, si, si_or_none
from protocol.schema.message import CanPart, Direction, Message, MessageSpec, RateClass, message
from support import peers

POWER = 0x24
ENUMS_OF_STATUS = ("Fault|bits", "Mode|enum", "StopCause|enum")


def more_parts(fields: list[Field]) -> list[CanPart]:
    """Return a second CAN frame if a field needs one."""
    return [CanPart(0x60, "second")] if any(f.can_part == 1 for f in fields) else []


def variant(cls: type[Message], fields: list[Field], name: str | None = None) -> type[Message]:
    """Return a peer's declaration of the same message type."""
    parts = CATALOGUE.spec(cls).can_parts
    return peers.variant(
        cls,
        {f.name: Annotated[int, f] for f in fields},
        name=name,
        can_parts=(*parts[:1], *(parts[1:] or more_parts(fields))),
    )


def chain_of(spec: MessageSpec) -> tuple[int, ...]:
    """Return the hash chain that the specification defines."""
    lines = [f"{line}\n" for line in spec.canonical()]
    return tuple(zlib.crc32("".join(lines[: i + 1]).encode()) for i in range(len(lines)))


def peer_with(cls: type[Message], fields: list[Field] | None) -> Catalogue:
    """Return the project's catalogue with one message declared differently, or left out."""
    rest = [m for m in ALL_MESSAGES if m is not cls]
    return Catalogue(rest if fields is None else [*rest, variant(cls, fields)])


def compare(host: Catalogue, device: Catalogue, rng: Random | None = None) -> Comparison:
    """Compare two catalogues; with ``rng``, replies are reordered, and some lost or duplicated."""
    comparison = Comparison(host)
    for _ in range(200):
        if comparison.complete:
            break
        replies = [describe(device, q) for q in comparison.questions(5)]
        if rng:
            replies = [r for r in replies + replies if rng.random() < 0.4]
            rng.shuffle(replies)
        for reply in replies:
            comparison.answer(reply)
    assert comparison.complete
    return comparison


def test_chain_of_encoders_written_out() -> None:
    start = zlib.crc32(b"encoders|device|stream\n")
    left = zlib.crc32(b"left|u16|1|count||0..65535||\n", start)
    right = zlib.crc32(b"right|u16|1|count||0..65535||\n", left)
    assert CATALOGUE.chains[0x16] == (start, left, right)


def test_chain_of_scaled_fields_written_out() -> None:
    # 9.80665/16384 = 980665/1638400000 = 196133/327680000; 0.001 = 1/1000; 36.53 = 3653/100
    whole = b"-32768..32767"
    text = b"imu|device|stream\n"
    text += b"".join(
        b"accel_%b|i16|196133/327680000|m/s2||%b||\n" % (axis, whole) for axis in (b"x", b"y", b"z")
    )
    text += b"temperature|i16|1/340+3653/100|degC||%b||15\n" % whole
    text += b"".join(
        b"gyro_%b|i16|1/131|deg/s||%b||14\n" % (axis, whole) for axis in (b"x", b"y", b"z")
    )
    assert CATALOGUE.chains[0x13][-1] == zlib.crc32(text)
    text = b"power|device|stream\nbattery|u16|1/1000|V||0..65535||\n"
    text += b"logic|u8|1/40|V||0..255||\nmotor_left|u8|1/50|A||0..255||\n"
    assert CATALOGUE.chains[POWER][3] == zlib.crc32(text)


def test_chain_of_a_sentinel_and_of_an_enumeration_written_out() -> None:
    text = b"range|device|stream\nultrasonic|u16|1/1000|m|65535|0..4000||\n"
    assert CATALOGUE.chains[0x20][1] == zlib.crc32(text)
    text = b"status|device|stream\nmode|u8|1|enum|||Mode|\n"
    assert CATALOGUE.chains[0x11][1] == zlib.crc32(text)
    mode = CATALOGUE.enums[zlib.crc32(b"Mode|enum\n")]
    assert mode.members == ("idle", "velocity", "bringup", "onboard")
    assert mode.chain[2] == zlib.crc32(b"Mode|enum\nidle=0\nvelocity=1\n")
    contact = CATALOGUE.enums[zlib.crc32(b"Contact|bits\n")]
    text = b"Contact|bits\nbumper_left=1\nbumper_right=2\ncliff=4\n"
    assert contact.chain[-1] == zlib.crc32(text)


def test_whole_hash_is_that_of_all_last_chain_values() -> None:
    small = Catalogue([Encoders, Power])
    lines = f"16:{small.chains[0x16][-1]:08x}\n24:{small.chains[POWER][-1]:08x}\n"
    assert small.hash == zlib.crc32(lines.encode())
    assert (
        Catalogue([Power, Encoders]).hash == small.hash
    )  # the order of declaration does not matter


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"wire": U16},
        {"scale": CATALOGUE.by_type[POWER].fields[1].scale * 2},
        {"offset": 1},
        {"unit": "A"},
        {"none": 255, "high": 254},
        {"low": 5},
        {"high": 200},
        {"can_part": 1},
        {"enum": Mode},
    ],
    ids=lambda c: next(iter(c)),
)
def test_the_whole_hash_shows_a_changed_meaning(change: dict[str, object]) -> None:
    fields = list(CATALOGUE.spec(Power).fields)
    fields[1] = replace(fields[1], **change)  # type: ignore[arg-type]  # any attribute
    other = peer_with(Power, fields)
    assert other.hash != CATALOGUE.hash
    assert other.chains[POWER][:2] == CATALOGUE.chains[POWER][:2]
    assert not set(other.chains[POWER][2:]) & set(CATALOGUE.chains[POWER][2:])


def test_whole_hash_is_blind_to_a_description() -> None:
    fields = list(CATALOGUE.spec(Power).fields)
    fields[1] = replace(fields[1], doc="described in other words")
    assert peer_with(Power, fields).hash == CATALOGUE.hash


def test_direction_and_rate_class_belong_to_the_meaning() -> None:
    assert CATALOGUE.chains[POWER] != chain_of(replace(CATALOGUE.spec(Power), rate=RateClass.RARE))
    other = replace(CATALOGUE.spec(Power), direction=Direction.HOST)
    assert not set(CATALOGUE.chains[POWER]) & set(chain_of(other))


def test_the_whole_hash_shows_a_missing_message() -> None:
    assert peer_with(Power, None).hash != CATALOGUE.hash


def test_describe_gives_the_chain_after_the_shared_fields() -> None:
    chains = CATALOGUE.chains[POWER]
    for asked, shared in ((0, 0), (2, 2), (4, 4), (5, 4), (255, 4)):
        reply = describe(CATALOGUE, Describe(POWER, asked))
        assert reply == DescribeReply(POWER, 4, 5, chains[shared])
    assert describe(CATALOGUE, Describe(0x7E, 3)) == DescribeReply(0x7E, UNKNOWN, 0, 0)


OWN = list(CATALOGUE.spec(Power).fields)
EXTRA = number(U32, "count", "new").named("extra")
CHANGED = [OWN[0], replace(OWN[1], scale=OWN[1].scale * 2), *OWN[2:]]


@pytest.mark.parametrize(
    ("fields", "match", "shared", "report"),
    [
        (OWN, Match.EQUAL, 4, "power: equal"),
        (OWN[:2], Match.OLDER, 2, "power: the device lacks motor_left, motor_right"),
        ([*OWN, EXTRA, EXTRA.named("more")], Match.NEWER, 4, "power: the device sends 2 more"),
        (None, Match.MISSING, 0, "power: the device does not have it; disabled"),
        (CHANGED, Match.DIFFERENT, 0, "power: the device declares other fields; disabled"),
        (CHANGED[:2], Match.DIFFERENT, 0, "power: the device declares other fields; disabled"),
        ([*CHANGED, EXTRA], Match.DIFFERENT, 0, "power: the device declares other fields"),
        ([OWN[1], OWN[0], *OWN[2:]], Match.DIFFERENT, 0, "power: the device declares other"),
    ],
)
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_a_peer_that_differs_in_one_message(
    fields: list[Field] | None, match: Match, shared: int, report: str, seed: int | None
) -> None:
    device = peer_with(Power, fields)
    rng = None if seed is None else Random(seed)
    outcome = compare(CATALOGUE, device, rng).outcome
    assert set(outcome) == {s.type_id for s in CATALOGUE}
    comparison = outcome.pop(POWER)
    assert comparison.match is match
    assert comparison.shared_fields == shared
    assert comparison.usable is (shared > 0)
    assert comparison.report().startswith(report)
    assert {a.match for a in outcome.values()} == {Match.EQUAL}


def test_a_renamed_message_is_another_one() -> None:
    renamed = variant(Power, OWN, name="Supply")
    device = Catalogue([*(m for m in ALL_MESSAGES if m is not Power), renamed])
    assert compare(CATALOGUE, device).outcome[POWER].match is Match.DIFFERENT


def test_both_ends_see_each_other_from_their_side() -> None:
    grown = peer_with(Power, [*OWN, EXTRA])
    assert compare(CATALOGUE, grown).outcome[POWER].match is Match.NEWER
    assert compare(grown, CATALOGUE).outcome[POWER].match is Match.OLDER


def test_questions_are_few_and_asked_again_until_answered() -> None:
    comparison = Comparison(Catalogue([Power, Imu, Status]))
    assert comparison.questions(2) == comparison.questions(2)
    assert len(comparison.questions(2)) == 2
    asked = comparison.questions(9)[:3]
    assert asked == [Describe(0x11, 5), Describe(0x13, 7), Describe(POWER, 4)]
    comparison.answer(describe(CATALOGUE, Describe(0x13, 7)))
    assert comparison.questions(2) == [Describe(0x11, 5), Describe(POWER, 4)]
    enums = [CATALOGUE.enums[zlib.crc32(f"{n}\n".encode())] for n in ENUMS_OF_STATUS]
    assert comparison.questions(9)[2:] == [DescribeEnum(e.key, len(e.members)) for e in enums]
    assert not comparison.complete


def test_unexpected_and_repeated_answers_are_ignored() -> None:
    comparison = Comparison(Catalogue([Power]))
    assert not comparison.answer(describe(CATALOGUE, Describe(0x13, 7)))
    assert not comparison.answer(DescribeEnumReply(1, 2, 3))
    assert not comparison.outcome
    comparison.answer(describe(CATALOGUE, Describe(POWER, 4)))
    comparison.answer(DescribeReply(POWER, UNKNOWN, 0, 0))
    assert comparison.outcome[POWER].match is Match.EQUAL
    assert comparison.complete


def test_any_reply_is_survived() -> None:
    rng = Random(3)
    comparison = Comparison(CATALOGUE)
    for _ in range(2000):
        comparison.answer(
            DescribeReply(rng.randrange(256), rng.randrange(256), rng.randrange(256), 0)
        )
        key = rng.choice([*CATALOGUE.enums, 7])
        comparison.answer(DescribeEnumReply(key, rng.randrange(256), 0))
    assert comparison.complete
    for result in comparison.outcome.values():
        assert not result.usable
        assert "disabled" in result.report()


def test_an_appended_optional_field_in_the_declaration_itself() -> None:
    @message(POWER, Direction.DEVICE, RateClass.STREAM, default_hz=5)
    class Power(Message):  # the message as a later version would declare it
        """Supply rails and motor currents."""

        battery: Annotated[int, number(U16, "V", "16 V rail", scale="0.001")]
        logic: Annotated[int, number(U8, "V", "5 V rail", scale="0.025")]
        motor_left: Annotated[int, number(U8, "A", "magnitude", scale="0.02")]
        motor_right: Annotated[int, number(U8, "A", "magnitude", scale="0.02")]
        charge: Annotated[int | None, number(I16, "A", "into the battery", scale="0.01")] = None
        battery_v = si("battery")
        charge_a = si_or_none("charge")

    newer = Catalogue([Power])
    assert newer.chains[POWER][:5] == CATALOGUE.chains[POWER]
    assert Comparison(newer).questions(1) == [Describe(POWER, 5)]


# ---- enumerations ---------------------------------------------------------------------------


def with_causes(*members: tuple[str, int]) -> Catalogue:
    """Return the project's catalogue with other members of the enumeration StopCause."""
    other: type[IntEnum] = IntEnum("StopCause", members)  # type: ignore[misc]  # members at run time

    def renumbered(cls: type[Message]) -> type[Message]:
        fields = CATALOGUE.spec(cls).fields
        if all(f.enum is not StopCause for f in fields):
            return cls
        return variant(cls, [replace(f, enum=other) if f.enum is StopCause else f for f in fields])

    return Catalogue([renumbered(cls) for cls in ALL_MESSAGES])


OWN_CAUSES = [(c.name, int(c)) for c in StopCause]
USERS = {s.name for s in CATALOGUE if any(f.enum is StopCause for f in s.fields)}


def test_a_renumbered_enumeration_disables_the_messages_that_use_it() -> None:
    swapped = [*OWN_CAUSES[:4], ("OPERATOR", 5), ("HARDWARE", 4)]
    comparison = compare(CATALOGUE, with_causes(*swapped))
    assert with_causes(*swapped).hash != CATALOGUE.hash
    unusable = {a.spec.name: a.report() for a in comparison.outcome.values() if not a.usable}
    assert set(unusable) == USERS
    assert unusable["status"] == "status: the device has other values of StopCause; disabled"
    assert "StopCause: the device gives its members other values" in [
        d.report() for d in comparison.differences
    ]


@pytest.mark.parametrize(
    ("members", "match", "report"),
    [
        (OWN_CAUSES[:-1], Match.OLDER, "StopCause: the device lacks hardware"),
        (
            [*OWN_CAUSES, ("REFLEX", 6)],
            Match.NEWER,
            "StopCause: the device has 1 more member(s), which read as unknown",
        ),
    ],
)
def test_an_appended_member_stays_compatible(
    members: list[tuple[str, int]], match: Match, report: str
) -> None:
    comparison = compare(CATALOGUE, with_causes(*members), Random(2))
    assert all(a.match is Match.EQUAL for a in comparison.outcome.values())
    (difference,) = comparison.differences
    assert (difference.match, difference.report()) == (match, report)


def test_an_enumeration_of_a_field_that_is_not_shared_disables_nothing() -> None:
    """The device has other causes, but its status lacks the field that uses them."""
    swapped = with_causes(*OWN_CAUSES[:4], ("OPERATOR", 5), ("HARDWARE", 4))
    short = variant(Status, list(CATALOGUE.spec(Status).fields[:1]))
    device = Catalogue([*(s.cls for s in swapped if s.name != "status"), short])
    comparison = compare(CATALOGUE, device).outcome[0x11]
    assert (comparison.match, comparison.shared_fields) == (Match.OLDER, 1)


def test_an_enumeration_that_the_device_lacks() -> None:
    device = Catalogue([Power, Encoders])
    reply = describe(device, DescribeEnum(7, 2))
    assert reply == DescribeEnumReply(7, UNKNOWN, 0)
    reports = [d.report() for d in compare(CATALOGUE, device).differences]
    assert "Mode: the device does not have it" in reports
