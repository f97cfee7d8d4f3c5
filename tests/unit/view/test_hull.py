"""The parts of the hull where a range sensor measures an object in contact with the hull."""

from __future__ import annotations

import math

import pytest

from bridge.config import parse_robot
from bridge.motion.robot_model import RobotModel
from bridge.view.setup.hull import blind_share, hull_view


def test_the_default_robot_measures_ahead_and_at_both_sides() -> None:
    view = hull_view(RobotModel())
    middles = sorted(
        math.degrees(math.remainder(0.5 * (arc.begin_rad + arc.end_rad), 2.0 * math.pi))
        for arc in view.measured
    )
    # the infrared beams leave the hull 5 cm ahead of the axle; the hull's radius is 16 cm
    side = math.degrees(math.acos(0.05 / 0.16))
    assert middles == pytest.approx([-side, 0.0, side], abs=0.5)
    assert view.too_near == []


def test_a_sensor_below_its_minimum_range_at_the_hull_is_too_near() -> None:
    view = hull_view(parse_robot("[infrared_left]\ny_m = 0.14\n"))
    (arc,) = view.too_near
    assert 0.0 < arc.begin_rad < arc.end_rad < math.pi / 2
    assert len(view.measured) == 2


def test_a_wide_cone_leaves_less_of_the_hull_blind() -> None:
    narrow = hull_view(parse_robot("[ultrasonic]\ncone_rad = 0.2\n"))
    wide = hull_view(parse_robot("[ultrasonic]\ncone_rad = 1.0\n"))
    assert blind_share(wide) < blind_share(narrow)


def test_an_arc_across_the_heading_is_one_arc() -> None:
    ahead = hull_view(RobotModel()).measured[0]
    spans = [arc for arc in hull_view(RobotModel()).measured if arc.end_rad > 2.0 * math.pi]
    assert len(spans) == 1
    assert spans[0].width_rad == pytest.approx(0.065, abs=0.02)
    assert ahead.width_rad < 0.1
