"""Velocity that each key and stick commands, how long it lasts, and combinations of keys."""

from __future__ import annotations

import inspect

import pytest

from bridge.motion.observation import HALT, VelocityCommand
from bridge.run.dead_man_switch import DIRECTIONS, DeadManSwitch

AHEAD = {"up": 1.0, "i": 1.0, "down": -1.0, "k": -1.0}
TURN = {"left": 1.0, "j": 1.0, "right": -1.0, "l": -1.0}
"""Sign of each turn key; counter-clockwise is positive, as in the robot's frame."""


def hand(*, releases: bool) -> DeadManSwitch:
    return DeadManSwitch(0.3, 0.2, releases)


@pytest.mark.parametrize("key", DIRECTIONS)
def test_each_key_has_its_velocity(key: str) -> None:
    ahead, turn = AHEAD.get(key, 0.0), TURN.get(key, 0.0)
    held, pressed = hand(releases=True), hand(releases=False)
    held.press(key, 4.0)
    assert held.wanted(4.0) == VelocityCommand(0.2 * ahead, 1.0 * turn)
    pressed.press(key, 4.0)
    assert pressed.wanted(4.0) == VelocityCommand(0.1 * ahead, 0.6 * turn)


def test_a_terminal_reports_no_key_release_unless_asked() -> None:
    assert DeadManSwitch(0.3, 0.2).key_m_s == 0.1


def test_two_keys_add_up_whichever_comes_first() -> None:
    for first, second in (("up", "left"), ("left", "up")):
        both = hand(releases=True)
        both.press(first, 1.0)
        both.press(second, 1.1)
        assert both.wanted(1.1) == VelocityCommand(0.2, 1.0)


@pytest.mark.parametrize(
    ("first", "second", "wanted"),
    [
        ("left", "right", VelocityCommand(0.0, -1.0)),
        ("l", "j", VelocityCommand(0.0, 1.0)),
        ("up", "down", VelocityCommand(-0.2, 0.0)),
        ("k", "i", VelocityCommand(0.2, 0.0)),
    ],
)
def test_the_newer_of_two_opposite_keys_counts(
    first: str, second: str, wanted: VelocityCommand
) -> None:
    both = hand(releases=True)
    both.press(first, 1.0)
    both.press(second, 1.1)
    assert both.wanted(1.1) == wanted


def test_a_key_of_two_that_is_released_leaves_the_other_for_as_long_again() -> None:
    two = hand(releases=True)
    two.press("up", 0.0)
    two.press("left", 0.0)
    two.release("left", 1.0)
    assert two.wanted(2.1875) == VelocityCommand(0.2, 0.0)
    assert two.wanted(2.25) == HALT


@pytest.mark.parametrize(("releases", "holds_s"), [(True, 1.2), (False, 0.7)])
def test_a_key_without_another_event_ends(holds_s: float, *, releases: bool) -> None:
    one = hand(releases=releases)
    one.press("up", 0.0)
    assert one.wanted(holds_s) != HALT
    assert one.wanted(holds_s + 1e-6) == HALT
    assert one.wanted(holds_s) == HALT, "a key that timed out stays released"


# ---- sticks -----------------------------------------------------------------------------------


def test_a_stick_drives_for_half_a_second_while_its_button_is_held() -> None:
    pad = hand(releases=True)
    pad.stick(0.5, -0.25, 8.0, held=True)
    assert pad.wanted(8.0) == VelocityCommand(0.1, -0.25)
    assert pad.wanted(8.5) == VelocityCommand(0.1, -0.25)
    assert pad.wanted(8.5 + 1e-6) == HALT
    assert pad.wanted(8.5) == HALT, "a stick that timed out stays released"


def test_a_stick_stops_when_its_button_or_everything_is_released() -> None:
    pad = hand(releases=True)
    pad.stick(0.5, 0.5, 8.0, held=True)
    pad.stick(0.5, 0.5, 8.1, held=False)
    assert pad.wanted(8.1) == HALT
    pad.stick(0.5, 0.5, 8.2, held=True)
    assert pad.wanted(8.2) != HALT
    pad.release_all()
    assert pad.wanted(8.2) == HALT


def test_after_a_stick_fell_silent_keys_drive_again() -> None:
    both = hand(releases=True)
    both.stick(0.5, 0.0, 8.0, held=True)
    both.press("down", 9.0)
    assert both.wanted(9.0) == HALT, "a timeout of the stick first gives a halt"
    assert both.wanted(9.1) == VelocityCommand(-0.2, 0.0)


@pytest.mark.parametrize(
    ("value", "share"),
    [(7.0, 1.0), (-7.0, -1.0), (float("inf"), 1.0), (float("nan"), 0.0), (0.5, 0.5)],
)
def test_stick_values_are_bounded(value: float, share: float) -> None:
    pad = hand(releases=False)
    pad.stick(value, value, 8.0, held=True)
    assert pad.wanted(8.0) == VelocityCommand(0.2 * share, share)


# ---- speed ------------------------------------------------------------------------------------


def test_speed_changes_by_quarters_between_its_limits() -> None:
    one = hand(releases=True)
    one.faster()
    assert one.speed_m_s == pytest.approx(0.25)
    for _ in range(3):
        one.faster()
    assert one.speed_m_s == 0.3
    one.slower()
    assert one.speed_m_s == pytest.approx(0.24)
    for _ in range(20):
        one.slower()
    assert one.speed_m_s == 0.03


def test_two_of_equal_state_are_equal_and_the_lock_is_nobody_s_argument() -> None:
    assert hand(releases=True) == hand(releases=True)
    assert "lock" not in repr(hand(releases=True))
    assert "_lock" not in inspect.signature(DeadManSwitch).parameters
