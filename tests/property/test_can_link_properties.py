"""A CAN link with loss, duplicates and reordering: every delivered message was sent."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.can.stamps import OLDEST_US, StampExtender
from protocol.can.transfers import MAX_CONTENT, MAX_OPEN
from protocol.errors import FieldRangeError
from protocol.link import LinkEvent, Received, Rejected
from protocol.messages import ALL_MESSAGES
from protocol.messages.device import Imu, PlannerState, Status, Sync
from protocol.messages.host import Stop, StopAll, TimeRequest
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction, Message, MessageSpec
from protocol.uart.framing import CRC, DamagedFrame
from support import strategies as wire

if TYPE_CHECKING:
    from collections.abc import Iterable

pytestmark = pytest.mark.slow

HOST, DEVICE = Direction.HOST, Direction.DEVICE
SPECS = list(CATALOGUE)
STEP_US = 2_000
"""Time between two messages of a conversation, µs."""
OTHER_END = {HOST: DEVICE, DEVICE: HOST}


def records_of(data: bytes) -> list[bytes]:
    return [data[i : i + RECORD.size] for i in range(0, len(data), RECORD.size)]


def synced(sends: Direction, now_us: int, node: int = 1) -> bytes:
    """Return frames that give the receiver the sender's clock."""
    link = CanLink(sends)
    link.send(Sync(0) if sends is DEVICE else TimeRequest(0), now_us, node=node)
    return link.data_to_send()


def same(ours: Message, theirs: Message) -> bool:
    """Return whether both are equal, except the IMU's temperature, which is sent once a second."""
    if isinstance(ours, Imu) and isinstance(theirs, Imu):
        return tuple(ours)[:3] + tuple(ours)[4:] == tuple(theirs)[:3] + tuple(theirs)[4:]
    if isinstance(ours, Sync):
        return isinstance(theirs, Sync)  # the link sets the count
    return ours == theirs


@pytest.mark.parametrize("spec", SPECS, ids=lambda s: s.name)
@settings(max_examples=20)
@given(data=st.data())
def test_every_message_there_and_back(spec: MessageSpec, data: st.DataObject) -> None:
    message = wire.message_of(spec.type_id, data.draw(wire.values_of(spec.type_id)))
    node, flags = data.draw(wire.nodes), data.draw(st.integers(0, 7))
    t_us = data.draw(wire.t_us_values)
    sender, receiver = CanLink(spec.direction), CanLink(OTHER_END[spec.direction])
    receiver.receive(synced(spec.direction, t_us - 50, node), t_us)
    sender.send(message, t_us, node=node, flags=flags)
    (event,) = receiver.receive(sender.data_to_send(), t_us + 100)
    assert isinstance(event, Received)
    if not isinstance(message, Sync):
        assert event.message == message
    assert event.spec is spec
    frame = event.frame
    assert (frame.node, frame.type_id) == (node, spec.type_id)
    if spec.is_bare:  # a frame without a time stamp and flags
        assert (frame.t_us, frame.flags) == (0, 0)
        return
    assert frame.t_us in {t_us, t_us & ~15}
    if spec.rate.value != "stream":
        assert frame.flags == flags


def test_the_flag_that_can_needs_is_rejected() -> None:
    with pytest.raises(FieldRangeError):
        CanLink(HOST).send(Stop(1, 1), 0, node=1, flags=8)


