"""Authenticated frames: tags against an independent computation, and reasons of rejections."""

from __future__ import annotations

import hashlib
import random
import struct
from typing import TYPE_CHECKING
from zlib import crc32

import pytest
from cobs import cobs

from protocol.authentication import (
    CAN_AUTH_TYPE,
    GUARDED_TYPES,
    Authenticator,
    BadKeyError,
    key_of,
    key_words,
)
from protocol.can.awaiting_tag import TOGETHER_US
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.link import Received, Rejected
from protocol.messages.host import (
    Describe,
    DescribeEnum,
    HostHello,
    SetMode,
    Stop,
    StopAll,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from protocol.link import LinkBase

KEY = bytes(range(1, 17))
OTHER = bytes(16)[:-1] + b"\x01"
BOOT, SESSION, CHALLENGE = 0x1111_2222, 0x3333_4444, 0xFFFF_FFFE
"""Boot id, session id and challenge; the counter wraps two steps after this challenge."""


def hmac_sha256(key: bytes, message: bytes) -> bytes:
    """Return an HMAC as RFC 2104 defines it: block of 64 bytes, inner 0x36, outer 0x5c."""
    key = key.ljust(64, b"\0")
    inner = hashlib.sha256(bytes(k ^ 0x36 for k in key) + message).digest()
    return hashlib.sha256(bytes(k ^ 0x5C for k in key) + inner).digest()


NONCE = struct.pack("<III", BOOT, SESSION, CHALLENGE)


def begun(key: bytes = KEY, challenge: int = CHALLENGE) -> Authenticator:
    authenticator = Authenticator(key)
    authenticator.begin(BOOT, SESSION, challenge)
    return authenticator


def keyed(link: LinkBase, key: bytes = KEY) -> LinkBase:
    link.key = begun(key)
    return link


# ---- the bytes --------------------------------------------------------------------------


def test_a_signed_frame_byte_for_byte() -> None:
    link = keyed(Link(Direction.HOST))
    link.send(SetMode(7, 1), 1_000_000, node=1)
    head = bytes((0x21, 1, 0x06, 0)) + struct.pack("<I", 1_000_000)
    payload, counter = struct.pack("<HB", 7, 1), struct.pack("<I", 0xFFFF_FFFF)
    tag = hmac_sha256(KEY, NONCE + head + payload + counter)[:8]
    body = head + payload + counter + tag
    wanted = b"\0" + cobs.encode(body + struct.pack("<I", crc32(body))) + b"\0"
    assert link.data_to_send() == wanted


def test_a_signed_message_on_a_bus_byte_for_byte() -> None:
    link = keyed(CanLink(Direction.HOST))
    link.send(VelocitySetpoint(1000, -500, 200, 3), 1_600_000, node=5)
    records = link.data_to_send()
    (first_id, first_size, first), (tag_id, tag_size, tag) = RECORD.iter_unpack(records)
    assert (first_id, first_size, tag_id, tag_size) == (0x02 << 4 | 5, 8, CAN_AUTH_TYPE << 4 | 5, 8)
    covered = struct.pack("<HB", first_id, 8) + first
    wanted = hmac_sha256(KEY, NONCE + covered + struct.pack("<I", 0xFFFF_FFFF))[:6]
    assert tag == struct.pack("<H", 0xFFFF) + wanted


def test_cost_of_a_tag() -> None:
    plain, signed = Link(Direction.HOST), keyed(Link(Direction.HOST))
    for link in (plain, signed):
        link.send(VelocitySetpoint(1, 2, 200, 1), 0, node=1)
    assert len(signed.data_to_send()) - len(plain.data_to_send()) == 12


@pytest.mark.parametrize("spec", CATALOGUE.specs, ids=lambda s: s.name)
def test_messages_that_need_a_tag(spec: object) -> None:
    cls, direction = spec.cls, spec.direction  # type: ignore[attr-defined]  # a message's
    free = {Stop, StopAll, HostHello, TimeRequest, Describe, DescribeEnum}
    guarded = direction is Direction.HOST and cls not in free
    assert (spec.type_id in GUARDED_TYPES) is guarded  # type: ignore[attr-defined]  # a message's


# ---- accepted and rejected --------------------------------------------------------------


@pytest.mark.parametrize("kind", [Link, CanLink])
def test_there_and_back_over_the_wrap_of_the_counter(kind: type[LinkBase]) -> None:
    host, device = keyed(kind(Direction.HOST)), keyed(kind(Direction.DEVICE))
    synchronise(host, device)
    for index in range(1, 40):
        message = SetMode(index, 1) if index % 2 else VelocitySetpoint(index, 0, 200, index)
        host.send(message, index * 20_000, node=1)
        (event,) = device.receive(host.data_to_send(), index * 20_000)
        assert isinstance(event, Received)
        assert event.message == message
        assert event.frame.flags & 1


def synchronise(host: LinkBase, device: LinkBase) -> None:
    """Send a full time stamp, which the device needs to extend the short stamps on a bus."""
    host.send(TimeRequest(1), 0, node=1)
    events = device.receive(host.data_to_send(), 0)
    assert all(isinstance(event, Received) for event in events)


def sent(count: int = 1, key: bytes = KEY) -> list[bytes]:
    host = keyed(Link(Direction.HOST), key)
    frames = []
    for index in range(count):
        host.send(SetMode(index, 1), index * 1000, node=1)
        frames.append(host.data_to_send())
    return frames


def rejected(device: LinkBase, data: bytes) -> bool:
    (event,) = device.receive(data, 0)
    return isinstance(event, Rejected) and event.reason == "key"


def test_the_same_frame_twice_is_rejected() -> None:
    device = keyed(Link(Direction.DEVICE))
    (frame,) = sent()
    assert isinstance(device.receive(frame, 0)[0], Received)
    assert rejected(device, frame)


def test_an_older_frame_is_rejected() -> None:
    device = keyed(Link(Direction.DEVICE))
    first, second = sent(2)
    assert isinstance(device.receive(second, 0)[0], Received)
    assert rejected(device, first)


@pytest.mark.parametrize(
    "session",
    [
        (BOOT + 1, SESSION, CHALLENGE),
        (BOOT, SESSION + 1, CHALLENGE),
        (BOOT, SESSION, CHALLENGE - 9),
    ],
)
def test_a_frame_of_another_session_is_rejected(session: tuple[int, int, int]) -> None:
    device = Link(Direction.DEVICE)
    device.key = Authenticator(KEY)
    device.key.begin(*session)
    assert rejected(device, sent()[0])


def test_another_key_no_key_and_no_session() -> None:
    assert rejected(keyed(Link(Direction.DEVICE), OTHER), sent()[0])
    assert rejected(Link(Direction.DEVICE), sent()[0])
    unbegun = Link(Direction.DEVICE)
    unbegun.key = Authenticator(KEY)
    assert rejected(unbegun, sent()[0])


def test_a_forged_frame_does_not_move_the_counter() -> None:
    device = keyed(Link(Direction.DEVICE))
    for frame in sent(3, OTHER):
        assert rejected(device, frame)
    assert isinstance(device.receive(sent()[0], 0)[0], Received)


def test_every_flipped_bit_is_rejected() -> None:
    (frame,) = sent()
    body = bytearray(cobs.decode(frame[1:-1])[:-4])
    for bit in range(8, len(body) * 8):  # all bits except version and flags
        flipped = bytearray(body)
        flipped[bit // 8] ^= 1 << bit % 8
        data = b"\0" + cobs.encode(bytes(flipped) + struct.pack("<I", crc32(flipped))) + b"\0"
        (event,) = keyed(Link(Direction.DEVICE)).receive(data, 0)
        assert isinstance(event, Rejected), bit


def test_the_flag_alone_is_worth_nothing() -> None:
    """The frame has the flag of a signed frame, but no counter and no tag."""
    host = Link(Direction.HOST)
    host.send(SetMode(1, 1), 0, node=1, flags=1)
    assert rejected(keyed(Link(Direction.DEVICE)), host.data_to_send())
    bus, device = CanLink(Direction.HOST), keyed(CanLink(Direction.DEVICE))
    synchronise(bus, device)
    bus.send(SetMode(1, 1), 0, node=1, flags=1)
    assert device.receive(bus.data_to_send(), 0) == []
    (event,) = device.receive(b"", TOGETHER_US + 1)
    assert isinstance(event, Received)
    assert not event.frame.flags & 1


def test_a_tag_on_a_bus_that_comes_late_or_alone_or_after_another() -> None:
    host, device = keyed(CanLink(Direction.HOST)), keyed(CanLink(Direction.DEVICE))
    synchronise(host, device)
    host.send(SetMode(1, 1), 0, node=1)
    data = host.data_to_send()
    message, tag = data[: -RECORD.size], data[-RECORD.size :]
    device.receive(message, 0)
    late = device.receive(tag, TOGETHER_US + 1)
    assert [type(e) for e in late] == [Received, Rejected]
    assert isinstance(late[0], Received)
    assert not late[0].frame.flags & 1
    host.send(SetMode(2, 1), 0, node=1)
    host.send(SetMode(3, 1), 0, node=1)
    records = host.data_to_send()
    without_first_tag = records[: len(message)] + records[len(message) + RECORD.size :]
    first, second = device.receive(without_first_tag, 30_000)
    assert isinstance(first, Received)
    assert not first.frame.flags & 1
    assert isinstance(second, Received)
    assert second.frame.flags & 1


def test_keys() -> None:
    assert key_of(key_words(KEY)) == KEY
    assert key_of((0, 0, 0, 0)) is None
    with pytest.raises(BadKeyError):
        Authenticator(b"short")


def test_random_trailers_are_never_accepted() -> None:
    rng, device = random.Random(5), begun()
    assert not any(device.check(b"covered", rng.randbytes(12)) for _ in range(2000))
    assert not any(device.check_can([(1, b"x")], rng.randbytes(8)) for _ in range(2000))
    assert not device.check(b"covered", b"")
