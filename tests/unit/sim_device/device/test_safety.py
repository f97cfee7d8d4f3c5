"""Stop latch, freshness of frames and setpoint watchdog."""

from __future__ import annotations

import itertools
import random

import pytest

from protocol.messages.host import VelocitySetpoint
from protocol.messages.values import StopCause
from sim_device.device.safety import MAX_TIME_TO_LIVE_US, Freshness, SetpointWatchdog, StopLatch

CAUSES = [c for c in StopCause if c is not StopCause.NONE]
WRAP = 1 << 32


def setpoint(counter: int, ttl_ms: int = 200, v: int = 2000) -> VelocitySetpoint:
    return VelocitySetpoint(v, 0, ttl_ms, counter & 0xFF)


# ---- latch ------------------------------------------------------------------------------


def test_a_device_boots_latched() -> None:
    assert StopLatch().cause is StopCause.SESSION_END
    assert StopLatch().latched


@pytest.mark.parametrize(("held", "new"), list(itertools.product(StopCause, CAUSES)))
def test_the_graver_cause_holds(held: StopCause, new: StopCause) -> None:
    latch = StopLatch(held)
    assert latch.latch(new) is (new > held)
    assert latch.cause is max(held, new)
    assert latch.latched


@pytest.mark.parametrize(("held", "named"), list(itertools.product(CAUSES, range(8))))
def test_only_the_cause_that_holds_can_be_cleared(held: StopCause, named: int) -> None:
    latch = StopLatch(held)
    assert latch.clear(named) is (named == held)
    assert latch.cause is (StopCause.NONE if named == held else held)


def test_without_a_latch_there_is_nothing_to_clear() -> None:
    latch = StopLatch(StopCause.NONE)
    assert not latch.clear(StopCause.NONE)
    assert not latch.latched


# ---- freshness --------------------------------------------------------------------------


def test_the_first_frame_is_the_measure() -> None:
    fresh = Freshness()
    assert fresh.extra_delay_us(5_000_000, 100) == 0.0
    assert fresh.extra_delay_us(5_020_000, 20_100) == pytest.approx(0.0, abs=10.0)
    assert fresh.extra_delay_us(5_040_000, 340_100) == pytest.approx(300_000, abs=100)
    assert fresh.extra_delay_us(5_360_000, 355_100) == 0.0, "a faster frame is the new reference"
    assert fresh.extra_delay_us(5_380_000, 380_100) == pytest.approx(5_000, abs=10)


def test_a_new_session_restarts_the_measurement() -> None:
    fresh = Freshness()
    fresh.extra_delay_us(0, 0)
    assert fresh.extra_delay_us(0, 900_000) > 800_000
    fresh.reset()
    assert fresh.extra_delay_us(0, 900_000) == 0.0


@pytest.mark.parametrize("drift_ppm", [-200, -100, 0, 100, 200])
def test_two_crystals_never_make_a_fresh_setpoint_stale(drift_ppm: int) -> None:
    """In five simulated hours both clocks wrap four times. An adapter adds 1 ms of jitter."""
    rng = random.Random(drift_ppm)
    fresh = Freshness()
    worst = 0.0
    host_first, device_first = WRAP - 3_000_000, WRAP - 9_000_000
    for k in range(5 * 3600 * 4):  # a ping every 250 ms
        sent = k * 250_000
        arrival = device_first + round(sent * (1 + drift_ppm * 1e-6)) + rng.randint(300, 1500)
        worst = max(worst, fresh.extra_delay_us((host_first + sent) % WRAP, arrival))
    assert worst < 2_500, "only the jitter and a part of the drift allowance remain"


@pytest.mark.parametrize("drift_ppm", [-200, 200])
@pytest.mark.parametrize("after_s", [10, 4 * 3600])
def test_a_stall_and_its_burst_are_stale(drift_ppm: int, after_s: int) -> None:
    fresh = Freshness()

    def arrives(sent: int, late: int = 0) -> float:
        arrival = round(sent * (1 + drift_ppm * 1e-6)) + 500 + late
        return fresh.extra_delay_us(sent % WRAP, arrival)

    for k in range(after_s * 4):
        arrives(k * 250_000)
    start = after_s * 1_000_000
    stall_us = 3_000_000
    for k in range(150):  # 50 Hz of setpoints, all delivered at the end of the stall
        sent = start + k * 20_000
        extra = arrives(sent, late=start + stall_us - sent)
        assert extra == pytest.approx(stall_us - k * 20_000, abs=1_500)


# ---- watchdog ---------------------------------------------------------------------------


def test_a_setpoint_lives_for_its_time_to_live_less_its_delay() -> None:
    dog = SetpointWatchdog()
    assert dog.offer(setpoint(1, ttl_ms=200), 50_000, 1_000_000)
    assert dog.left_us(1_000_000) == 150_000
    assert dog.v_m_s == pytest.approx(0.2)
    assert not dog.expired(1_149_999)
    assert dog.expired(1_150_000)
    assert dog.v_m_s == 0.0
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
    assert dog.v_m_s == pytest.approx(0.2), "the current setpoint remains valid"
    assert dog.expired(200_000)


def test_a_time_to_live_of_zero_moves_nothing() -> None:
    dog = SetpointWatchdog()
    assert not dog.offer(setpoint(1, ttl_ms=0), 0, 0)
    assert dog.v_m_s == 0.0


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
    assert dog.v_m_s == 0.0
    assert dog.left_us(1) == 0
    assert not dog.expired(10_000_000), "a halt is not reported as an expiry"
    assert not dog.offer(setpoint(9), 0, 1)
    assert dog.offer(setpoint(10), 0, 1)
    dog.reset()
    assert dog.offer(setpoint(9), 0, 2), "a new session may start with any counter"
