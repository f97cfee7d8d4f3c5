"""The ultrasonic range ahead, used by a robot that turns while it drives."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.motion.control.confirmed_range import ConfirmedRange
from bridge.motion.control.wall_follow import FollowTuning

STOP_M, MIN_M, STEP_S = 0.05, 0.002, 0.02


def make() -> ConfirmedRange:
    tune = FollowTuning()
    return ConfirmedRange(STOP_M, held_s=tune.held_s, silent_s=tune.silent_s, leap_m=tune.leap_m)


def is_blocked(*ranges_m: float | None, dt_s: float = 0.05) -> list[bool]:
    room = make()
    found = []
    for range_m in ranges_m:
        room.update(range_m, MIN_M, dt_s)
        found.append(room.is_blocked)
    return found


def test_free_distance_is_the_range_beyond_the_stop_range() -> None:
    room = make()
    assert room.update(0.30, MIN_M, STEP_S) == pytest.approx(0.25)
    assert room.update(0.04, MIN_M, STEP_S) == pytest.approx(-0.01)
    assert room.update(None, MIN_M, STEP_S) == math.inf


def test_a_nearer_wall_blocks_at_once_but_a_new_echo_with_the_next_reading() -> None:
    assert is_blocked(0.10, 0.06, 0.051, None) == [False, False, True, False]
    assert is_blocked(0.40, 0.051, 0.39, 0.38) == [False, False, False, False]
    assert is_blocked(0.40, 0.051, 0.050) == [False, False, True]
    assert is_blocked(0.051) == [True], "it may have begun there"


def test_intermittent_echoes_of_a_leg_count_but_two_distant_outliers_do_not() -> None:
    assert is_blocked(0.40, 0.051, 0.40, 0.051) == [False, False, False, True]
    assert is_blocked(0.40, 0.051, *([0.40, 0.41] * 3), 0.051) == [False] * 9


def test_one_lost_echo_is_not_nothing_and_a_silence_is() -> None:
    assert is_blocked(0.10, None, 0.051) == [False, False, True]
    assert is_blocked(0.10, *([None] * 7), 0.051, 0.050) == [*([False] * 9), True]


def test_a_reading_that_is_held_is_one_reading() -> None:
    assert is_blocked(0.40, *([0.051] * 6), dt_s=STEP_S) == [False] * 7
    assert is_blocked(0.40, *([0.051] * 9), dt_s=STEP_S)[-1], "longer than any is held"


@given(
    st.lists(st.floats(0.02, 3.0).map(lambda x: round(x, 3)) | st.none(), min_size=1, max_size=30)
)
def test_it_is_blocked_only_without_room_and_by_two_sensors_that_agree(
    ranges_m: list[float | None],
) -> None:
    found = is_blocked(*ranges_m)
    seen = [(k, r) for k, r in enumerate(ranges_m) if r is not None]
    strange_k = -9
    for (before, earlier), (k, range_m) in pairwise(seen):
        if range_m == earlier or abs(earlier - range_m - 0.1) < 1e-6:
            continue
        near = range_m <= STOP_M + MIN_M
        led_up_to = earlier - range_m <= 0.1 and (k - before) * 0.05 <= 0.3
        assert not found[k] or near
        if near and led_up_to and k - before < 6:
            assert found[k]
        if near and not led_up_to:
            if k - strange_k > 6 and k - before == 1:
                assert not found[k]
            strange_k = k
