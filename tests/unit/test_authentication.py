"""Authenticated frames: tags by an independent computation, and what is refused and why."""

from __future__ import annotations

import hashlib
import random
import struct
from typing import TYPE_CHECKING
from zlib import crc32

import pytest
from cobs import cobs

from bridge.mission import Phase
from bridge.session import Session
from bridge.session_events import CommandEnded, State
from protocol.authentication import (
    CAN_AUTH_TYPE,
    FREE,
    GUARDED_TYPES,
    Authenticator,
    BadKeyError,
    key_of,
    key_words,
)
from protocol.can_authentication import TOGETHER_US
from protocol.can_frames import RECORD
from protocol.can_link import CanLink
from protocol.catalogue import CATALOGUE
from protocol.link import Link, Received, Rejected
from protocol.message import Direction
from protocol.messages import (
    ClearStop,
    Describe,
    GetParameter,
    HostHello,
    SetKey,
    SetMode,
    Stop,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.values import Mode, NackReason, StopCause
from support.ends import Ends, HostEnd, SessionEnd, check_safe, spinning_host, sweeper

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from sim_device.device import VirtualSweeper

KEY = bytes(range(1, 17))
OTHER = bytes(16)[:-1] + b"\x01"
BOOT, SESSION, CHALLENGE = 0x1111_2222, 0x3333_4444, 0xFFFF_FFFE
"""The challenge is two before the counter's wrap."""


def hmac_sha256(key: bytes, message: bytes) -> bytes:
    """RFC 2104 from its text: block of 64 bytes, inner 0x36, outer 0x5c."""
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
    head = bytes((0x11, 1, 0x06, 0)) + struct.pack("<I", 1_000_000)
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


def test_what_it_costs() -> None:
    plain, signed = Link(Direction.HOST), keyed(Link(Direction.HOST))
    for link in (plain, signed):
        link.send(VelocitySetpoint(1, 2, 200, 1), 0, node=1)
    assert len(signed.data_to_send()) - len(plain.data_to_send()) == 12


@pytest.mark.parametrize("spec", CATALOGUE.specs, ids=lambda s: s.name)
def test_what_needs_a_tag(spec: object) -> None:
    cls, direction = spec.cls, spec.direction  # type: ignore[attr-defined]  # a message's
    guarded = direction is Direction.HOST and cls not in {Stop, HostHello, TimeRequest, Describe}
    assert (spec.type_id in GUARDED_TYPES) is guarded  # type: ignore[attr-defined]  # a message's
    assert Stop in FREE


# ---- taken and refused ------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Link, CanLink])
def test_there_and_back_over_the_wrap_of_the_counter(kind: type[LinkBase]) -> None:
    host, device = keyed(kind(Direction.HOST)), keyed(kind(Direction.DEVICE))
    tell_time(host, device)
    for index in range(1, 40):
        message = SetMode(index, 1) if index % 2 else VelocitySetpoint(index, 0, 200, index)
        host.send(message, index * 20_000, node=1)
        (event,) = device.receive(host.data_to_send(), index * 20_000)
        assert isinstance(event, Received)
        assert event.message == message
        assert event.frame.flags & 1


def tell_time(host: LinkBase, device: LinkBase) -> None:
    """A short stamp on a bus is understood once a whole one has come."""
    host.send(TimeRequest(1), 0, node=1)
    (event,) = device.receive(host.data_to_send(), 0)
    assert isinstance(event, Received)


def sent(count: int = 1, key: bytes = KEY) -> list[bytes]:
    host = keyed(Link(Direction.HOST), key)
    frames = []
    for index in range(count):
        host.send(SetMode(index, 1), index * 1000, node=1)
        frames.append(host.data_to_send())
    return frames


def refused(device: LinkBase, data: bytes) -> bool:
    (event,) = device.receive(data, 0)
    return isinstance(event, Rejected) and event.reason == "key"


def test_the_same_frame_twice_is_refused() -> None:
    device = keyed(Link(Direction.DEVICE))
    (frame,) = sent()
    assert isinstance(device.receive(frame, 0)[0], Received)
    assert refused(device, frame)


def test_an_older_frame_is_refused() -> None:
    device = keyed(Link(Direction.DEVICE))
    first, second = sent(2)
    assert isinstance(device.receive(second, 0)[0], Received)
    assert refused(device, first)


@pytest.mark.parametrize(
    "session",
    [
        (BOOT + 1, SESSION, CHALLENGE),
        (BOOT, SESSION + 1, CHALLENGE),
        (BOOT, SESSION, CHALLENGE - 9),
    ],
)
def test_a_frame_of_another_session_is_refused(session: tuple[int, int, int]) -> None:
    device = Link(Direction.DEVICE)
    device.key = Authenticator(KEY)
    device.key.begin(*session)
    assert refused(device, sent()[0])


def test_another_key_no_key_and_no_session() -> None:
    assert refused(keyed(Link(Direction.DEVICE), OTHER), sent()[0])
    assert refused(Link(Direction.DEVICE), sent()[0])
    unbegun = Link(Direction.DEVICE)
    unbegun.key = Authenticator(KEY)
    assert refused(unbegun, sent()[0])


def test_a_forged_frame_does_not_move_the_counter() -> None:
    device = keyed(Link(Direction.DEVICE))
    for frame in sent(3, OTHER):
        assert refused(device, frame)
    assert isinstance(device.receive(sent()[0], 0)[0], Received)


def test_every_flipped_bit_is_refused() -> None:
    (frame,) = sent()
    body = bytearray(cobs.decode(frame[1:-1])[:-4])
    for bit in range(8, len(body) * 8):  # all but version and flags
        flipped = bytearray(body)
        flipped[bit // 8] ^= 1 << bit % 8
        data = b"\0" + cobs.encode(bytes(flipped) + struct.pack("<I", crc32(flipped))) + b"\0"
        (event,) = keyed(Link(Direction.DEVICE)).receive(data, 0)
        assert isinstance(event, Rejected), bit


def test_the_flag_alone_is_worth_nothing() -> None:
    """The length of a plain frame, the flag of a signed one."""
    host = Link(Direction.HOST)
    host.send(SetMode(1, 1), 0, node=1, flags=1)
    assert refused(keyed(Link(Direction.DEVICE)), host.data_to_send())
    bus, device = CanLink(Direction.HOST), keyed(CanLink(Direction.DEVICE))
    tell_time(bus, device)
    bus.send(SetMode(1, 1), 0, node=1, flags=1)
    assert device.receive(bus.data_to_send(), 0) == []
    (event,) = device.receive(b"", TOGETHER_US + 1)
    assert isinstance(event, Received)
    assert not event.frame.flags & 1


def test_a_tag_on_a_bus_that_comes_late_or_alone_or_after_another() -> None:
    host, device = keyed(CanLink(Direction.HOST)), keyed(CanLink(Direction.DEVICE))
    tell_time(host, device)
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


def test_random_trailers_are_never_taken() -> None:
    rng, device = random.Random(5), begun()
    assert not any(device.check(b"covered", rng.randbytes(12)) for _ in range(2000))
    assert not any(device.check_can([(1, b"x")], rng.randbytes(8)) for _ in range(2000))
    assert not device.check(b"covered", b"")


# ---- both ends --------------------------------------------------------------------------

_ids = iter(range(0xA000_0001, 0xA100_0000))


def device(key: bytes | None, link: type[LinkBase] = Link) -> VirtualSweeper:
    made = sweeper(link=link)
    made.flash.key = key
    made.firmware.keyring.take()
    return made


def host(key: bytes | None, link: type[LinkBase] = Link) -> SessionEnd:
    return SessionEnd(Session(lambda: next(_ids), link=link, key=key))


def both(
    own: bytes | None, theirs: bytes | None, link: type[LinkBase] = Link
) -> tuple[Ends, SessionEnd]:
    end = host(own, link)
    ends = Ends(end, device(theirs, link))
    ends.watch = lambda: check_safe(ends)
    assert ends.run(4.0, lambda: end.session.state is State.READY)
    return ends, end


def held(ends: Ends) -> str:
    return ends.device.firmware.latch.cause.name.lower()


def flash_key(ends: Ends) -> bytes | None:
    return ends.device.flash.key


def outcomes(end: SessionEnd) -> list[tuple[bool, int | None]]:
    return [(e.outcome.accepted, e.outcome.reason) for e in end.of(CommandEnded)]


@pytest.mark.parametrize("link", [Link, CanLink])
def test_with_the_key_everything_works(link: type[LinkBase]) -> None:
    ends, end = both(KEY, KEY, link)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end) == [(True, None), (True, None)]
    end.each_turn = lambda now_ns: end.session.setpoint(0.1, 0.0, 200, now_ns)
    assert ends.run(1.0, lambda: ends.moving)
    ends.run(3.0)
    assert ends.moving


@pytest.mark.parametrize("link", [Link, CanLink])
@pytest.mark.parametrize("own", [None, OTHER], ids=["no key", "another key"])
def test_without_the_key_only_a_stop_is_obeyed(own: bytes | None, link: type[LinkBase]) -> None:
    ends, end = both(own, KEY, link)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.command(GetParameter, (0,), ends.host_ns)
    ends.run(3.0)
    assert not any(accepted for accepted, _ in outcomes(end))
    if own is None:
        assert {reason for _, reason in outcomes(end)} == {NackReason.NOT_AUTHENTICATED}
    assert held(ends) == "session_end"
    end.session.stop(StopCause.OPERATOR, ends.host_ns)
    ends.run(0.2)
    assert held(ends) == "operator"


def test_a_key_that_the_device_does_not_ask_for_is_not_used() -> None:
    ends, end = both(KEY, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end) == [(True, None)]
    assert end.session.link.key is not None
    assert not end.session.link.key.begun


def test_a_restarted_host_and_a_rebooted_device_sign_anew() -> None:
    ends, _ = both(KEY, KEY)
    second = host(KEY)
    ends.restart_host(second)
    assert ends.run(4.0, lambda: second.session.state is State.READY)
    ends.reboot_device(991)
    assert ends.run(4.0, lambda: second.session.state is not State.READY)
    assert ends.run(4.0, lambda: second.session.state is State.READY)
    second.session.set_mode(Mode.BRINGUP, ends.host_ns)
    second.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.3)
    assert outcomes(second)[-2:] == [(False, NackReason.STOP_LATCHED), (True, None)]


