"""Handshake: hello with the identity of the device, and its declarations."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING
from zlib import crc32

import pytest

from protocol.messages.device import UNKNOWN, DescribeEnumReply, DescribeReply, Hello
from protocol.messages.host import Describe, DescribeEnum, HostHello
from protocol.messages.values import ResetCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import MAX_TYPE

if TYPE_CHECKING:
    from support.probe import Probe

AT_ONCE_S = 0.25
"""Maximum time of an immediate reply, s. It includes the round trip and the host's pauses."""


def described(device: Probe, questions: list[Describe]) -> dict[int, DescribeReply]:
    """Send a few questions at a time, repeat lost ones, and return the answers by type."""
    answers: dict[int, DescribeReply] = {}
    for _ in range(4):
        for start in range(0, len(questions), 4):
            mark = len(device.received)
            some = [q for q in questions[start : start + 4] if q.described_type not in answers]
            for question in some:
                device.send(question)
            wanted = len(some)
            device.until(
                lambda m=mark, n=wanted: len(device.of(DescribeReply, m)) >= n,  # type: ignore[misc]  # bound now
                AT_ONCE_S,
            )
            answers |= {r.described_type: r for r in device.of(DescribeReply, mark)}
    missing = [q.described_type for q in questions if q.described_type not in answers]
    assert not missing, f"no answer to describe of {missing}"
    return answers


def enumerated(device: Probe, questions: list[DescribeEnum]) -> dict[int, DescribeEnumReply]:
    """Send one question at a time, repeat lost ones, and return the answers by key."""
    answers: dict[int, DescribeEnumReply] = {}
    for question in questions:
        for _ in range(4):
            mark = len(device.received)
            device.send(question)
            device.until(lambda m=mark: bool(device.of(DescribeEnumReply, m)), AT_ONCE_S)  # type: ignore[misc]  # bound now
            answers |= {r.enumeration: r for r in device.of(DescribeEnumReply, mark)}
            if question.enumeration in answers:
                break
        assert question.enumeration in answers, f"no answer to {question}"
    return answers


@pytest.mark.slow
def test_hello_once_a_second_until_the_handshake(device: Probe) -> None:
    mark = 0

    def hellos() -> list[int]:
        return [
            h.frame.t_us
            for h in device.received[mark:]
            if isinstance(h.message, Hello) and h.message.session_id == 0
        ]

    assert device.until(lambda: len(hellos()) >= 3, 6.0, alive=False), (
        f"{len(hellos())} hellos without a session within 6 s of silence"
    )
    gaps = [(b - a) % (1 << 32) for a, b in pairwise(hellos())]
    assert all(900_000 <= gap <= 1_100_000 for gap in gaps), f"hellos {gaps} us apart"


def test_hello_identifies_the_device(device: Probe) -> None:
    hello, again = device.greet(), device.greet()
    assert 1 <= (device.node or 0) <= 15
    assert len(hello.uid) == 12
    assert hello.uid not in {bytes(12), b"\xff" * 12}, "a uid that no chip has"
    assert hello.boot_id != 0
    assert hello.reset_cause in set(ResetCause), f"unknown reset cause {hello.reset_cause}"
    assert hello.name.strip(), "the firmware has no name"
    assert "�" not in hello.name, "the name is not UTF-8"
    of_the_session = CATALOGUE.by_class[Hello].fields.index(
        next(f for f in CATALOGUE.by_class[Hello].fields if f.name == "session_id")
    )
    same = [a == b for a, b in zip(hello, again, strict=True)]
    del same[of_the_session]
    assert all(same), f"two hellos differ: {hello}, {again}"


def test_hello_is_answered_at_once_and_names_the_session(device: Probe) -> None:
    device.greet()
    mark = len(device.received)
    device.send_hello()
    found = device.wait_for(Hello, AT_ONCE_S, mark=mark, alive=False)
    assert found is not None, f"no answer within {AT_ONCE_S} s"
    assert isinstance(found.message, Hello)
    assert found.message.session_id == device.session_id


def test_nothing_is_streamed_before_the_handshake(device: Probe) -> None:
    device.greet()
    device.ping()  # delayed replies have arrived by now
    received = device.listen(0.5)
    reported = {type(h.message).__name__ for h in received} - {"Hello", "TimeReply"}
    assert not reported, f"sent before the handshake: {sorted(reported)}"


