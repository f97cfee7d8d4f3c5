"""The limits of the freshness check in the design.

The values are repeated here, so that a change in the code must be intended.
"""

from __future__ import annotations

import pytest

from sim_device.device.freshness import DRIFT_ALLOWANCE_PPM, Freshness


def test_the_figure() -> None:
    assert DRIFT_ALLOWANCE_PPM == 250


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


def test_a_host_clock_that_wraps_is_followed_for_hours() -> None:
    """A 32-bit stamp in µs is unambiguous for 36 minutes, counted from the last frame."""
    fresh = Freshness()
    for minute in range(180):
        now_us = 60_000_000 * minute
        assert fresh.extra_delay_us(now_us & 0xFFFF_FFFF, now_us + 5_000) == 0.0