def test_recorded_motion_of_one_session_moves_nothing_in_another() -> None:
    """Somebody taps the line, and plays it back when the host has gone."""
    ends, end = both(KEY, KEY)
    taped: list[bytes] = []
    turn = end.turn

    def tapped(data: list[bytes], now_ns: int) -> bytes:
        out = turn(data, now_ns)  # type: ignore[arg-type]  # host time
        if out:
            taped.append(out)
        return out

    end.turn = tapped  # type: ignore[assignment,method-assign]  # a tap on the line
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    end.each_turn = lambda now_ns: end.session.setpoint(0.1, 0.0, 200, now_ns)
    assert ends.run(1.0, lambda: ends.moving)
    ends.run(0.5)
    ends.host_alive = False
    ends.run(3.0)
    stood_us = ends.moving_us
    hello = HostHello(CATALOGUE.hash, end.session.session_id, 1, "thief")  # hellos are not signed
    thief = Link(Direction.HOST)
    for _ in range(3):
        thief.send(hello, ends.host_ns // 1000, node=1)
        ends.to_device.push(thief.data_to_send(), ends.now_us)
        ends.run(0.05)
        for data in taped:
            ends.to_device.push(data, ends.now_us)
            ends.run(0.002)
    ends.run(1.0)
    assert ends.moving_us == stood_us
    assert ends.device.firmware.mode is Mode.IDLE


# ---- setting it -------------------------------------------------------------------------


def set_key(ends: Ends, end: SessionEnd, key: bytes | None) -> tuple[bool, int | None]:
    end.session.command(SetKey, key_words(key or bytes(16)), ends.host_ns)
    ends.run(0.3)
    outcome = outcomes(end)[-1]
    if outcome[0]:
        end.session.set_key(key, ends.host_ns)
        ends.run(0.2)
    return outcome


def test_a_key_is_set_used_replaced_and_removed() -> None:
    ends, end = both(None, None)
    assert set_key(ends, end, KEY) == (True, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end)[-1] == (True, None)
    assert set_key(ends, end, OTHER) == (True, None)
    assert flash_key(ends) == OTHER
    assert set_key(ends, end, None) == (True, None)
    assert flash_key(ends) is None
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end)[-1] == (True, None)