class Conversation:
    """Random messages of one side, and their frames."""

    def __init__(self, sends: Direction, rng: random.Random, count: int) -> None:
        link = CanLink(sends)
        kinds = [s for s in SPECS if s.direction is sends]
        self.sent: dict[int, list[Message]] = {}
        self.frames: list[tuple[int, bytes]] = []
        for i in range(count):
            now_us = 1_000_000 + i * STEP_US
            spec = rng.choice(kinds)
            message = random_message(spec, rng)
            self.sent.setdefault(now_us & ~15, []).append(message)
            link.send(message, now_us, node=1)
            self.frames += [(now_us, r) for r in records_of(link.data_to_send())]

    def hold(self, events: Iterable[LinkEvent]) -> int:
        """Check that every delivered message was sent with its time stamp; return their number.

        ``StopAll`` has no time stamp: every copy is accepted, and none is counted.
        """
        count = 0
        for event in events:
            assert isinstance(event, Received | DamagedFrame), event
            if isinstance(event, Received):
                count += not event.spec.is_bare
                sent = self.sent.get(event.frame.t_us & ~15, [])
                if event.spec.is_bare:
                    sent = [message for each in self.sent.values() for message in each]
                assert any(same(event.message, m) for m in sent), (event, sent)
        return count


def random_message(spec: MessageSpec, rng: random.Random) -> Message:
    values: list[object] = []
    for field in spec.fields:
        if field.wire.is_text:
            values.append("".join(rng.choice("abcdef") for _ in range(rng.randrange(60))))
        elif field.wire.is_integer:
            values.append(
                rng.choice([field.wire.low, rng.randint(field.wire.low, field.wire.high)])
            )
        else:
            values.append(rng.randbytes(field.wire.size))
    return spec.cls(*values)


@pytest.mark.parametrize("sends", [HOST, DEVICE])
@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    loss=st.sampled_from([0.0, 0.05, 0.5]),
    double=st.sampled_from([0.0, 0.1, 0.5]),
    swap=st.sampled_from([0.0, 0.05, 0.3]),
)
def test_no_wrong_message_after_any_frame_damage(
    sends: Direction, seed: int, loss: float, double: float, swap: float
) -> None:
    rng = random.Random(seed)
    talk = Conversation(sends, rng, 80)
    receiver = CanLink(OTHER_END[sends])
    receiver.receive(synced(sends, 999_000), 999_000)
    frames = [f for f in talk.frames if rng.random() >= loss]
    for i in range(1, len(frames)):
        if rng.random() < swap:
            frames[i - 1], frames[i] = frames[i], frames[i - 1]
    given_out, now_us = 0, 0
    for at_us, record in frames:
        now_us = max(now_us, at_us)
        for _ in range(2 if rng.random() < double else 1):
            given_out += talk.hold(receiver.receive(record, now_us))
    if loss == swap == 0.0:
        sent = [message for messages in talk.sent.values() for message in messages]
        assert given_out == sum(not isinstance(message, StopAll) for message in sent)
        assert receiver.statistics.lost == 0


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32))
def test_lost_runs_of_segments_never_pass(seed: int) -> None:
    """An even number of lost segments leaves the toggle bit correct; the CRC detects the loss."""
    rng = random.Random(seed)
    hello = next(s for s in SPECS if s.name == "hello")
    sender, receiver = CanLink(DEVICE), CanLink(HOST)
    messages = [random_message(hello, rng) for _ in range(20)]
    for i, message in enumerate(messages):
        sender.send(message, i * 50_000, node=1)
        records = records_of(sender.data_to_send())
        first = rng.randrange(1, len(records) - 1)
        count = rng.choice([2, 4, 6])
        del records[first : first + count]
        for event in receiver.receive(b"".join(records), i * 50_000):
            assert not isinstance(event, Received)


@settings(max_examples=30)
@given(
    frames=st.lists(
        st.tuples(st.integers(0, 0xFFFF_FFFF), st.integers(0, 255), st.binary(max_size=8)),
        max_size=60,
    ),
    side=st.sampled_from([HOST, DEVICE]),
)
def test_any_frames_and_bounded_memory(
    frames: list[tuple[int, int, bytes]], side: Direction
) -> None:
    link = CanLink(side)
    data = b"".join(RECORD.pack(i, n, d) for i, n, d in frames)
    data += b"".join(RECORD.pack(i & 0x7FF, len(d), d) for i, _, d in frames)
    for event in link.receive(data, 0):
        assert isinstance(event, Received | Rejected | DamagedFrame)


