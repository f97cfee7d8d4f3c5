"""Arbitrary bytes raise no exception at either end, and no byte moves the robot by accident."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.run.mission import Mission
from protocol.clock import HostNs
from support.ends import Ends, HostEnd, spinning_host, sweeper
from support.strategies import cut, damaged, reference_frames, streams

pytestmark = pytest.mark.slow

deliveries = st.lists(
    st.tuples(
        st.one_of(streams, reference_frames(), st.binary(max_size=300)),
        st.one_of(st.integers(0, 30_000), st.integers(0, 2_500_000)),
    ),
    max_size=12,
)


@given(deliveries)
@settings(max_examples=60)
def test_random_bytes_neither_break_nor_move_the_device(pieces: list[tuple[bytes, int]]) -> None:
    """The bytes include valid frames of every kind.

    Random frames cause no motion, because motion needs clear, mode and setpoints in this order.
    """
    device = sweeper()
    now_us = 0
    for data, wait_us in pieces:
        now_us += wait_us
        device.step(data, now_us)
    device.step(b"", now_us + 600_000)
    assert device.truth.path_m < 1e-6


@given(deliveries, st.lists(st.integers(0, 5000), max_size=5))
@settings(max_examples=60)
def test_random_bytes_do_not_break_the_host(
    pieces: list[tuple[bytes, int]], places: list[int]
) -> None:
    host = spinning_host()
    now_ns = HostNs(10**9)
    host.open(now_ns)
    for data, wait_us in pieces:
        for part in cut(data, places):
            host.receive(part, now_ns)
        now_ns = HostNs(now_ns + wait_us * 1000)
        host.poll(now_ns)
        host.data_to_send(now_ns)
        assert host.next_deadline() >= now_ns - 10**9


@given(deliveries, st.sampled_from(["device", "host"]), st.integers(0, 5_000_000))
@settings(max_examples=40)
def test_random_frames_in_a_running_session_break_neither_end(
    pieces: list[tuple[bytes, int]],
    victim: str,
    from_us: int,
) -> None:
    host = spinning_host()
    if from_us % 2:
        host.mission = Mission(None)
    ends = Ends(HostEnd(host), sweeper())
    ends.run(1.0 + from_us / 1e6 / 4)
    for data, wait_us in pieces:
        (ends.to_host if victim == "host" else ends.to_device).push(data, ends.now_us)
        ends.run(min(wait_us, 200_000) / 1e6)


@given(reference_frames().flatmap(damaged))
@settings(max_examples=100)
def test_damaged_frames_are_answered_by_nothing(frame: bytes) -> None:
    device = sweeper()
    device.step(b"", 0)
    device.firmware.negotiated = False
    before = device.firmware.latch.cause
    device.step(b"\0" + frame + b"\0", 5_000)
    assert device.firmware.latch.cause >= before