def test_a_key_outlives_a_reboot() -> None:
    ends, end = both(None, None)
    set_key(ends, end, KEY)
    ends.reboot_device(55)
    assert ends.run(4.0, lambda: end.session.state is not State.READY)
    assert ends.run(4.0, lambda: end.session.state is State.READY)
    stranger = host(None)
    ends.restart_host(stranger)
    assert ends.run(4.0, lambda: stranger.session.state is State.READY)
    assert set_key(ends, stranger, OTHER) == (False, NackReason.NOT_AUTHENTICATED)


def test_no_key_is_set_over_a_bus_or_a_network_or_while_it_may_move() -> None:
    ends, end = both(None, None, CanLink)
    assert set_key(ends, end, KEY) == (False, NackReason.UNSUPPORTED)
    ends, end = both(None, None)
    ends.device.firmware.keyring._may_set = False  # noqa: SLF001 - as on a TCP port
    assert set_key(ends, end, KEY) == (False, NackReason.UNSUPPORTED)
    ends, end = both(None, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert set_key(ends, end, KEY) == (False, NackReason.OTHER_MODE)
    assert flash_key(ends) is None


def test_the_key_is_on_the_line_once_and_never_told() -> None:
    ends, end = both(None, None)
    heard: list[bytes] = []
    receive = end.session.link.receive

    def listening(data: bytes, now_us: int = 0) -> list[object]:
        heard.append(data)
        return receive(data, now_us)  # type: ignore[return-value]  # link events

    end.session.link.receive = listening  # type: ignore[assignment,method-assign]  # a tap
    set_key(ends, end, KEY)
    for number in range(13):
        end.session.command(GetParameter, (number,), ends.host_ns)
        ends.run(0.1)
    ends.run(1.0)
    assert KEY not in b"".join(heard)
    assert KEY[4:8] not in b"".join(heard)


def test_a_run_says_what_it_lacks() -> None:
    runner = spinning_host()
    ends = Ends(HostEnd(runner), device(KEY))
    assert ends.run(5.0, lambda: runner.mission.phase is Phase.DONE)
    assert runner.mission.ending is not None
    assert runner.mission.ending.exit_status == 4
    assert "not_authenticated" in runner.mission.ending.reason


def test_the_stop_needs_no_key_even_without_a_session() -> None:
    made = device(KEY)
    made.step(b"", 500_000)
    link = Link(Direction.HOST)
    link.send(Stop(9, StopCause.OPERATOR), 1, node=0)
    link.send(ClearStop(10, StopCause.OPERATOR), 2, node=1)
    made.step(link.data_to_send(), 510_000)
    assert made.firmware.latch.cause is StopCause.OPERATOR
