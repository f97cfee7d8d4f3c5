"""Hashes of the declarations, and what two ends conclude from them."""

from __future__ import annotations

import zlib
from dataclasses import replace
from random import Random
from typing import Annotated

import pytest

from protocol.messages import ALL_MESSAGES
from protocol.messages.device import UNKNOWN_MESSAGE, DescribeReply, Encoders, Imu, Power, Status
from protocol.messages.host import Describe
from protocol.schema.agreement import Comparison, Match, describe
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.fields import I16, U8, U16, U32, Field, number, si, si_or_none
from protocol.schema.message import Direction, Message, RateClass, message

POWER = 0x15


def variant(cls: type[Message], fields: list[Field], name: str | None = None) -> type[Message]:
    """A peer's declaration of the same message type."""
    spec = CATALOGUE.spec(cls)
    body = {
        "__annotations__": {f.name: Annotated[int, f] for f in fields},
        "__doc__": "A peer's own.",
        "__module__": __name__,
    }
    made = type(name or cls.__name__, (Message,), body)
    declare = message(
        spec.type_id,
        spec.direction,
        spec.rate,
        default_hz=spec.default_hz,
        bootstrap=spec.bootstrap,
        to_all=spec.to_all,
        can_parts=spec.can_parts,
    )
    return declare(made)


def peer_with(cls: type[Message], fields: list[Field] | None) -> Catalogue:
    """Our catalogue with one message declared otherwise, or left out."""
    rest = [m for m in ALL_MESSAGES if m is not cls]
    return Catalogue(rest if fields is None else [*rest, variant(cls, fields)])


def compare(host: Catalogue, device: Catalogue, rng: Random | None = None) -> Comparison:
    """Ask and answer everything; with ``rng`` out of order, some twice, some lost."""
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
    start = zlib.crc32(b"encoders\n")
    left = zlib.crc32(b"left|u16|1|count\n", start)
    right = zlib.crc32(b"right|u16|1|count\n", left)
    assert CATALOGUE.chains[0x13] == (start, left, right)


def test_chain_of_scaled_fields_written_out() -> None:
    # 9.80665/16384 = 980665/1638400000 = 196133/327680000; 0.001 = 1/1000; 36.53 = 3653/100
    text = b"imu\naccel_x|i16|196133/327680000|m/s2\naccel_y|i16|196133/327680000|m/s2\n"
    text += b"accel_z|i16|196133/327680000|m/s2\ntemperature|i16|1/340+3653/100|degC\n"
    text += b"gyro_x|i16|1/131|deg/s\ngyro_y|i16|1/131|deg/s\ngyro_z|i16|1/131|deg/s\n"
    assert CATALOGUE.chains[0x12][-1] == zlib.crc32(text)
    text = b"power\nbattery|u16|1/1000|V\nlogic|u8|1/40|V\nmotor_left|u8|1/50|A\n"
    assert CATALOGUE.chains[POWER][3] == zlib.crc32(text)


def test_whole_hash_is_that_of_all_last_chain_values() -> None:
    small = Catalogue([Encoders, Power])
    lines = f"13:{small.chains[0x13][-1]:08x}\n15:{small.chains[POWER][-1]:08x}\n"
    assert small.hash == zlib.crc32(lines.encode())
    assert Catalogue([Power, Encoders]).hash == small.hash  # whatever the order of declaration


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"wire": U16},
        {"scale": CATALOGUE.by_type[POWER].fields[1].scale * 2},
        {"offset": 1},
        {"unit": "A"},
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


@pytest.mark.parametrize("change", [{"doc": "said otherwise"}, {"high": 200}, {"can_part": 1}])
def test_whole_hash_is_blind_to_what_changes_no_meaning(change: dict[str, object]) -> None:
    fields = list(CATALOGUE.spec(Power).fields)
    fields[1] = replace(fields[1], **change)  # type: ignore[arg-type]  # any attribute
    assert peer_with(Power, fields).hash == CATALOGUE.hash


def test_the_whole_hash_shows_a_missing_message() -> None:
    assert peer_with(Power, None).hash != CATALOGUE.hash


def test_describe_gives_the_chain_after_the_shared_fields() -> None:
    chains = CATALOGUE.chains[POWER]
    for asked, shared in ((0, 0), (2, 2), (4, 4), (5, 4), (255, 4)):
        reply = describe(CATALOGUE, Describe(POWER, asked))
        assert reply == DescribeReply(POWER, 4, 5, chains[shared])
    assert describe(CATALOGUE, Describe(0x7E, 3)) == DescribeReply(0x7E, UNKNOWN_MESSAGE, 0, 0)


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
    agreement = outcome.pop(POWER)
    assert agreement.match is match
    assert agreement.shared_fields == shared
    assert agreement.usable is (shared > 0)
    assert agreement.report().startswith(report)
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
    assert [q.described_type for q in comparison.questions(9)] == [0x11, 0x12, POWER]
    comparison.answer(describe(CATALOGUE, Describe(0x12, 7)))
    assert comparison.questions(9) == [Describe(0x11, 5), Describe(POWER, 4)]
    assert not comparison.complete


def test_what_was_not_asked_and_what_comes_twice_is_passed_over() -> None:
    comparison = Comparison(Catalogue([Power]))
    comparison.answer(describe(CATALOGUE, Describe(0x12, 7)))
    assert not comparison.outcome
    comparison.answer(describe(CATALOGUE, Describe(POWER, 4)))
    comparison.answer(DescribeReply(POWER, UNKNOWN_MESSAGE, 0, 0))
    assert comparison.outcome[POWER].match is Match.EQUAL
    assert comparison.complete


def test_any_reply_is_survived() -> None:
    rng = Random(3)
    comparison = Comparison(CATALOGUE)
    for _ in range(2000):
        comparison.answer(
            DescribeReply(rng.randrange(256), rng.randrange(256), rng.randrange(256), 0)
        )
    assert comparison.complete
    for agreement in comparison.outcome.values():
        assert not agreement.usable
        assert "disabled" in agreement.report()


def test_an_appended_optional_field_in_the_declaration_itself() -> None:
    @message(POWER, Direction.DEVICE, RateClass.STREAM, default_hz=5)
    class Power(Message):  # our message's name, as a later version would declare it
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