def test_open_transfers_are_bounded() -> None:
    link = CanLink(HOST)
    hello = 0x1B
    for turn in range(200):
        for node in range(16):
            for can_type in (hello, 0x79, 0x78, 0x18):
                tail = 0xA0 if turn == 0 else (0x20 if turn % 2 == 0 else 0)
                link.receive(RECORD.pack(can_type << 4 | node, 8, bytes(7) + bytes([tail])), turn)
    assert link.held_bytes <= MAX_OPEN * (MAX_CONTENT + CRC.size)
    assert link.statistics.given_up >= 64 - MAX_OPEN


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), sizes=st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_the_same_events_however_the_bytes_are_cut(seed: int, sizes: list[int]) -> None:
    talk = Conversation(DEVICE, random.Random(seed), 20)
    data = synced(DEVICE, 999_000) + b"".join(record for _, record in talk.frames)
    whole, pieces = CanLink(HOST), CanLink(HOST)
    expected = whole.receive(data, 1_000_000)
    found: list[LinkEvent] = []
    at = turn = 0
    while at < len(data):
        size = sizes[turn % len(sizes)]
        found += pieces.receive(data[at : at + size], 1_000_000)
        at, turn = at + size, turn + 1
    assert found == expected
    assert pieces.statistics == whole.statistics


@settings(max_examples=200)
@given(
    start=st.integers(0, 0xFFFF_FFFF),
    ahead=st.integers(-(1 << 33), 1 << 33),
    steps=st.lists(
        st.tuples(
            st.integers(0, 200_000),  # time since the last frame
            st.integers(0, 1_400_000),  # transmission delay
            st.booleans(),  # whether the frame carries a full stamp
        ),
        min_size=1,
        max_size=60,
    ),
)
def test_a_stamp_is_right_or_rejected(
    start: int, ahead: int, steps: list[tuple[int, int, bool]]
) -> None:
    extender = StampExtender()
    true_us, arrived_us, seen_us = start, start + ahead, None
    for gap_us, delay_us, whole in steps:
        true_us += gap_us
        arrived_us = max(arrived_us, true_us + ahead + delay_us)  # a bus keeps the order
        if whole:
            extender.whole(true_us & 0xFFFF_FFFF, arrived_us)
            seen_us = true_us
            continue
        stamp = extender.short(true_us >> 4 & 0xFFFF, arrived_us)
        if seen_us is None:
            assert stamp is None
        elif stamp is not None and true_us - seen_us < OLDEST_US:
            assert stamp % (1 << 20) == (true_us & ~15) % (1 << 20)
            assert (stamp - true_us & ~15) % (1 << 32) in {0, (1 << 32) - 16}
            seen_us = true_us


@pytest.mark.parametrize(
    ("age_us", "taken"), [(0, True), (499_000, True), (510_000, False), (1_100_000, False)]
)
def test_an_old_stamp_is_dropped_and_counted(age_us: int, taken: bool) -> None:  # noqa: FBT001 - a case
    sender, receiver = CanLink(DEVICE), CanLink(HOST)
    receiver.receive(synced(DEVICE, 5_000_000), 77_000_000)
    sender.send(Status(0, 0, 0, 0, 0), 5_000_100, node=1)
    events = receiver.receive(sender.data_to_send(), 77_000_100 + age_us)
    assert bool(events) is taken
    assert receiver.statistics.stale == (0 if taken else 1)


