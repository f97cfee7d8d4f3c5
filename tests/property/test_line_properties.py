"""The simulated line keeps the order of bytes, obeys the baud rate and bounds the delay."""

from __future__ import annotations

import math
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frames import RECORD, worst_bits
from sim_device.line.line import (
    CAN_QUEUE,
    FIFO_BYTES,
    PACKET,
    TRANSMIT_BYTES,
    CanChannel,
    Channel,
    UartDown,
    UartUp,
)

BAUDS = st.sampled_from([9600, 115_200, 921_600, 3_000_000, 12_000_000])
LATENCIES = st.sampled_from([0, 1, 125, 1_000, 16_000])
WRITES = st.lists(st.tuples(st.integers(0, 30_000), st.binary(max_size=80)), max_size=30)


def unharmed(data: bytes) -> bytes:
    return data


class Arrival(NamedTuple):
    at_us: int
    data: bytes


def run(channel: Channel, writes: list[tuple[int, bytes]]) -> list[Arrival]:
    """Write after each pause, and read at every deadline; return all arrivals."""
    arrivals: list[Arrival] = []
    now_us = 0

    def fetch(until_us: float) -> None:
        while (at_us := channel.next_us()) is not None and at_us <= until_us:
            data = channel.pull(at_us)
            if data:
                arrivals.append(Arrival(at_us, data))
            assert channel.next_us() != at_us or not data, "the next deadline is not later"

    for pause_us, data in writes:
        now_us += pause_us
        fetch(now_us)
        channel.push(data, now_us)
    fetch(math.inf)
    return arrivals


def sent_at(baud: int, writes: list[tuple[int, bytes]]) -> list[int]:
    """Return when each byte (10 bits) leaves a UART with an unlimited buffer, µs rounded up."""
    times, free = [], 0.0
    now_us = 0
    for pause_us, data in writes:
        now_us += pause_us
        free = max(free, float(now_us))
        for _ in data:
            free += 1e7 / baud
            times.append(math.ceil(free - 1e-6))
    return times


@given(BAUDS, LATENCIES, WRITES)
def test_the_uart_keeps_every_byte_in_order_and_its_pace(
    baud: int, latency_us: int, writes: list[tuple[int, bytes]]
) -> None:
    channel = UartUp(baud, latency_us, unharmed)
    arrivals = run(channel, writes)
    whole = b"".join(data for _, data in writes)
    got = b"".join(a.data for a in arrivals)
    assert channel.overrun == len(whole) - len(got)
    if channel.overrun:
        assert baud == 9600, "only 9600 baud is too slow for these writes"
        return
    assert got == whole
    left = sent_at(baud, writes)
    place = 0
    for arrival in arrivals:
        place += len(arrival.data)
        # No byte arrives before it can have left the wire.
        assert left[place - 1] <= arrival.at_us
        first_us = left[place - len(arrival.data)]
        # No byte waits in the adapter for longer than its timer.
        if latency_us:
            assert arrival.at_us <= first_us + latency_us


@given(BAUDS, WRITES)
def test_packets_of_62_go_at_once(baud: int, writes: list[tuple[int, bytes]]) -> None:
    for arrival in run(UartUp(baud, 16_000, unharmed), writes):
        assert len(arrival.data) <= PACKET


def test_ftdi_16_ms_and_62_bytes_by_hand() -> None:
    channel = UartUp(1_000_000, 16_000, unharmed)  # 10 µs a byte, timer at 16, 32, 48 ms...
    assert run(channel, [(100, bytes(10))]) == [(16_000, bytes(10))]
    channel = UartUp(1_000_000, 16_000, unharmed)
    # A packet of 62 bytes is full at 620 µs and restarts the timer.
    # The other 8 bytes wait until 16.62 ms.
    assert run(channel, [(0, bytes(70))]) == [(620, bytes(62)), (16_620, bytes(8))]
    channel = UartUp(1_000_000, 0, unharmed)
    assert run(channel, [(5, bytes(10))]) == [(105, bytes(10))]


def test_a_line_that_is_too_slow_overruns_the_device_s_buffer_only() -> None:
    channel = UartUp(9600, 1_000, unharmed)
    writes = [(10_000, bytes([i % 256]) * 70) for i in range(200)]  # 7000 B/s into 960 B/s
    got = b"".join(a.data for a in run(channel, writes))
    carried = 960 * 1.99 + TRANSMIT_BYTES
    assert abs(len(got) - carried) <= 70
    assert channel.overrun == 200 * 70 - len(got)


@given(BAUDS, WRITES)
def test_towards_the_device_nothing_is_lost_that_there_was_room_for(
    baud: int, writes: list[tuple[int, bytes]]
) -> None:
    channel = UartDown(baud, unharmed)
    arrivals = run(channel, writes)
    whole = b"".join(data for _, data in writes)
    got = b"".join(a.data for a in arrivals)
    assert got == whole
    assert channel.overrun == 0
    assert channel.room() == FIFO_BYTES
    left, place = sent_at(baud, writes), 0
    for arrival in arrivals:
        place += len(arrival.data)
        assert left[place - 1] <= arrival.at_us


def frame(can_id: int, length: int) -> bytes:
    return RECORD.pack(can_id, length, bytes(8))


@given(
    st.sampled_from([10_000, 125_000, 500_000, 1_000_000]),
    st.lists(st.tuples(st.integers(0, 5_000), st.integers(0, 8)), max_size=30),
)
def test_a_bus_is_busy_for_the_duration_of_each_frame(
    bitrate: int, sent: list[tuple[int, int]]
) -> None:
    channel = CanChannel(bitrate, 0, lambda record: [record])
    writes = [(pause_us, frame(i, length)) for i, (pause_us, length) in enumerate(sent)]
    arrivals = run(channel, writes)
    got = b"".join(a.data for a in arrivals)
    assert got == b"".join(data for _, data in writes)
    free, now_us, at = 0.0, 0, {}
    for i, (pause_us, length) in enumerate(sent):
        now_us += pause_us
        free = max(free, now_us) + worst_bits(length) * 1e6 / bitrate
        at[i] = free
    for arrival in arrivals:
        for can_id, _, _ in RECORD.iter_unpack(arrival.data):
            assert at[can_id] - 1e-3 <= arrival.at_us <= at[can_id] + len(sent)


def test_a_bus_repeats_a_damaged_frame_and_drops_frames_without_room() -> None:
    tries: list[bytes] = []

    def damage(record: bytes) -> list[bytes] | None:
        tries.append(record)
        return [record] if len(tries) > 2 else None

    channel = CanChannel(500_000, 0, damage)
    arrivals = run(channel, [(0, frame(1, 8) + frame(2, 8))])
    bits = worst_bits(8)  # 135 bits take 270 µs; the first frame is sent three times
    assert bits == 135
    assert arrivals == [(3 * 270, frame(1, 8)), (4 * 270, frame(2, 8))]

    channel = CanChannel(500_000, 0, lambda record: [record])
    channel.push(frame(1, 8) * (CAN_QUEUE + 5), 0)
    assert channel.overrun == 5 * RECORD.size
    assert channel.room() == 0
