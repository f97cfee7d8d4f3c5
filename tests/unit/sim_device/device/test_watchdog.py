"""The watchdogs of setpoints and duties, with their limits in the design.

The values are repeated here, so that a change in the code must be intended.
"""

from __future__ import annotations

import pytest

from protocol.messages.host import VelocitySetpoint, WheelDuty
from sim_device.device.watchdog import (
    BRINGUP_DUTY_MAX,
    MAX_TIME_TO_LIVE_US,
    DutyWatchdog,
    SetpointWatchdog,
)


def setpoint(counter: int, ttl_ms: int = 200, v: int = 2000) -> VelocitySetpoint:
    return VelocitySetpoint(v, 0, ttl_ms, counter & 0xFF)


def test_the_figures() -> None:
    assert MAX_TIME_TO_LIVE_US == 250_000
    assert BRINGUP_DUTY_MAX == 0.5


def test_a_setpoint_lives_for_its_time_to_live_less_its_delay() -> None:
    dog = SetpointWatchdog()
    assert dog.offer(setpoint(1, ttl_ms=200), 50_000, 1_000_000)
    assert dog.left_us(1_000_000) == 150_000
    assert dog.wanted[0] == pytest.approx(0.2)
    assert not dog.expired(1_149_999)
    assert dog.expired(1_150_000)
    assert dog.wanted[0] == 0.0
    assert not dog.expired(1_160_000), "an expiry is reported once"
    assert dog.left_us(1_160_000) == 0


def test_time_to_live_is_clamped() -> None:
    dog = SetpointWatchdog()
    dog.offer(setpoint(1, ttl_ms=255), 0, 0)
    assert dog.left_us(0) == MAX_TIME_TO_LIVE_US
    assert dog.expired(MAX_TIME_TO_LIVE_US)


@pytest.mark.parametrize("extra_us", [200_000, 200_001, 3_000_000])
def test_expired_values_are_rejected(extra_us: int) -> None:
    dog = SetpointWatchdog()
    dog.offer(setpoint(1), 0, 0)
    assert not dog.offer(setpoint(2, v=3000), extra_us, 100_000)
    assert dog.wanted[0] == pytest.approx(0.2), "the current setpoint remains valid"
    assert dog.expired(200_000)


def test_a_time_to_live_of_zero_moves_nothing() -> None:
    dog = SetpointWatchdog()
    assert not dog.offer(setpoint(1, ttl_ms=0), 0, 0)
    assert dog.wanted[0] == 0.0


def test_the_counter_must_advance_and_wraps() -> None:
    dog = SetpointWatchdog()
    for counter in range(1, 600):
        assert dog.offer(setpoint(counter), 0, counter * 20_000)
        assert not dog.offer(setpoint(counter), 0, counter * 20_000), "repeated"
        assert not dog.offer(setpoint(counter - 1), 0, counter * 20_000), "reordered"
        assert not dog.offer(setpoint(counter - 127), 0, counter * 20_000)


@pytest.mark.parametrize(("advance", "taken"), [(1, True), (127, True), (128, False), (255, False)])
def test_how_far_a_counter_may_advance(advance: int, taken: bool) -> None:  # noqa: FBT001 - a table
    dog = SetpointWatchdog()
    dog.offer(setpoint(200), 0, 0)
    assert dog.offer(setpoint(200 + advance), 0, 1) is taken


def test_a_rejected_setpoint_does_not_use_up_its_counter() -> None:
    dog = SetpointWatchdog()
    dog.offer(setpoint(1), 0, 0)
    assert not dog.offer(setpoint(100), 1_000_000, 10)
    assert dog.offer(setpoint(2), 0, 20)


def test_halt_discards_values_but_keeps_the_counter() -> None:
    dog = SetpointWatchdog()
    dog.offer(setpoint(9), 0, 0)
    dog.halt()
    assert dog.wanted[0] == 0.0
    assert dog.left_us(1) == 0
    assert not dog.expired(10_000_000), "a halt is not reported as an expiry"
    assert not dog.offer(setpoint(9), 0, 1)
    assert dog.offer(setpoint(10), 0, 1)
    dog.reset()
    assert dog.offer(setpoint(9), 0, 2), "a new session may start with any counter"


def test_the_longest_life_is_a_quarter_of_a_second() -> None:
    dog = SetpointWatchdog()
    dog.offer(VelocitySetpoint(2000, 0, 255, 1), 0, 0)
    assert dog.left_us(0) == 250_000
    assert not dog.expired(249_999)
    assert dog.expired(250_000)


def test_a_frames_delay_shortens_its_time_to_live() -> None:
    dog = SetpointWatchdog()
    assert dog.offer(VelocitySetpoint(2000, 500, 100, 1), 99_999.0, 1000)
    assert dog.until_us == 1001
    assert list(dog.wanted) == pytest.approx([0.2, 0.1])
    assert not SetpointWatchdog().offer(VelocitySetpoint(2000, 0, 100, 1), 100_000.0, 1000)


def test_a_watchdog_begins_with_nothing_and_reports_nothing() -> None:
    for dog in (SetpointWatchdog(), DutyWatchdog()):
        assert dog.until_us == 0
        assert dog.left_us(0) == 0
        assert not dog.expired(10**9)
    assert SetpointWatchdog().wanted == (0.0, 0.0)
    assert DutyWatchdog().duties == (0.0, 0.0)


@pytest.mark.parametrize("end", ["halt", "reset", "expire"])
def test_a_reset_leaves_no_state(end: str) -> None:
    dog = SetpointWatchdog()
    dog.offer(VelocitySetpoint(2000, 500, 100, 1), 0.0, 1000)
    if end == "expire":
        assert dog.expired(101_000)
    else:
        getattr(dog, end)()
    assert dog.wanted == (0.0, 0.0)
    assert dog.until_us == 0
    assert dog.left_us(1000) == 0
    assert not dog.expired(10**9), "no second expiry is reported"
    assert dog.offer(VelocitySetpoint(1, 0, 100, 1), 0.0, 2000) is (end == "reset")


def test_duties_are_capped_at_a_half_on_both_sides() -> None:
    dog = DutyWatchdog()
    assert dog.offer(WheelDuty(10_000, -10_000, 200, 1), 0.0, 0)
    assert dog.duties == (0.5, -0.5)
    assert dog.offer(WheelDuty(-4_900, 4_900, 200, 2), 0.0, 0)
    assert list(dog.duties) == pytest.approx([-0.49, 0.49])
    assert not dog.offer(WheelDuty(0, 0, 200, 2), 0.0, 0), "repeated"
    assert dog.left_us(0) == 200_000
    assert not dog.offer(WheelDuty(0, 0, 200, 3), 300_000.0, 0), "late"


def test_counters_wrap_at_8_bits_and_advance_by_less_than_half() -> None:
    for first, second, taken in (
        *((255, 0, True), (0, 255, False), (0, 127, True), (0, 128, False)),
        *((7, 7, False), (200, 71, True), (200, 72, False)),
    ):
        dog = SetpointWatchdog()
        assert dog.offer(VelocitySetpoint(0, 0, 200, first), 0.0, 0)
        assert dog.offer(VelocitySetpoint(0, 0, 200, second), 0.0, 1) is taken


def test_conditions_return_true_or_false() -> None:
    dog = SetpointWatchdog()
    assert dog.expired(5) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 1), 0.0, 0) is True
    assert dog.expired(99_999) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 1), 0.0, 0) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 2), 100_000.0, 0) is False
    assert dog.expired(100_000) is True
