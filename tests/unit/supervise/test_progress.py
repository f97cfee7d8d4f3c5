"""The rule for a robot that stays in a small square."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.rules.progress import Progress
from bridge.supervise.settings import ProgressRule
from support.watching import Walk


def test_a_small_square_for_a_long_time_is_no_progress() -> None:
    walk = Walk(rule := Progress(ProgressRule(window_s=4.0, min_side_m=0.1)))
    walk.step(1)
    for index in range(199):
        x = 0.099 * (index % 2)
        assert not walk.step(1, pose=Pose2(x, -x, 0.0))
    assert not walk.step(1, pose=Pose2(0.05, 0.0, 0.0))
    assert walk.step(2, pose=Pose2(0.05, 0.0, 0.0))
    assert rule.evidence()[1] == {"for_s": pytest.approx(4.0, abs=0.05), "min_side_m": 0.1}


@pytest.mark.parametrize("there", [(0.101, 0.0), (-0.101, 0.0), (0.0, 0.101), (0.0, -0.101)])
def test_leaving_the_square_restarts_the_time(there: tuple[float, float]) -> None:
    walk = Walk(Progress(ProgressRule(window_s=4.0, min_side_m=0.1)))
    walk.step(150)
    walk.step(1, pose=Pose2(*there, 0.0))
    assert not walk.step(199, pose=Pose2(*there, 0.0))
    assert walk.step(3, pose=Pose2(*there, 0.0)), "the robot stands still in the new place"


def test_steps_back_and_forth_give_a_square_each() -> None:
    walk = Walk(rule := Progress(ProgressRule(window_s=1.0, min_side_m=0.1)))
    for x in (0.0, 0.06, -0.06):
        walk.step(10, pose=Pose2(x, 0.0, 0.0))
    assert not walk.step(40, pose=Pose2(-0.06, 0.0, 0.0)), "0.12 m is outside the square"
    rule.restart()
    assert not walk.step(49, pose=Pose2(-0.06, 0.0, 0.0))
    assert walk.step(3, pose=Pose2(-0.06, 0.0, 0.0))


def test_a_square_of_just_its_side_is_not_left() -> None:
    walk = Walk(rule := Progress(ProgressRule(window_s=4.0, min_side_m=0.75)))
    walk.time_s = 0.0
    for time_s, x, held in ((0.0, 0.0, False), (3.9, 0.75, False), (4.0, 0.75, False)):
        walk.time_s = time_s
        assert walk.look(pose=Pose2(x, 0.0, 0.0)) is held, "the side of the square is 0.75 m"
    walk.time_s = 4.0625
    assert walk.look(pose=Pose2(0.75, 0.0, 0.0))
    text, data = rule.evidence()
    assert text == "the robot stayed within 75 cm for 4 s"
    assert data == {"for_s": 4.1, "min_side_m": 0.75}
