"""The generated C codec on classic CAN, compared with the Python end of the bus."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Annotated

import pytest

from protocol.can.frames import RECORD, CanFrame, from_record
from protocol.can.link import CanLink
from protocol.link import Received, Rejected
from protocol.messages import ALL_MESSAGES
from protocol.messages.device import Encoders, Imu, LogText, Sync
from protocol.schema import message as declared
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.fields import I16, U8, U16, number
from protocol.schema.message import Direction, Message, RateClass
from protocol.uart.framing import DamagedFrame
from support.c_adapter import random_message, words
from support.c_build import generate

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from protocol.link import LinkEvent
    from support.c_build import Adapter

pytestmark = pytest.mark.slow

NODE = 3
MESSAGES = 4_000
FROM_DEVICE = [s for s in CATALOGUE if s.direction is Direction.DEVICE]
FROM_HOST = [s for s in CATALOGUE if s.direction is Direction.HOST]


@pytest.fixture(scope="module")
def adapter(tmp_path_factory: pytest.TempPathFactory) -> Adapter:
    """Return the adapter with the buffer limits of the Python end; the counts must be equal."""
    room = ("-DSP_CAN_OPEN=16", "-DSP_CAN_RECENT=64")
    return generate(tmp_path_factory.mktemp("c_can")).adapter(flags=room, sanitized=True)


@pytest.fixture(scope="module")
def small_adapter(tmp_path_factory: pytest.TempPathFactory) -> Adapter:
    """Return the adapter with the buffer limits of a microcontroller."""
    return generate(tmp_path_factory.mktemp("c_small")).adapter(sanitized=True)


def frames_of(records: bytes) -> list[CanFrame]:
    frames = [
        from_record(records[i : i + RECORD.size]) for i in range(0, len(records), RECORD.size)
    ]
    return [f for f in frames if f is not None]


def spoken(rng: random.Random, count: int) -> list[tuple[Message, int]]:
    """Return a device's messages and their stamps, across an overflow of the clock."""
    t_us = (1 << 32) - 20_000_000
    out: list[tuple[Message, int]] = []
    for i in range(count):
        t_us += rng.randrange(20_000)
        message = random_message(rng, rng.choice(FROM_DEVICE)) if i % 8 else Sync(0)
        out.append((message, t_us & 0xFFFF_FFFF))
    return out


def test_c_sends_the_frames_that_python_sends(adapter: Adapter) -> None:
    rng = random.Random(1)
    printed = spoken(rng, MESSAGES)
    link = CanLink(Direction.DEVICE)
    questions, wanted = [], []
    for message, t_us in printed:
        flags = rng.randrange(4)
        link.send(message, t_us, node=NODE, flags=flags)
        frames = frames_of(link.data_to_send())
        wanted.append("".join(f"{f.can_id}:{f.data.hex()} " for f in frames))
        type_id = CATALOGUE.spec(type(message)).type_id
        questions.append(" ".join(map(str, (type_id, NODE, flags, t_us, *words(message)))))
    assert adapter.ask("can-send", questions) == wanted


