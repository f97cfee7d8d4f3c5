"""Stream rates, requested by a real session over bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import Hello, Imu, LogText, Power, Sync
from protocol.messages.host import VelocitySetpoint
from protocol.messages.values import (
    Fault,
    NackReason,
)
from protocol.schema.catalogue import CATALOGUE
from support.ends import SessionEnd, session_end

if TYPE_CHECKING:
    from protocol.schema.message import Message
from support.ready_device import Desk

IMU, POWER, SYNC = (CATALOGUE.by_class[c].type_id for c in (Imu, Power, Sync))


@pytest.mark.parametrize(
    ("tenths", "expected"), [(0, 0), (1, 0), (125, 25), (500, 100), (1000, 200), (10_000, 200)]
)
def test_a_stream_comes_at_the_rate_asked_for(tenths: int, expected: int) -> None:
    desk = Desk()
    assert desk.rate(IMU, tenths) is None
    assert desk.count(Imu, 2.0) == pytest.approx(expected, abs=1)


def test_other_streams_keep_theirs() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    assert desk.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_rates_end_with_the_session() -> None:
    desk = Desk()
    desk.rate(IMU, 0)
    assert desk.count(Imu, 1.0) == 0
    desk.ends.restart_host(session_end())
    host = desk.ends.host
    assert isinstance(host, SessionEnd)
    desk.host = host
    desk.complete_handshake()
    assert desk.count(Imu, 1.0) == pytest.approx(100, abs=1)


def test_a_stream_that_was_off_can_be_had_again() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    assert desk.count(Power, 1.0) == 0
    assert desk.rate(POWER, 100) is None
    assert desk.count(Power, 1.0) == pytest.approx(10, abs=1)


def test_the_supply_is_supervised_with_any_streams() -> None:
    desk = Desk()
    desk.rate(POWER, 0)
    desk.set("battery_low", 20.0)
    desk.ends.run(0.5)
    assert desk.ends.device.firmware.faults & Fault.BATTERY_LOW


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
    desk = Desk()
    assert desk.rate(CATALOGUE.by_class[kind].type_id, tenths) is reason


def test_an_unknown_type_has_no_rate() -> None:
    assert Desk().rate(0x7D, 10) is NackReason.BAD_VALUE
