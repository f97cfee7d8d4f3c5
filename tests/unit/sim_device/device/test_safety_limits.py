"""The limits of latch, freshness and watchdogs in the design.

The values are repeated here, so that a change in the code must be intended.
"""

from __future__ import annotations

import pytest

from protocol.messages.host import VelocitySetpoint, WheelDuty
from protocol.messages.values import StopCause
from sim_device.device import safety
from sim_device.device.safety import DutyWatchdog, Freshness, SetpointWatchdog, StopLatch


def test_the_figures() -> None:
    assert safety.MAX_TIME_TO_LIVE_US == 250_000
    assert safety.HOST_SILENCE_US == 1_000_000
    assert safety.DRIFT_ALLOWANCE_PPM == 250
    assert safety.BRINGUP_DUTY_MAX == 0.5


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
    assert dog.v_m_s == pytest.approx(0.2)
    assert dog.yaw_rate_rad_s == pytest.approx(0.1)
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


def test_the_first_frame_is_the_reference_with_any_clocks() -> None:
    fresh = Freshness()
    assert fresh.extra_delay_us(4_000_000_000, 1_000_000) == 0.0
    # The allowance for drift is 250 ppm of 40 ms: 10 us.
    assert fresh.extra_delay_us(4_000_040_000, 1_042_000) == pytest.approx(2_000 - 0.25e-3 * 42_000)
    assert fresh.extra_delay_us(4_000_060_000, 1_060_000) == pytest.approx(0.0, abs=16.0)


def test_the_allowance_grows_with_time_and_only_with_it() -> None:
    fresh = Freshness()
    fresh.extra_delay_us(0, 5_000)
    # After 100 s the minimum has grown by 25 ms; a frame with the same delay resets the minimum.
    assert fresh.extra_delay_us(100_000_000, 100_005_000) == 0.0
    assert fresh.extra_delay_us(100_000_000, 100_005_000) == 0.0, "no time has passed"
    assert fresh.extra_delay_us(200_000_000, 200_105_000) == pytest.approx(100_000 - 25_025)


def test_an_old_frame_does_not_turn_the_hosts_clock_back() -> None:
    fresh = Freshness()
    fresh.extra_delay_us(1_000_000, 0)
    fresh.extra_delay_us(3_000_000_000, 2_999_000_000 & 0xFFFF_FFFF)
    late = fresh.extra_delay_us(2_000_000_000, 2_999_000_000)
    assert late == pytest.approx(1_000_000_000, rel=1e-3)


def test_a_reset_restarts_the_measurement_with_any_clock() -> None:
    fresh = Freshness()
    fresh.extra_delay_us(10, 10)
    assert fresh.extra_delay_us(10, 500_010) > 400_000
    fresh.reset()
    assert fresh.extra_delay_us(77, 900_000_077) == 0.0
    assert fresh.extra_delay_us(1_000_077, 901_000_077) == 0.0


def test_a_latch_begins_with_an_orderly_end_and_none_is_free() -> None:
    latch = StopLatch()
    assert (latch.cause, latch.latched) == (StopCause.SESSION_END, True)
    assert latch.latch(StopCause.SESSION_END) is False
    assert latch.latch(StopCause.OPERATOR) is True
    assert latch.latch(StopCause.SUPERVISE) is False
    assert latch.clear(StopCause.SUPERVISE) is False
    assert latch.cause is StopCause.OPERATOR
    assert latch.clear(StopCause.OPERATOR) is True
    assert (latch.cause, latch.latched) == (StopCause.NONE, False)
    assert latch.clear(StopCause.NONE) is False


def test_a_host_clock_that_wraps_is_followed_for_hours() -> None:
    """A 32-bit stamp in µs is unambiguous for 36 minutes, counted from the last frame."""
    fresh = Freshness()
    for minute in range(180):
        now_us = 60_000_000 * minute
        assert fresh.extra_delay_us(now_us & 0xFFFF_FFFF, now_us + 5_000) == 0.0


def test_conditions_return_true_or_false() -> None:
    dog = SetpointWatchdog()
    assert dog.expired(5) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 1), 0.0, 0) is True
    assert dog.expired(99_999) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 1), 0.0, 0) is False
    assert dog.offer(VelocitySetpoint(0, 0, 100, 2), 100_000.0, 0) is False
    assert dog.expired(100_000) is True
