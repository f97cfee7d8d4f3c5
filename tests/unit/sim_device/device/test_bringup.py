"""Wheel duties in bring-up mode, sent by a host session as bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import LinkCounters, Status
from protocol.messages.host import SetMode, Stop, WheelDuty
from protocol.messages.values import (
    Fault,
    Mode,
    NackReason,
    StopCause,
)
from support.ends import RAMP_US, REST_M_S

if TYPE_CHECKING:
    from collections.abc import Callable

from support.ready_device import ReadyDevice, cruise


def forward(duty: float) -> Callable[[int], WheelDuty]:
    return lambda counter: WheelDuty(round(duty * 1e4), round(duty * 1e4), 200, counter)


def test_bringup_is_rejected_while_latched() -> None:
    ready = ReadyDevice()
    assert ready.ask(lambda i: SetMode(i, Mode.BRINGUP)) is NackReason.STOP_LATCHED
    ready.drive(0.5, forward(0.3))
    assert ready.ends.device.truth.path_m < 0.001


def test_duties_turn_the_wheels_in_bringup_and_nowhere_else() -> None:
    ready = ReadyDevice()
    ready.free(Mode.VELOCITY)
    ready.drive(0.5, forward(0.4))
    assert ready.ends.device.truth.path_m < 0.001
    ready.ask(lambda i: SetMode(i, Mode.BRINGUP))
    ready.drive(0.5, cruise)
    assert ready.ends.device.truth.path_m < 0.001
    ready.drive(1.0, forward(0.4))
    assert ready.speed > 0.05


def test_duties_are_capped() -> None:
    def reached(duty: float) -> float:
        ready = ReadyDevice()
        ready.free(Mode.BRINGUP)
        ready.drive(1.5, forward(duty))
        return ready.speed

    assert reached(1.0) == pytest.approx(reached(0.5), rel=1e-3)
    assert reached(0.3) < 0.8 * reached(0.5)


def test_each_wheel_has_its_own_duty() -> None:
    ready = ReadyDevice()
    ready.free(Mode.BRINGUP)
    ready.drive(1.0, lambda c: WheelDuty(-3000, 3000, 200, c))
    assert ready.ends.device.truth.yaw_rate_rad_s > 0.3
    assert ready.speed < 0.02


def test_the_motors_are_off_once_the_time_to_live_is_over() -> None:
    ready = ReadyDevice()
    ready.free(Mode.BRINGUP)
    ready.drive(1.0, forward(0.4))
    last_us = ready.ends.now_us
    ready.ends.run(1.5)
    assert last_us < ready.ends.moving_us <= last_us + 250_000 + RAMP_US
    status = ready.received(Status)[-1]
    assert isinstance(status, Status)
    assert status.faults & Fault.SETPOINT_EXPIRED
    assert status.mode == Mode.BRINGUP, "expiry does not latch"
    ready.drive(0.5, forward(0.4))
    assert ready.speed > 0.05


def test_stale_and_repeated_duties_are_rejected() -> None:
    ready = ReadyDevice()
    ready.free(Mode.BRINGUP)
    long_ago = ready.ends.host_ns - 400_000_000
    ready.send(WheelDuty(4000, 4000, 250, 1))
    ready.ends.run(1.0)
    travelled = ready.ends.device.truth.path_m
    for _ in range(20):
        ready.send(WheelDuty(4000, 4000, 250, 1))  # the counter does not advance
        ready.ends.run(0.02)
    for counter in range(2, 12):
        ready.send(WheelDuty(4000, 4000, 250, counter), stamp_ns=long_ago)
        ready.ends.run(0.02)
    assert ready.ends.device.truth.path_m == pytest.approx(travelled, abs=1e-4)
    ready.ends.run(1.0)
    counters = ready.received(LinkCounters)[-1]
    assert isinstance(counters, LinkCounters)
    assert counters.stale == 30


def test_a_stop_ends_bringup() -> None:
    ready = ReadyDevice()
    ready.free(Mode.BRINGUP)
    ready.drive(0.5, forward(0.4))
    assert ready.ask(lambda i: Stop(i, StopCause.OPERATOR)) is None
    stopped_us = ready.ends.now_us
    ready.drive(1.0, forward(0.4))
    assert ready.ends.moving_us <= stopped_us + RAMP_US
    assert ready.ends.device.firmware.mode is Mode.IDLE


def test_a_host_that_falls_silent_ends_bringup() -> None:
    ready = ReadyDevice()
    ready.free(Mode.BRINGUP)
    ready.drive(0.5, forward(0.4))
    ready.ends.host_alive = False
    ready.ends.run(1.5)
    assert ready.ends.device.firmware.latch.cause is StopCause.LINK
    assert ready.speed < REST_M_S
