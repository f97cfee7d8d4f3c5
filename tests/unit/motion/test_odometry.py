"""Overflow of encoder counts, and dead reckoning compared with closed forms."""

from __future__ import annotations

import math

import pytest

from bridge.motion.estimation.odometry import advance_arc, encoder_delta, sinc
from bridge.motion.geometry import Pose2


@pytest.mark.parametrize(
    ("previous", "current", "delta"),
    [
        (0, 0, 0),
        (10, 25, 15),
        (25, 10, -15),
        (65535, 0, 1),
        (0, 65535, -1),
        (65000, 1000, 1536),
        (1000, 65000, -1536),
        (0, 32767, 32767),
        (0, 32768, -32768),
    ],
)
def test_encoder_delta_wraps_to_the_nearest(previous: int, current: int, delta: int) -> None:
    assert encoder_delta(previous, current) == delta


def test_arc_closes_a_circle_in_few_steps() -> None:
    radius, steps = 0.5, 6
    start = Pose2(0.3, -0.2, 0.4)
    exact = start
    for _ in range(steps):
        exact = advance_arc(exact, radius * math.tau / steps, math.tau / steps)
    assert exact.distance_m(start) < 1e-12
    half = advance_arc(start, radius * math.pi, math.pi)
    assert half.distance_m(start) == pytest.approx(2 * radius)


def test_sinc_is_continuous_across_its_series() -> None:
    assert sinc(0.0) == 1.0
    below, above = sinc(0.999e-3), sinc(1.001e-3)
    assert below == pytest.approx(math.sin(0.999e-3) / 0.999e-3, abs=1e-14)
    assert above < below < 1.0
