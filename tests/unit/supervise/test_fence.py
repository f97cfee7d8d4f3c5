"""The rule for a robot that leaves its fence."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.rules.fence import Fence
from bridge.supervise.settings import FenceRule
from support.watching import Walk


def test_the_radius_is_around_the_first_place() -> None:
    walk = Walk(rule := Fence(FenceRule(radius_m=1.0)))
    assert not walk.step(1, pose=Pose2(5.0, 5.0, 0.0))
    assert not walk.step(1, pose=Pose2(5.99, 5.0, 0.0))
    assert walk.step(1, pose=Pose2(5.8, 5.8, 0.0))
    assert rule.evidence()[1] == {"x_m": 5.8, "y_m": 5.8}
    assert "more than 1 m" in rule.evidence()[0]
    rule.restart()
    assert walk.step(1, pose=Pose2(5.8, 5.8, 0.0)), "a restart does not move the fence"


def test_without_a_fence_nothing_is_outside() -> None:
    assert not Walk(Fence(FenceRule())).step(1, pose=Pose2(900.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("x", "y", "outside"),
    [
        *[(0.5, 0.5, False), (1.5, 0.5, False), (0.5, 1.5, False), (1.5, 1.5, True)],
        *[(-0.1, 0.5, True), (2.1, 0.5, True), (0.5, -0.1, True), (0.5, 2.1, True)],
        *[(0.99, 1.5, False), (1.01, 1.5, True), (1.5, 0.99, False), (1.5, 1.01, True)],
    ],
)
def test_an_l_shaped_fence(x: float, y: float, *, outside: bool) -> None:
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0))
    walk = Walk(rule := Fence(FenceRule(polygon=corners)))
    assert walk.step(1, pose=Pose2(x, y, 0.0)) is outside
    if outside:
        assert "outside the fence" in rule.evidence()[0]


def test_an_oblique_fence() -> None:
    """The long side of a triangular fence is on y = 2 - x / 2. The robot crosses this side."""
    corners = ((0.0, 0.0), (4.0, 0.0), (0.0, 2.0))
    for x, y, outside in ((2.0, 0.9, False), (2.0, 1.1, True), (3.0, 0.4, False), (3.0, 0.6, True)):
        assert Walk(Fence(FenceRule(polygon=corners))).step(1, pose=Pose2(x, y, 0.0)) is outside


def test_the_fence_acts_exactly_at_its_place() -> None:
    walk = Walk(rule := Fence(FenceRule(radius_m=1.0)))
    walk.step(1, pose=Pose2(5.0, 5.0, 0.0))
    assert not walk.step(1, pose=Pose2(6.0, 5.0, 0.0)), "a distance equal to the radius is inside"
    assert walk.step(1, pose=Pose2(6.1234, 5.5678, 0.0))
    assert rule.evidence()[1] == {"x_m": 6.123, "y_m": 5.568}
    walk = Walk(Fence(FenceRule()))
    walk.step(1, pose=Pose2(0.0, 0.0, 0.0))
    assert not walk.step(1, pose=Pose2(9.0, 0.0, 0.0)), "the robot moves, but there is no fence"


def test_the_left_and_lower_side_of_a_fence_belong_to_it() -> None:
    """Adjacent fences therefore leave no gap. Points level with a corner need no special rule."""
    corners = ((0.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0), (1.0, 3.0), (0.0, 3.0))
    for x, y, outside in (
        *((0.0, 1.5, False), (2.0, 1.5, True), (1.5, 1.0, False), (0.5, 3.0, True)),
        *((0.5, 2.0, False), (-0.5, 2.0, True), (2.5, 2.0, True), (-0.5, 1.0, True)),
    ):
        walk = Walk(Fence(FenceRule(polygon=corners)))
        assert walk.step(1, pose=Pose2(x, y, 0.0)) is outside, (x, y)


def test_an_oblique_fence_with_a_higher_edge() -> None:
    """The fence is a triangle with its long side on y = 5 - x / 2."""
    corners = ((0.0, 3.0), (4.0, 3.0), (0.0, 5.0))
    for x, y, outside in ((2.0, 3.9, False), (2.0, 4.1, True), (3.0, 3.4, False), (3.0, 3.6, True)):
        assert Walk(Fence(FenceRule(polygon=corners))).step(1, pose=Pose2(x, y, 0.0)) is outside
