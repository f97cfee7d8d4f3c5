"""The rules for tilt, lifting, bumps and cliffs, exactly at their limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.supervise.rules.bodily import Bump, Cliff, Lifted, Tilt
from bridge.supervise.rules.fence import Fence
from bridge.supervise.rules.progress import Progress
from bridge.supervise.settings import BumpRule, CliffRule, FenceRule, ProgressRule, TiltRule
from protocol.messages.values import Contact
from support.watching import G_LSB, Walk, imu, reading, status

if TYPE_CHECKING:
    from bridge.supervise.rules.conditions import Condition
    from protocol.messages.device import Imu

LEFT, RIGHT, CLIFF = (
    int(Contact.BUMPER_LEFT),
    int(Contact.BUMPER_RIGHT),
    int(Contact.CLIFF),
)
JOLT = round(G_LSB * 1.25)


def leaning(degrees: float) -> Imu:
    along, up = (round(G_LSB * f(math.radians(degrees))) for f in (math.sin, math.cos))
    return imu(along, 0, up)


@pytest.mark.parametrize(
    ("rule", "held"),
    [
        (Tilt(TiltRule()), False),
        (Lifted(), True),
        (Bump(BumpRule()), False),
        (Cliff(CliffRule()), True),
        (Progress(ProgressRule()), False),
        (Fence(FenceRule()), False),
    ],
    ids=lambda value: type(value).__name__.lower(),
)
def test_no_single_finding_requires_the_second_reaction(rule: Condition, *, held: bool) -> None:
    """The device detects no floor and sets every fault bit, including ``LIFTED``."""
    assert rule.grave is False
    assert Walk(rule).step(3, imu=imu(), range=reading(1.0)) is False
    assert rule.grave is False
    found = Walk(rule).step(1, range=reading(contacts=CLIFF), status=status(0xFFFF))
    assert found is held
    assert rule.grave is False, "the first finding is not severe"


def test_a_tilt_equal_to_the_limit_is_allowed() -> None:
    """Gravity has the components 4/5 (vertical) and 3/5 (forward), so the cosine is exactly 0.8."""
    rule = Tilt(TiltRule(angle_deg=math.degrees(math.acos(0.8))))
    walk = Walk(rule)
    sample = imu(3000, 0, 4000)
    assert [walk.step(1, imu=sample), walk.step(1, imu=sample)] == [False, False]
    for mark in range(200):
        walk.step(1, imu=imu(3000, 0, 3990, mark=mark))
    assert walk.held
    assert rule.evidence() == ("the robot tilts by 37°", {"angle_deg": 36.9})


def test_a_sample_counts_once_however_long_it_is_shown() -> None:
    """A sample after 20 ms moves the mean by a tenth of the difference to 20°."""
    walk = Walk(rule := Tilt(TiltRule(angle_deg=1.5)))
    walk.step(50, imu=imu())
    shock = leaning(20.0)
    assert walk.step(10, imu=shock)
    assert rule.evidence()[1] == {"angle_deg": 2.0}


def test_a_step_longer_than_its_time_constant_does_not_smooth() -> None:
    walk = Walk(rule := Tilt(TiltRule(angle_deg=12.0)))
    walk.step(1, imu=imu())
    walk.time_s += 0.28
    assert walk.step(1, imu=leaning(20.0))
    assert rule.evidence()[1] == {"angle_deg": 20.0}


def test_an_accelerometer_gives_at_least_a_direction() -> None:
    assert Walk(Tilt(TiltRule())).step(1, imu=imu(0, 0, -1))


def test_a_jolt_lasts_less_than_a_second() -> None:
    for gap_s, found in ((0.9999, True), (1.0, False)):
        walk = Walk(Lifted())
        for step in range(-10, 1):  # a jolt of 0.2 s
            walk.time_s = 0.02 * step
            walk.look(imu=imu(0, 0, JOLT), range=reading())
        walk.time_s = gap_s
        assert walk.look(imu=imu(), range=reading(contacts=CLIFF)) is found


def test_bumps_are_counted_up_to_the_windows_end() -> None:
    for gap_s, found in ((8.0, True), (8.001, False)):
        walk = Walk(Bump(BumpRule(count=2.0, window_s=8.0, held_s=5.0)))
        walk.time_s = 0.0
        walk.look(range=reading())
        walk.look(range=reading(contacts=LEFT))
        walk.look(range=reading())
        walk.time_s = gap_s
        assert walk.look(range=reading(contacts=LEFT)) is found


def test_a_bumper_is_held_from_the_limit_on() -> None:
    walk = Walk(rule := Bump(BumpRule(count=9.0, window_s=8.0, held_s=2.5)))
    walk.time_s = 1.0
    walk.look(range=reading(contacts=RIGHT))
    walk.time_s = 3.499
    assert not walk.look(range=reading(contacts=RIGHT))
    assert rule.evidence() == ("1 bumps in 8 s", {"count": 1, "window_s": 8.0, "held_s": 2.5})
    walk.time_s = 3.5
    assert walk.look(range=reading(contacts=RIGHT))
    text = "a bumper has been pressed for 2 s"
    assert rule.evidence() == (text, {"count": 1, "window_s": 8.0, "held_s": 2.5})
    walk.time_s = 3.625
    walk.look(range=reading(contacts=RIGHT))
    assert rule.evidence()[1]["held_s"] == 2.62


def test_at_the_limit_it_is_not_grave_and_a_step_ahead_is() -> None:
    walk = Walk(rule := Cliff(CliffRule(ahead_m=0.0)))
    assert walk.step(5, range=reading(contacts=CLIFF))
    grave = [rule.grave]
    walk.step(1, left_m=0.0123, right_m=0.0123, range=reading(contacts=CLIFF))
    grave.append(rule.grave)
    text, data = rule.evidence()
    assert text == "no floor ahead, and the robot drove on by 1 cm"
    assert data == {"ahead_m": 0.012}
    rule.restart()
    assert [*grave, rule.grave] == [False, True, False]
