"""Headings along a path, and the maximum speed at the end of each section."""

from __future__ import annotations

import math

import pytest

from bridge.coverage.recovery.behaviours.transit import course, end_speed
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.search import Choice
from bridge.motion.geometry import Pose2

OPTIONS = RecoveryOptions()


def choice(kind: str, heading_deg: float, *path: tuple[float, float]) -> Choice:
    return Choice(kind, path, math.radians(heading_deg), 1.0, 0.1, 0.01)


def test_a_course_is_heading_and_way() -> None:
    heading, path = course(Pose2(1.0, 1.0, 2.0), 0.0, 0.0)
    assert heading == pytest.approx(math.radians(-135))
    assert path == pytest.approx(math.sqrt(2.0))


@pytest.mark.parametrize(
    ("bend_deg", "fast"), [(0.0, True), (9.0, True), (-9.0, True), (12.0, False)]
)
def test_only_a_slight_bend_is_driven_without_a_stop(bend_deg: float, *, fast: bool) -> None:
    bend = math.radians(bend_deg)
    corner = (1.0, 0.0)
    onwards = (1.0 + math.cos(bend), math.sin(bend))
    inner = end_speed(OPTIONS, choice("lane", 90.0, corner, onwards), 0, 0.0)
    last = end_speed(OPTIONS, choice("lane", bend_deg, corner), 0, 0.0)
    assert inner == last
    assert (inner > 0.1) is fast
    # A planned slight bend is smaller than the bend that needs a turn in place, with a margin.
    assert abs(bend) < OPTIONS.bend_rad - math.radians(3.0) or not fast


def test_it_is_slow_before_a_perimeter_pass_for_any_wall_direction() -> None:
    for heading_deg in (0.0, 180.0):
        assert end_speed(OPTIONS, choice("perimeter", heading_deg, (1.0, 0.0)), 0, 0.0) < 0.06


def test_a_bend_across_the_seam_is_slight_too() -> None:
    assert end_speed(OPTIONS, choice("lane", -176.0, (-1.0, 0.0)), 0, math.radians(176.0)) > 0.1
