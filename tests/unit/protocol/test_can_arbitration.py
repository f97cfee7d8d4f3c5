"""Two senders of the same stop on a CAN bus, in a bit-level model of the bus."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import pytest

from protocol.can.frames import RECORD, CanFrame, from_record
from protocol.can.link import CanLink
from protocol.can.transfers import content, segments
from protocol.messages.host import Stop, StopAll, VelocitySetpoint
from protocol.schema.message import Direction, Message
from support.can_bus import frame_bits

ARBITRATION_BITS = 12
"""Number of arbitration bits, identifier and RTR (ISO 11898-1: 10.9.2). A sender that sends 1 and
reads 0 in one of these bits has lost the arbitration."""
CRC_POLYNOMIAL = 0x4599
STUFF_AFTER = 5
TAIL = (1, 1, 1, *(1,) * 7, *(1,) * 3)
"""Bits at the end without stuffing: CRC delimiter, ACK slot, ACK delimiter, end of frame and
intermission."""
ACK = 1
"""Index of the ACK slot in the tail. A receiver sends 0 in this slot."""


class Bit(NamedTuple):
    """One bit of a frame on the bus."""

    value: int
    in_arbitration: bool
    is_ack: bool = False


def coded(frame: CanFrame) -> list[Bit]:
    """Return the bits of a data frame with an 11-bit identifier, from start bit to intermission."""
    length = len(frame.data)
    head = [0, *(frame.can_id >> i & 1 for i in range(10, -1, -1)), 0, 0, 0]
    head += [length >> i & 1 for i in range(3, -1, -1)]
    body = head + [byte >> i & 1 for byte in frame.data for i in range(7, -1, -1)]
    crc = 0
    for bit in body:
        crc = crc << 1 & 0x7FFF ^ (CRC_POLYNOMIAL if bit ^ crc >> 14 else 0)
    body += [crc >> i & 1 for i in range(14, -1, -1)]
    out: list[Bit] = []
    run = 0
    for place, bit in enumerate(body):
        arbitrates = 1 <= place <= ARBITRATION_BITS
        run = run + 1 if out and out[-1].value == bit else 1
        out.append(Bit(bit, arbitrates))
        if run == STUFF_AFTER:
            out.append(Bit(1 - bit, in_arbitration=False))
            run = 1
    return out + [Bit(bit, in_arbitration=False, is_ack=i == ACK) for i, bit in enumerate(TAIL)]


class Outcome(NamedTuple):
    """Outcome of a transmission of several senders that begin in the same bit."""

    done: list[int]
    lost: list[int]
    errors: list[int]
    """Senders that read a bit different from the bit that they sent, and began an error frame."""
    bits: int


def on_the_bus(*frames: CanFrame) -> Outcome:
    """Send all frames at once to a receiver that acknowledges. An error frame ends the run."""
    streams = [coded(frame) for frame in frames]
    sending = set(range(len(frames)))
    lost: list[int] = []
    place = 0
    while any(place < len(streams[i]) for i in sending):
        sent = {i: streams[i][place] for i in sending if place < len(streams[i])}
        level = min(bit.value for bit in sent.values())
        if any(bit.is_ack for bit in sent.values()):
            level = 0
        errors: list[int] = []
        for i, bit in sent.items():
            if bit.value == level or bit.is_ack:
                continue
            (lost if bit.in_arbitration else errors).append(i)
        if errors:
            return Outcome([], lost, errors, place)
        sending -= set(lost)
        place += 1
    return Outcome(sorted(sending), sorted(lost), [], place)


def sent(message: Message, t_us: int, node: int, sends: int = 1) -> CanFrame:
    """Return the single frame of a message that was sent ``sends`` times."""
    link = CanLink(Direction.HOST)
    for _ in range(sends):
        link.send(message, t_us, node=node)
        data = link.data_to_send()
    frame = from_record(data[: RECORD.size])
    assert frame is not None
    return frame


SENDERS = [(t_us, sends) for t_us in (0, 16, 1_000_000, 0xFFFF_FFFF) for sends in (1, 2, 7)]


@pytest.mark.parametrize(
    "frame", [CanFrame(0, b""), CanFrame(0x015, bytes(7)), CanFrame(0x7FF, b"\xff" * 8)]
)
def test_frame_lengths_match_the_bus_load_table(frame: CanFrame) -> None:
    outcome = on_the_bus(frame)
    assert (outcome.done, outcome.errors) == ([0], [])
    assert outcome.bits == frame_bits(frame)


@pytest.mark.parametrize("others", [2, 3])
def test_stops_of_every_device_from_several_senders_are_one_frame(others: int) -> None:
    """Both senders succeed without an error frame, whatever their clocks and frame counts are."""
    for how in product(SENDERS, repeat=2):
        frames = [sent(StopAll(), t_us, 0, sends) for t_us, sends in how]
        frames += [CanFrame(0, b"")] * (others - 2)
        outcome = on_the_bus(*frames)
        assert (outcome.done, outcome.lost, outcome.errors) == (list(range(others)), [], [])


def test_the_stop_of_version_1_from_two_senders_collides() -> None:
    """After the common identifier, this stop had a command id, time stamp and transfer number."""

    def version_1(command_id: int, t_us: int) -> CanFrame:
        payload = command_id.to_bytes(2, "little") + b"\x04"
        return CanFrame(0x000, segments(content(0x10, t_us, payload), 0)[0])

    collided = 0
    for t_us in range(16, 16 * 200, 16):
        outcome = on_the_bus(version_1(7, 0), version_1(7, t_us))
        collided += bool(outcome.errors)
    assert collided == 199, "different time stamps are enough"
    assert on_the_bus(version_1(7, 0), version_1(8, 0)).errors
    assert on_the_bus(version_1(7, 0), version_1(7, 0)).done == [0, 1]


def test_a_stop_wins_arbitration_over_all_else_and_the_rest_follows() -> None:
    urgent = sent(StopAll(), 5, 0)
    addressed = sent(Stop(1, 4), 5, 1)
    setpoint = sent(VelocitySetpoint(1, 2, 200, 3), 5, 1)
    assert on_the_bus(setpoint, addressed, urgent) == (
        [2],
        [0, 1],
        [],
        frame_bits(urgent),
    )
    assert on_the_bus(setpoint, addressed).done == [1]