def test_python_understands_what_c_sends(adapter: Adapter) -> None:
    imu = Imu(1, -2, 16384, 300, -4, 5, -6)
    messages = [Sync(0), imu, Encoders(7, 65535), LogText(1, "a line of some length"), imu]
    types = [CATALOGUE.spec(type(m)).type_id for m in messages]
    questions = [
        " ".join(map(str, (types[i], NODE, 0, 1_000_000 + 160 * i, *words(m))))
        for i, m in enumerate(messages)
    ]
    link = CanLink(Direction.HOST)
    received: list[tuple[Message, int]] = []
    for answer in adapter.ask("can-send", questions):
        for word in answer.split():
            can_id, data = word.split(":")
            record = RECORD.pack(int(can_id), len(data) // 2, bytes.fromhex(data))
            for event in link.receive(record, 1_000_000):
                assert isinstance(event, Received)
                received.append((event.message, event.frame.t_us))
    assert [m for m, _ in received] == [Sync(1), *messages[1:]]
    assert [t for _, t in received] == [1_000_000 + 160 * i for i in range(len(messages))]


# ---- receiving --------------------------------------------------------------------------------


def troubled(rng: random.Random, records: list[CanFrame]) -> list[CanFrame]:
    """Return a stream with lost, duplicated, cut and corrupted frames.

    Frames of one identifier stay in order.
    """
    out = []
    for frame in records:
        match rng.randrange(40):
            case 0:
                continue
            case 1:
                out += [frame, frame]
            case 2:
                out.append(CanFrame(frame.can_id, frame.data[: rng.randrange(9)]))
            case 3:
                data = bytearray(frame.data or b"\0")
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
                out.append(CanFrame(frame.can_id, bytes(data)))
            case 4:
                out.append(CanFrame(rng.randrange(0x800), rng.randbytes(rng.randrange(9))))
                out.append(frame)
            case _:
                out.append(frame)
    return out


def host_traffic(
    rng: random.Random, catalogue: Catalogue = CATALOGUE, shared: int | None = None
) -> list[tuple[int, CanFrame]]:
    """Return a host's writes, and their arrival times on the device's clock."""
    specs = [s for s in catalogue if s.direction is Direction.HOST]
    link = CanLink(Direction.HOST, codec=Codec(catalogue))
    if shared is not None:
        link.codec.limit(catalogue.by_name["velocity_setpoint"].type_id, shared)
    now_us, arrivals = (1 << 32) - 8_000_000, []
    for _ in range(MESSAGES):
        now_us += rng.choice((0, 500, 2_000, 20_000))
        if rng.random() < 0.002:
            now_us += 3_000_000
        message = random_message(rng, rng.choice(specs))
        late_us = rng.choice((0, 0, 0, 1_000, 30_000, 400_000, 700_000))
        stamp_us = (now_us - late_us + 123_456_789) & 0xFFFF_FFFF
        link.send(message, stamp_us, node=rng.choice((0, NODE)), flags=rng.randrange(4))
        arrivals += [(now_us, f) for f in troubled(rng, frames_of(link.data_to_send()))]
    return arrivals


def sent_by_c(
    adapter: Adapter, arrivals: list[tuple[int, CanFrame]], first: Sequence[str] = ()
) -> list[tuple[str, str]]:
    questions = [f"{t & 0xFFFF_FFFF} {f.can_id} {f.data.hex() or '-'}" for t, f in arrivals]
    printed = adapter.ask("can-hear", [*first, *questions])
    answers = [a.split(" | ") for a in printed]
    return [(event, counts) for event, counts in answers]


def as_c_sends(event: LinkEvent) -> str:
    """Return the event in the adapter's words, up to the payload; "-": not reported by C."""
    if isinstance(event, DamagedFrame):
        return "damaged"
    if isinstance(event, Rejected) and event.reason not in {"payload", "version"}:
        return "-"
    frame = event.frame
    version, flags = frame.version_flags >> 4, frame.version_flags & 15
    return f"{version} {flags} {frame.node} {frame.type_id} 0 {frame.t_us} " + (
        frame.payload.hex() or "-"
    )


def test_c_receives_what_python_receives(adapter: Adapter) -> None:
    arrivals = host_traffic(random.Random(2))
    link = CanLink(Direction.DEVICE)
    complete = 0
    for (now_us, frame), (event, counts) in zip(
        arrivals, sent_by_c(adapter, arrivals), strict=True
    ):
        record = RECORD.pack(frame.can_id, len(frame.data), frame.data)
        events = link.receive(record, now_us)
        wanted = as_c_sends(events[0]) if events else "-"
        if events and isinstance(events[0], Rejected) and event == "-":
            # Too short to have a stamp: C ignores it, Python reports it.
            assert events[0].reason in {"payload", "direction", "type"}
        else:
            printed = event.split()
            assert " ".join(printed[:7]) == wanted
            complete += len(printed) > 1
        s = link.statistics
        assert counts == f"{s.damaged} {s.duplicates} {s.stale} {s.given_up}"
    assert complete > MESSAGES // 2
    s = link.statistics
    assert min(s.damaged, s.duplicates, s.stale, s.given_up) > 10  # every case occurred


PARTS = tuple(map(declared.CanPart, (0x02, 0x03, 0x04), ("velocity", "tools", "suction")))


@declared.message(0x02, Direction.HOST, RateClass.STREAM, default_hz=50, can_parts=PARTS)
class VelocitySetpoint(Message):
    """A velocity setpoint whose second frame has own fields, one of which stands between others."""

    v: Annotated[int, number(I16, "m/s", "forward speed", scale="0.0001")]
    yaw_rate: Annotated[int, number(I16, "rad/s", "counter-clockwise", scale="0.0002")]
    time_to_live: Annotated[int, number(U8, "s", "how long", scale="0.001", high=250)]
    counter: Annotated[int, number(U8, "count", "must advance; wraps")]
    acceleration: Annotated[int, number(U16, "raw", "appended", can_part=1)]
    brush: Annotated[int, number(U8, "raw", "appended", can_part=1)]
    suction: Annotated[int, number(U8, "raw", "appended", can_part=2)]


@pytest.mark.parametrize("shared", [None, 6, 5, 4, 3])
def test_a_host_s_message_in_several_frames(tmp_path: Path, shared: int | None) -> None:
    """The host may know fewer fields of the message, and then sends fewer frames."""
    plain = CATALOGUE.by_name["velocity_setpoint"].cls
    catalogue = Catalogue([VelocitySetpoint, *(m for m in ALL_MESSAGES if m is not plain)])
    grown = catalogue.spec(VelocitySetpoint)
    room = ("-DSP_CAN_OPEN=16", "-DSP_CAN_RECENT=64")
    adapter = generate(tmp_path, catalogue).adapter(flags=room, sanitized=True)
    arrivals = host_traffic(random.Random(4), catalogue, shared)
    device = CanLink(Direction.DEVICE, codec=Codec(catalogue))
    limit = []
    if shared is not None:
        device.codec.limit(grown.type_id, shared)
        limit = [f"limit {grown.type_id} {grown.prefix_layout(shared).size}"]
    answers = sent_by_c(adapter, arrivals, limit)
    complete = 0
    for (now_us, frame), (event, _) in zip(arrivals, answers, strict=True):
        record = RECORD.pack(frame.can_id, len(frame.data), frame.data)
        for received in device.receive(record, now_us):
            if isinstance(received, Received):
                printed = event.split()
                assert " ".join(printed[:7]) == as_c_sends(received)
                complete += received.spec.type_id == grown.type_id
    assert complete > MESSAGES // 40


def test_lost_and_duplicate_segments_never_give_a_wrong_message(small_adapter: Adapter) -> None:
    """With the small bounds of a chip more may be lost, but every delivered message is correct."""
    rng = random.Random(3)
    link = CanLink(Direction.HOST)
    sent: set[str] = set()
    arrivals: list[tuple[int, CanFrame]] = []
    for i in range(MESSAGES):
        spec = rng.choice(FROM_HOST)
        message = random_message(rng, spec)
        link.send(message, i * 1_000, node=NODE)
        _, payload = link.codec.encode(message)
        sent.add(f"{spec.type_id} {payload.hex() or '-'}")
        for frame in frames_of(link.data_to_send()):
            arrivals += [(i * 1_000, frame)] * rng.choice((0, 1, 1, 1, 1, 1, 1, 1, 1, 2))
    received = 0
    for event, _ in sent_by_c(small_adapter, arrivals):
        printed = event.split()
        if len(printed) > 1:
            assert printed[0] == str(PROTOCOL_VERSION)
            assert f"{printed[3]} {printed[6]}" in sent
            received += 1
    assert received > MESSAGES // 2