def test_halves_without_their_partner_are_dropped_and_counted() -> None:
    sender, receiver = CanLink(DEVICE), CanLink(HOST)
    receiver.receive(synced(DEVICE, 0), 0)
    given_out = 0
    for i in range(10):
        t_us = 10_000 * i
        sender.send(Imu(i, 0, 0, 5, 0, 0, i), t_us, node=1)
        records = records_of(sender.data_to_send())
        if i in {3, 4}:
            del records[i - 3]  # the accelerometer's part, then the gyroscope's
        events = receiver.receive(b"".join(records), t_us)
        assert all(isinstance(e, Received) and e.message.gyro_z == i for e in events)  # type: ignore[attr-defined]
        given_out += len(events)
    assert given_out == 8
    assert receiver.statistics.incomplete == 2
    sender.send(PlannerState(1, 2, 3, 4, 5, 6, 7, 1), 100_000, node=1)
    first, second = records_of(sender.data_to_send())
    assert receiver.receive(second, 100_000) == []
    (event,) = receiver.receive(first, 100_000)
    assert isinstance(event, Received)
    assert event.message == PlannerState(1, 2, 3, 4, 5, 6, 7, 1)
    assert receiver.statistics.incomplete == 2


def test_losses_are_shown_by_sync() -> None:
    sender, receiver = CanLink(DEVICE), CanLink(HOST)
    lost = 0
    for i in range(40):
        t_us = 10_000 * i
        sender.send(Imu(i, 0, 0, 5, 0, 0, 0), t_us, node=1)
        if i % 10 == 0:
            sender.send(Sync(0), t_us, node=1)
        records = records_of(sender.data_to_send())
        if i in {5, 15, 16}:
            lost += len(records)
            continue
        receiver.receive(b"".join(records) * (2 if i == 22 else 1), t_us)
    assert lost == 6
    assert receiver.statistics.lost == 6
    assert receiver.statistics.duplicates == 2
    assert receiver.statistics.reordered == 0


def older(cls: type[Message], kept: int) -> Catalogue:
    """Return a catalogue in which ``cls`` has only its first ``kept`` fields."""
    catalogue = Catalogue(ALL_MESSAGES)
    spec = catalogue.spec(cls)
    fields = spec.fields[:kept]
    parts = spec.can_parts[: 1 + max(field.can_part for field in fields)]
    layout = spec.prefix_layout(kept)
    short = replace(spec, fields=fields, layout=layout, can_parts=parts)
    catalogue.by_type[spec.type_id] = short
    catalogue.by_class[cls] = short
    catalogue.specs = tuple(short if s is spec else s for s in catalogue.specs)
    return catalogue


@pytest.mark.parametrize("kept", [4, 5, 7])
def test_an_older_peer_sends_the_parts_that_it_has(kept: int) -> None:
    values = (1, 2, 3, -4, 5, 6, 7, 1)
    codec = Codec(Catalogue(ALL_MESSAGES))
    codec.limit(CATALOGUE.spec(PlannerState).type_id, kept)
    sender, receiver = CanLink(DEVICE, codec=codec), CanLink(HOST)
    receiver.codec.limit(CATALOGUE.spec(PlannerState).type_id, kept)
    receiver.receive(synced(DEVICE, 0), 0)
    sender.send(PlannerState(*values), 1_000, node=1)
    data = sender.data_to_send()
    assert len(data) == RECORD.size * (1 if kept == 4 else 2)
    (event,) = receiver.receive(data, 1_000)
    assert isinstance(event, Received)
    assert tuple(event.message) == values[:kept] + (None,) * (8 - kept)
    # The receiver declares fewer fields than its newer peer.
    receiver = CanLink(HOST, codec=Codec(older(PlannerState, kept)))
    receiver.codec.limit(CATALOGUE.spec(PlannerState).type_id, kept)
    receiver.receive(synced(DEVICE, 0), 0)
    sender = CanLink(DEVICE)
    sender.send(PlannerState(*values), 1_000, node=1)
    received = [
        e for e in receiver.receive(sender.data_to_send(), 1_000) if isinstance(e, Received)
    ]
    assert [tuple(e.message)[:kept] for e in received] == [values[:kept]]
    shared = sum(f.wire.size for f in CATALOGUE.spec(PlannerState).fields[:kept])
    if kept == 4:  # the receiver has no type for the second part
        assert receiver.statistics.rejected == 1
    else:
        assert receiver.codec.extra_bytes == 12 - shared
