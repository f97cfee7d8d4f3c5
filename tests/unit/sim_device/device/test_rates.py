"""Stream rates, set by a host session as bytes."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from protocol.link import Received
from protocol.messages.device import Hello, Imu, LogText, Power, Range, Sync
from protocol.messages.host import SetStreamRate, TimeRequest, VelocitySetpoint
from protocol.messages.values import (
    Fault,
    NackReason,
)
from protocol.schema.catalogue import CATALOGUE
from support.ends import SessionEnd, session_end

if TYPE_CHECKING:
    from protocol.schema.message import Message
from support.lone_device import LoneDevice
from support.ready_device import ReadyDevice

IMU, POWER, SYNC = (CATALOGUE.by_class[c].type_id for c in (Imu, Power, Sync))


@pytest.mark.parametrize(
    ("tenths", "expected"), [(0, 0), (1, 0), (125, 25), (500, 100), (1000, 200), (10_000, 200)]
)
def test_a_stream_comes_at_the_rate_asked_for(tenths: int, expected: int) -> None:
    ready = ReadyDevice()
    assert ready.rate(IMU, tenths) is None
    assert ready.count(Imu, 2.0) == pytest.approx(expected, abs=1)


def test_other_streams_keep_theirs() -> None:
    ready = ReadyDevice()
    ready.rate(POWER, 0)
    assert ready.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_rates_end_with_the_session() -> None:
    ready = ReadyDevice()
    ready.rate(IMU, 0)
    assert ready.count(Imu, 1.0) == 0
    ready.ends.restart_host(session_end())
    host = ready.ends.host
    assert isinstance(host, SessionEnd)
    ready.host = host
    ready.complete_handshake()
    assert ready.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_a_stream_that_was_off_can_be_had_again() -> None:
    ready = ReadyDevice()
    ready.rate(POWER, 0)
    assert ready.count(Power, 1.0) == 0
    assert ready.rate(POWER, 100) is None
    assert ready.count(Power, 1.0) == pytest.approx(10, abs=1)


def test_the_supply_is_supervised_with_any_streams() -> None:
    ready = ReadyDevice()
    ready.rate(POWER, 0)
    ready.set("battery_low", 20.0)
    ready.ends.run(0.5)
    assert ready.ends.device.firmware.faults & Fault.BATTERY_LOW


@pytest.mark.parametrize(
    ("kind", "tenths", "reason"),
    [
        (Hello, 10, NackReason.BAD_VALUE),
        (LogText, 10, NackReason.BAD_VALUE),
        (VelocitySetpoint, 10, NackReason.BAD_VALUE),
        (Imu, 10_001, NackReason.BAD_VALUE),
        (Sync, 0, NackReason.BAD_VALUE),
    ],
)
def test_rates_that_cannot_be(kind: type[Message], tenths: int, reason: NackReason) -> None:
    ready = ReadyDevice()
    assert ready.rate(CATALOGUE.by_class[kind].type_id, tenths) is reason


def test_an_unknown_type_has_no_rate() -> None:
    assert ReadyDevice().rate(0x7D, 10) is NackReason.BAD_VALUE


def stamped(bench: LoneDevice, kind: type[Message], duration_s: float) -> list[tuple[int, Message]]:
    """Return time stamps (µs) and messages of a stream."""
    found: list[tuple[int, Message]] = []
    for _ in range(round(duration_s * 100)):
        bench.now_us += 10_000
        bench.link.send(TimeRequest(1), bench.now_us, node=1)
        data = bench.link.data_to_send()
        found += [
            (event.frame.t_us, event.message)
            for event in bench.link.receive(bench.device.step(data, bench.now_us))
            if isinstance(event, Received) and isinstance(event.message, kind)
        ]
    return found


def test_a_range_message_has_the_age_of_its_ultrasonic_range() -> None:
    bench = LoneDevice()
    bench.join()
    found = stamped(bench, Range, 1.0)
    assert len(found) == 20
    ages_ms = [message.ultrasonic_age for _, message in found if isinstance(message, Range)]
    for (stamp_us, _), age_ms in zip(found, ages_ms, strict=True):
        assert (stamp_us // 1000 - age_ms) % 60 == 0, "the sensor measures every 60 ms"
        assert age_ms <= 100
    assert len(set(ages_ms)) > 4


def test_an_imu_sample_keeps_its_time_when_it_is_sent_later() -> None:
    """The IMU's clock is 1 % slow, so its newest sample is sometimes a period old."""
    bench = LoneDevice()
    bench.device.sensors.faults.imu_clock = -0.01
    bench.join()
    bench.send(SetStreamRate(1, IMU, 333))
    found = stamped(bench, Imu, 10.0)
    gaps_us = [b - a for (a, _), (b, _) in pairwise(found)]
    assert set(gaps_us) == {20_000, 30_000, 40_000}
    assert sum(gaps_us) == pytest.approx(10_000_000, abs=60_000)
