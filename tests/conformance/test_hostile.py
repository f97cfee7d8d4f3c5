"""The device obeys only intact frames, and damaged or random bytes do not disturb it."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from protocol.can.transfers import content, segments
from protocol.messages.device import Ack, DescribeReply, Encoders, Hello, Nack, TimeReply
from protocol.messages.host import (
    ClearStop,
    Describe,
    GetParameter,
    HostHello,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetKey,
    SetMode,
    SetParameter,
    SetStreamRate,
    Stop,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.messages.values import Mode, ParameterKind, PlannerAction, RebootKind, StopCause
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from support.probe import now_us
from support.reference_codec import frame_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from protocol.schema.message import Message
    from support.probe import Probe

SEED = 20_240
TIME_REQUEST, STOP, SET_MODE, STATUS = 0x07, 0x01, 0x06, 0x11
UNKNOWN_TYPES = (0x03, 0x0F, 0x3F, 0x7E)
FUZZ_BYTES = 12_000
"""Number of random bytes; they take a second on the slowest known line."""


def frame(  # noqa: PLR0913 - the header's fields
    device: Probe,
    type_id: int,
    payload: bytes,
    *,
    version: int = PROTOCOL_VERSION,
    flags: int = 0,
    node: int | None = None,
) -> bytes:
    """Return a complete frame, made by the reference codec."""
    return frame_bytes(
        version=version,
        flags=flags,
        node=(device.node or 0) if node is None else node,
        type_id=type_id,
        seq=random.Random(now_us()).randrange(256),
        t_us=now_us() & 0xFFFF_FFFF,
        payload=payload,
    )


def pings_answered(device: Probe, mark: int) -> list[int]:
    return [reply.ping for reply in device.of(TimeReply, mark)]


def quiet(device: Probe) -> None:
    """Open a session at a standstill, with few streams."""
    device.handshake()
    device.stop()


# ---- UART -------------------------------------------------------------------------------


@pytest.mark.link("uart")
def test_a_reference_codecs_frame_is_understood(device: Probe) -> None:
    quiet(device)
    mark = len(device.received)
    device.write(frame(device, TIME_REQUEST, b"\x5a"))
    assert device.wait_for(TimeReply, mark=mark, such=lambda r: r.ping == 0x5A)


@pytest.mark.link("uart")
def test_lone_zeros_are_no_error(device: Probe) -> None:
    quiet(device)
    before = device.counters().damaged
    device.write(bytes(300))
    device.alive()
    assert device.counters().damaged == before


@pytest.mark.link("uart")
def test_a_damaged_frame_is_counted_and_not_obeyed(device: Probe) -> None:
    quiet(device)
    before = device.counters().damaged
    mark = len(device.received)
    whole = frame(device, TIME_REQUEST, b"\xc3")
    damaged = []
    for bit in range(8 * 2, 8 * (len(whole) - 1), 3):
        broken = bytearray(whole)
        broken[bit // 8] ^= 1 << bit % 8
        if 0 not in broken[1:-1]:  # a zero would split the frame
            damaged.append(bytes(broken))
    for broken_frame in damaged:
        device.write(broken_frame)
        device.listen(0.005)
    device.alive()
    assert 0xC3 not in pings_answered(device, mark), "a damaged frame was obeyed"
    assert (device.counters().damaged - before) % 0x10000 == len(damaged)


@pytest.mark.link("uart")
def test_a_cut_frame_costs_no_intact_one(device: Probe) -> None:
    quiet(device)
    mark = len(device.received)
    whole = frame(device, TIME_REQUEST, b"\x11")
    for number in range(1, 11):
        device.write(whole[: 4 + number])  # the tail is lost; the next frame begins with a zero
        device.write(frame(device, TIME_REQUEST, bytes((number,))))
        device.listen(0.01)
    device.ping()
    answered = pings_answered(device, mark)
    assert [p for p in answered if p in range(1, 11)] == list(range(1, 11))


@pytest.mark.link("uart")
def test_a_frame_may_come_byte_by_byte(device: Probe) -> None:
    quiet(device)
    mark = len(device.received)
    for byte in frame(device, TIME_REQUEST, b"\x42"):
        device.write(bytes((byte,)))
        device.listen(0.002)
    assert device.wait_for(TimeReply, mark=mark, such=lambda r: r.ping == 0x42)


@pytest.mark.link("uart")
@pytest.mark.parametrize("length", [254, 255, 256, 400, 3000])
def test_an_overlong_stretch_is_dropped(device: Probe, length: int) -> None:
    quiet(device)
    device.write(b"\0" + b"\x55" * length + b"\0")
    mark = len(device.received)
    device.write(frame(device, TIME_REQUEST, b"\x77"))
    assert device.wait_for(TimeReply, mark=mark, such=lambda r: r.ping == 0x77), "next frame lost"


@pytest.mark.link("uart")
@pytest.mark.parametrize("version", [0, 1, 3, 15])
def test_another_version_is_not_obeyed(device: Probe, version: int) -> None:
    quiet(device)
    mark = len(device.received)
    device.write(frame(device, TIME_REQUEST, b"\x31", version=version))
    device.alive()
    assert 0x31 not in pings_answered(device, mark)


@pytest.mark.link("uart")
def test_a_payload_of_another_length_is_not_obeyed(device: Probe) -> None:
    device.handshake()
    device.free()
    mark = len(device.received)
    command_id = device.next_id()
    head = command_id.to_bytes(2, "little")
    for payload in (head + b"\x01\x00", head, b"", bytes(100)):
        device.write(frame(device, SET_MODE, payload))
    device.alive()
    assert device.status().mode == Mode.IDLE
    assert not any(type(r).__name__ == "Ack" for r in device.replies(command_id, SET_MODE, mark))


@pytest.mark.link("uart")
def test_garbage_leaves_it_alive(device: Probe) -> None:
    quiet(device)
    rng = random.Random(SEED)
    sent = 0
    while sent < FUZZ_BYTES:
        noise = rng.randbytes(rng.randrange(1, 400))
        device.write(noise)
        sent += len(noise)
        device.listen(len(noise) / 11_000)
    device.write(b"\0")
    device.alive()
    still_itself(device)


@pytest.mark.link("uart")
def test_mutated_frames_leave_it_alive(device: Probe) -> None:
    """The bytes are frames of a host, cut or joined, with bytes changed, inserted or removed."""
    quiet(device)
    rng = random.Random(SEED)
    sent = 0
    while sent < FUZZ_BYTES:
        piece = bytearray(frame(device, *random_harmless(rng)))
        for _ in range(rng.randrange(4)):
            at = rng.randrange(len(piece))
            match rng.randrange(4):
                case 0:
                    piece[at] = rng.randrange(256)
                case 1:
                    piece.insert(at, rng.randrange(256))
                case 2 if len(piece) > 1:
                    del piece[at]
                case _:
                    piece = piece[: at + 1]
        device.write(bytes(piece))
        sent += len(piece)
        device.listen(len(piece) / 11_000)
    device.write(b"\0")
    device.alive()
    still_itself(device)


# ---- CAN --------------------------------------------------------------------------------


def bus_frames(device: Probe, message: Message, transfer_id: int) -> Iterable[tuple[int, bytes]]:
    """Return the segments of a message that is not periodic."""
    spec = CATALOGUE.by_class[type(message)]
    _, payload = device.link.codec.encode(message)
    whole = content(PROTOCOL_VERSION << 4, now_us(), payload)
    can_id = spec.type_id << 4 | (device.node or 0)
    return [(can_id, data) for data in segments(whole, transfer_id)]


@pytest.mark.link("can")
def test_a_segment_that_is_lost_loses_its_message_only(device: Probe) -> None:
    quiet(device)
    known = device.hello
    hello = HostHello(0, 0x1234_5678, device.boot_id, 1, "a name of several segments")
    frames = list(bus_frames(device, hello, 3))
    assert len(frames) > 3
    mark = len(device.received)
    for left_out in range(len(frames)):
        for index, (can_id, data) in enumerate(frames):
            if index != left_out:
                device.write_frame(can_id, data)
        device.listen(0.05)
    named = {h.session_id for h in device.of(Hello, mark)}
    assert 0x1234_5678 not in named, "a hello with a missing segment was obeyed"
    assert known is not None
    device.alive()


@pytest.mark.link("can")
def test_a_transfer_with_a_wrong_check_is_not_obeyed(device: Probe) -> None:
    quiet(device)
    hello = HostHello(0, 0x1234_5678, device.boot_id, 1, "a name of several segments")
    mark = len(device.received)
    frames = list(bus_frames(device, hello, 5))
    can_id, data = frames[2]
    frames[2] = (can_id, bytes((data[0] ^ 1, *data[1:])))
    for one in frames:
        device.write_frame(*one)
    device.listen(0.1)
    assert 0x1234_5678 not in {h.session_id for h in device.of(Hello, mark)}
    device.alive()


@pytest.mark.link("can")
def test_a_duplicate_frame_counts_once(device: Probe) -> None:
    quiet(device)
    mark = len(device.received)
    for one in bus_frames(device, TimeRequest(0x61), 9):
        device.write_frame(*one)
        device.write_frame(*one)
    device.alive()
    assert pings_answered(device, mark).count(0x61) == 1


@pytest.mark.link("can")
def test_random_frames_leave_it_alive(device: Probe) -> None:
    """The frames have any length and any identifier except those of harmful commands."""
    quiet(device)
    rng = random.Random(SEED)
    types = [
        t for t in range(0x7F) if t not in {0x71, 0x72, 0x0E, 0x00, STOP, 0x05, SET_MODE, 0x09}
    ]
    for _ in range(700):
        can_id = rng.choice(types) << 4 | rng.choice([device.node or 1, 0, 9])
        device.write_frame(can_id, rng.randbytes(rng.randrange(9)))
        device.listen(0.001)
    device.alive()
    still_itself(device)


# ---- both -------------------------------------------------------------------------------


def random_harmless(rng: random.Random) -> tuple[int, bytes]:
    """Return type and payload of a host message without lasting effects."""
    messages: tuple[Message, ...] = (
        TimeRequest(rng.randrange(256)),
        Describe(rng.randrange(127), rng.randrange(256)),
        VelocitySetpoint(rng.randrange(-900, 900), 0, rng.randrange(251), rng.randrange(256)),
        GetParameter(rng.randrange(0x10000), rng.randrange(256)),
        SetStreamRate(rng.randrange(0x10000), rng.randrange(127), rng.randrange(0x10000)),
        Stop(rng.randrange(0x10000), StopCause.OPERATOR),
    )
    message = rng.choice(messages)
    spec = CATALOGUE.by_class[type(message)]
    return spec.type_id, spec.layout.pack(*message)


def still_itself(device: Probe) -> None:
    """Check that the device did not reboot, accepts a handshake, and is idle and stopped."""
    before = device.hello
    hello = device.handshake()
    assert before is not None
    assert hello.boot_id == before.boot_id, "the device rebooted"
    status = device.status()
    assert status.mode == Mode.IDLE
    assert status.stop_cause == StopCause.OPERATOR


@pytest.mark.parametrize("type_id", UNKNOWN_TYPES)
def test_an_unknown_type_is_ignored(device: Probe, type_id: int) -> None:
    quiet(device)
    device.ping()
    mark = len(device.received)
    if device.on_can:
        whole = content(PROTOCOL_VERSION << 4, now_us(), bytes(4))
        for data in segments(whole, 1):
            device.write_frame(type_id << 4 | (device.node or 0), data)
    else:
        device.write(frame(device, type_id, bytes(4)))
    device.alive()
    answers = [h for h in device.received[mark:] if type(h.message).__name__ in {"Ack", "Nack"}]
    assert not answers, f"the device answered {answers}"


def test_a_devices_own_message_is_ignored(device: Probe) -> None:
    quiet(device)
    mark = len(device.received)
    spec = CATALOGUE.by_class[Encoders]
    if device.on_can:
        device.write_frame(spec.type_id << 4 | (device.node or 0), bytes(6))
    else:
        device.write(frame(device, spec.type_id, bytes(4)))
        device.write(frame(device, 0x19, bytes(3)))
    device.alive()
    answers = [h for h in device.received[mark:] if type(h.message).__name__ in {"Ack", "Nack"}]
    assert not answers


def test_node_0_is_for_stop_hello_and_time_alone(device: Probe) -> None:
    """The device ignores every other message to node 0: nothing changes, and no answer is sent."""
    device.handshake()
    device.enter(Mode.VELOCITY)
    before = device.status()
    mark = len(device.received)
    ids = [device.next_id() for _ in range(9)]
    for message in (
        VelocitySetpoint(0, 0, 240, 1),
        WheelDuty(0, 0, 240, 1),
        Describe(STOP, 0),
        SetMode(ids[0], Mode.IDLE),
        ClearStop(ids[1], StopCause.OPERATOR),
        PlannerCommand(ids[2], PlannerAction.ABORT, 0),
        GetParameter(ids[3], 0),
        SetParameter(ids[4], 0, ParameterKind.U32, 0),
        SaveParameters(ids[5]),
        SetStreamRate(ids[6], STATUS, 0),
        Reboot(ids[7], RebootKind.NORMAL),
        SetKey(ids[8], 0, 0, 0, 0),
    ):
        device.send(message, node=0)
    status = device.status()
    assert (status.mode, status.setpoint_remaining) == (before.mode, 0), (
        "the device obeyed a message to node 0"
    )
    assert not device.of(DescribeReply, mark), "a describe to node 0 was answered"
    answers: list[Ack | Nack] = [*device.of(Ack, mark), *device.of(Nack, mark)]
    assert not [m for m in answers if m.command_id in ids], "a command to node 0 was answered"
    device.stop()
    device.reply_to(ClearStop(ids[1], StopCause.OPERATOR))  # its first copy was ignored
    assert device.status().stop_cause == StopCause.NONE


def test_another_nodes_messages_are_ignored(device: Probe) -> None:
    device.handshake()
    device.free()
    other = 15 if device.node != 15 else 14
    mark = len(device.received)
    command_id = device.next_id()
    device.send(Stop(command_id, StopCause.HARDWARE), node=other)
    device.send(TimeRequest(0x99), node=other)
    device.send(
        HostHello(CATALOGUE.hash, 0x0BAD_CAFE, device.boot_id, 1, "another host"), node=other
    )
    device.listen(0.2)
    assert device.status().stop_cause == StopCause.NONE, "a stop for another node was obeyed"
    assert not device.replies(command_id, STOP, mark), "a stop for another node was answered"
    assert 0x0BAD_CAFE not in {h.session_id for h in device.of(Hello, mark)}
    device.stop()