def test_a_hello_of_another_boot_opens_no_session(device: Probe) -> None:
    """Such a hello may be a recording. The device answers with its present boot id."""
    hello = device.handshake()
    for boot_id in (0, hello.boot_id ^ 1):
        mark = len(device.received)
        device.send(HostHello(CATALOGUE.hash, 0x0BAD_B007, boot_id, 1, "recorded"))
        found = device.wait_for(Hello, AT_ONCE_S, mark=mark)
        assert found is not None, f"no answer within {AT_ONCE_S} s"
        assert isinstance(found.message, Hello)
        assert found.message.session_id == device.session_id, "the hello opened a session"


def test_session_zero_opens_nothing(device: Probe) -> None:
    device.greet()
    device.session_id, session = 0, device.session_id
    mark = len(device.received)
    device.send(HostHello(CATALOGUE.hash, 0, device.boot_id, 1, "conformance"))
    device.listen(0.3, alive=False)
    device.session_id = session
    named = {h.session_id for h in device.of(Hello, mark)}
    assert named <= {session}, "a hello with session 0 ended the session"
    received = device.listen(0.2)
    assert all(type(h.message).__name__ in {"Hello", "TimeReply"} for h in received)


def test_describe_matches_the_catalogue(device: Probe) -> None:
    device.greet()
    specs = list(CATALOGUE)
    answers = described(device, [Describe(s.type_id, len(s.fields)) for s in specs])
    for spec in specs:
        reply, own = answers[spec.type_id], len(spec.fields)
        if reply.field_count == UNKNOWN:
            assert not spec.bootstrap, f"{spec.name} is needed for every handshake"
            continue
        shared = min(own, reply.field_count)
        expected = CATALOGUE.chains[spec.type_id][shared]
        assert reply.chain == expected, f"{spec.name}: its first {shared} fields differ"
        if reply.field_count == own:
            assert reply.payload_length == spec.layout.size, spec.name
        assert reply.field_count == own or not spec.bootstrap, f"{spec.name} may never change"


@pytest.mark.slow
def test_describe_gives_the_chain_after_any_number_of_fields(device: Probe) -> None:
    device.greet()
    specs = list(CATALOGUE)
    for count in range(max(len(s.fields) for s in specs) + 2):
        asked = [s for s in specs if count <= len(s.fields) + 1]
        answers = described(device, [Describe(s.type_id, count) for s in asked])
        for spec in asked:
            reply = answers[spec.type_id]
            shared = min(count, reply.field_count, len(spec.fields))
            if reply.field_count == UNKNOWN or count > len(spec.fields) != reply.field_count:
                continue
            expected = CATALOGUE.chains[spec.type_id][shared]
            assert reply.chain == expected, f"{spec.name} after {shared} fields"


@pytest.mark.slow
def test_enumerations_are_those_of_the_catalogue(device: Probe) -> None:
    device.greet()
    for count in (0, 1, 0xFE):
        asked = [DescribeEnum(key, count) for key in CATALOGUE.enums]
        for key, reply in enumerated(device, asked).items():
            if reply.member_count == UNKNOWN:
                continue  # no message of the device uses the enumeration
            enum = CATALOGUE.enums[key]
            shared = min(count, reply.member_count, len(enum.members))
            assert reply.chain == enum.chain[shared], f"{enum.name} after {shared} members"
    (unknown,) = enumerated(device, [DescribeEnum(1, 3)]).values()
    assert unknown == DescribeEnumReply(1, UNKNOWN, 0)


def test_the_catalogue_hash_matches_the_descriptions(device: Probe) -> None:
    hello = device.greet()
    answers = described(device, [Describe(t, 0xFE) for t in range(MAX_TYPE + 1)])
    known = {t: a for t, a in answers.items() if a.field_count != UNKNOWN}
    lines = "".join(f"{t:02x}:{known[t].chain:08x}\n" for t in sorted(known))
    enums = enumerated(device, [DescribeEnum(key, 0xFE) for key in CATALOGUE.enums])
    lines += "".join(
        f"{key:08x}:{enums[key].chain:08x}\n"
        for key in CATALOGUE.enums
        if enums[key].member_count != UNKNOWN
    )
    assert hello.catalogue_hash == crc32(lines.encode())
    unknown = [a for a in answers.values() if a.field_count == UNKNOWN]
    assert unknown, "the device declares every type"


def test_describe_is_answered_outside_a_session(device: Probe) -> None:
    device.greet()
    device.session_id = 0
    described(device, [Describe(s.type_id, len(s.fields)) for s in list(CATALOGUE)[:3]])
