"""Wheels to body motion and back, encoder wrap, and dead reckoning against closed forms."""

from __future__ import annotations

import math

import pytest

from bridge.motion.estimation.odometry import advance_arc, advance_midpoint, sinc
from bridge.motion.geometry import Pose2
from bridge.motion.kinematics import (
    body_motion,
    encoder_delta,
    pose_rate,
    wheel_motion,
    wheel_travel_m,
)
from bridge.motion.robot_model import RobotModel

MODEL = RobotModel()


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


def test_one_wheel_turn_is_its_circumference() -> None:
    assert wheel_travel_m(MODEL, 1560) == pytest.approx(math.pi * 0.065)


def test_equal_travel_is_straight_and_opposite_travel_turns_in_place() -> None:
    assert body_motion(MODEL, 0.3, 0.3) == pytest.approx((0.3, 0.0))
    travel, turn = body_motion(MODEL, -0.1, 0.1)
    assert travel == pytest.approx(0.0)
    assert turn == pytest.approx(0.2 / 0.23)
    assert wheel_motion(MODEL, travel, turn) == pytest.approx((-0.1, 0.1))


def test_forward_kinematics_points_along_the_heading() -> None:
    rate = pose_rate(Pose2(1.0, 2.0, math.pi / 2), 0.2, 0.5)
    assert rate == pytest.approx((0.0, 0.2, 0.5), abs=1e-15)


def test_arc_closes_a_circle_in_few_steps_where_the_midpoint_form_drifts() -> None:
    radius, steps = 0.5, 6
    start = Pose2(0.3, -0.2, 0.4)
    exact = rough = start
    for _ in range(steps):
        exact = advance_arc(exact, radius * math.tau / steps, math.tau / steps)
    assert exact.distance_m(start) < 1e-12
    rough = advance_midpoint(start, radius * math.pi, math.pi)
    half = advance_arc(start, radius * math.pi, math.pi)
    assert half.distance_m(start) == pytest.approx(2 * radius)
    assert rough.distance_m(start) == pytest.approx(math.pi * radius)


def test_sinc_is_continuous_across_its_series() -> None:
    assert sinc(0.0) == 1.0
    below, above = sinc(0.999e-3), sinc(1.001e-3)
    assert below == pytest.approx(math.sin(0.999e-3) / 0.999e-3, abs=1e-14)
    assert above < below < 1.0
