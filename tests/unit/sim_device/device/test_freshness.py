"""The additional delay of a frame compared with the fastest frame of its session."""

from __future__ import annotations

import random

import pytest

from sim_device.device.freshness import Freshness

WRAP = 1 << 32


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
