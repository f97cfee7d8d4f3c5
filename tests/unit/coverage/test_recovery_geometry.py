"""Sizes that the recovery planner derives from a robot."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.robot_model import RobotModel

PAPER = RobotModel()


def scaled(scale: float, width: float = 0.5, ahead: float = 0.0) -> RobotModel:
    """Return the paper's robot with another size; mouth width and offset are in diameters."""
    diameter_m = 0.32 * scale

    return replace(
        PAPER,
        robot_diameter_m=diameter_m,
        cleaning_width_m=width * diameter_m,
        mouth_offset_m=ahead * diameter_m,
        wheel_base_m=PAPER.wheel_base_m * scale,
        ultrasonic=replace(PAPER.ultrasonic, x_m=PAPER.ultrasonic.x_m * scale),
    )


def geometry(model: RobotModel) -> PlannerGeometry:
    return PlannerGeometry.from_model(model, RecoveryOptions())


def test_the_papers_robot_has_the_documented_sizes() -> None:
    made = geometry(PAPER)
    assert (made.cell_m, made.mouth_cells, made.inflation_cells) == (0.02, 3.5, 7.7)
    assert (made.min_cells, made.min_rate, made.near_rate, made.full_rate) == (7, 7.5, 30.0, 70.0)
    assert (made.stop_range_m, made.lane_speed_m_s, made.round_rad_s) == (0.048, 0.28, 0.5)
    assert made.path_costs[:2] == (1100, 2600)


@pytest.mark.parametrize("scale", [0.7, 0.9])
def test_in_cells_a_robot_to_scale_is_the_same_robot(scale: float) -> None:
    made, paper = geometry(scaled(scale)), geometry(PAPER)
    for name in ("mouth_cells", "inflation_cells", "clear_cells", "lane_rows", "min_cells"):
        assert getattr(made, name) == pytest.approx(getattr(paper, name))
    assert made.cell_m == pytest.approx(scale * paper.cell_m)


@example(0.625, 0.344, 0.0)
@given(st.floats(0.625, 1.5625), st.floats(0.3, 0.9), st.floats(0.0, 0.4))
def test_every_robot_has_usable_sizes(scale: float, width: float, ahead: float) -> None:
    model = scaled(scale, width, ahead)
    made = geometry(model)
    for field in fields(made):
        value = getattr(made, field.name)
        low = min(value) if isinstance(value, tuple) else value
        assert low >= 0.0, field.name
        assert field.name in {"ahead_m", "ahead_cells"} or low > 0.0, field.name
    # A lane is at most as wide as the mouth, and at least half as wide.
    lane_m = made.lane_rows * made.cell_m
    assert 0.5 * model.cleaning_width_m < lane_m <= model.cleaning_width_m
    # The inflation radius is between the footprint minus one cell and the footprint.
    assert model.radius_m - made.cell_m < made.inflation_cells * made.cell_m < model.radius_m
    assert made.band_m[1] < 0.5 * model.cleaning_width_m
    assert made.hole_cells * made.cell_m <= 0.5 * model.cleaning_width_m + 0.5 * made.cell_m


@pytest.mark.parametrize(
    ("sigma_m", "swept"), [(0.0, 3.85), (0.006, 3.85), (0.02, 3.6), (0.03, 3.4), (0.5, 3.0)]
)
def test_less_of_the_mouth_counts_as_swept_if_the_pose_is_uncertain(
    sigma_m: float, swept: float
) -> None:
    assert geometry(PAPER).swept_cells(sigma_m) == pytest.approx(swept)


def test_a_lane_ends_where_the_ultrasonic_still_measures() -> None:
    at_rim = replace(PAPER, ultrasonic=replace(PAPER.ultrasonic, x_m=0.155))
    assert geometry(at_rim).stop_range_m > at_rim.ultrasonic.min_range_m
    inside = replace(PAPER, ultrasonic=replace(PAPER.ultrasonic, x_m=0.0))
    assert geometry(inside).stop_range_m == pytest.approx(PAPER.radius_m + 0.008)


def test_costs_of_time_follow_the_robots_speeds() -> None:
    slow = replace(PAPER, max_yaw_rate_rad_s=1.0, max_accel_m_s2=0.2, cruise_speed_m_s=0.1)
    made = geometry(slow)
    assert made.turn_s_rad == pytest.approx(1.7)
    assert made.lane_speed_m_s == pytest.approx(0.14)
    assert made.stop_s == pytest.approx(0.9)
    assert made.full_rate == pytest.approx(35.0)
    fast = replace(PAPER, cruise_speed_m_s=0.3)
    assert geometry(fast).lane_speed_m_s < fast.max_speed_m_s
    assert math.isfinite(geometry(fast).stop_s)
