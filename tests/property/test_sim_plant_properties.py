"""Properties of the plant in any room, for any duties."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from support.sim_body import box, plant, room, sensors

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan, Polygon

DUTY = st.floats(-1.0, 1.0)
DRIVE = st.lists(st.tuples(DUTY, DUTY, st.integers(1, 700)), min_size=1, max_size=8)


def _polygon(cx: float, cy: float, size: float, sides: int, turn: float) -> Polygon:
    return tuple(
        (
            cx + size * math.cos(turn + 2.0 * math.pi * i / sides),
            cy + size * math.sin(turn + 2.0 * math.pi * i / sides),
        )
        for i in range(sides)
    )


OBSTACLE = st.builds(
    _polygon,
    st.floats(-0.9, 0.9),
    st.floats(-0.9, 0.9),
    st.floats(0.02, 0.35),
    st.integers(3, 7),
    st.floats(0.0, 2.0),
)


@st.composite
def plans(draw: st.DrawFn) -> FloorPlan:
    """Draw a room of about 2 m, sometimes with sharp corners, and up to four obstacles."""
    skew = draw(st.floats(-0.8, 0.8))
    walls = ((-1.0, -1.0), (1.0, -1.0), (1.0 + skew, 1.0), (-1.0 + skew, 1.0))
    # The start (0, 0) is kept free.
    obstacles = tuple(
        o
        for o in draw(st.lists(OBSTACLE, max_size=4))
        if min(math.hypot(x, y) for x, y in o) > 0.17
        and math.hypot(sum(p[0] for p in o), sum(p[1] for p in o)) / len(o) > 0.55
    )
    return room((0.0, 0.0, draw(st.floats(-3.0, 3.0))), walls=walls, obstacles=obstacles)


@given(plan=plans(), drive=DRIVE)
def test_the_disc_never_enters_a_wall(
    plan: FloorPlan, drive: list[tuple[float, float, int]]
) -> None:
    body = plant(plan, level="typical", battery=None)
    suite = sensors(body, level="typical")
    path, energy, contact = 0.0, 0.0, 0.0
    for left, right, ms in drive:
        body.set_duty(left, right)
        for _ in range(4):
            body.advance_ms(ms)
            truth = body.truth
            at = truth.pose
            assert body.world.is_floor(at.x_m, at.y_m)
            assert body.world.clearance_m(at.x_m, at.y_m) > -2e-9
            assert truth.path_m >= path
            assert truth.energy_wh > energy
            assert contact <= truth.contact_s <= contact + 0.001 * ms + 1e-9
            path, energy, contact = truth.path_m, truth.energy_wh, truth.contact_s
            touching = body.world.clearance_m(at.x_m, at.y_m) < 1.9e-5
            if touching:
                assert truth.touch_bearings_rad
            ranges = suite.ranges()
            if ranges.ultrasonic_m is not None:
                assert 0.02 <= ranges.ultrasonic_m <= 4.0


@example(
    # Close to a wall without contact: the loops with and without contact checks once rounded
    # differently here.
    plan=room(
        (0.0, 0.0, 2.5),
        walls=box(-1.0, -1.0, 1.0, 1.0),
        obstacles=(_polygon(-0.25, 0.5, 0.34375, 5, 0.0),),
    ),
    drive=[(0.0, 0.0, 2), (0.5, 0.0, 410), (0.0, 1.0, 214)],
    pieces=[1],
)
@given(plan=plans(), drive=DRIVE, pieces=st.lists(st.integers(1, 60), min_size=1, max_size=10))
def test_how_time_is_split_changes_nothing(
    plan: FloorPlan, drive: list[tuple[float, float, int]], pieces: list[int]
) -> None:
    whole = plant(plan, level="typical", battery=None)
    split = plant(plan, level="typical", battery=None)
    for left, right, ms in drive:
        whole.set_duty(left, right)
        whole.advance_ms(ms)
        split.set_duty(left, right)
        rest, i = ms, 0
        while rest:
            step = min(rest, pieces[i % len(pieces)])
            split.advance_ms(step)
            rest, i = rest - step, i + 1
        assert split.truth == whole.truth


@given(drive=DRIVE)
def test_without_contact_the_path_equals_the_wheels_travel(
    drive: list[tuple[float, float, int]],
) -> None:
    body = plant(room((0.0, 0.0, 0.0), walls=box(-50.0, -50.0, 50.0, 50.0)))
    for left, right, ms in drive:
        body.set_duty(left, right)
        body.advance_ms(ms)
    truth = body.truth
    assert truth.heading_rad * 0.23 == pytest.approx(
        0.0325 * (truth.right_rad - truth.left_rad), abs=1e-9
    )
    assert truth.path_m >= 0.0325 * 0.5 * abs(truth.left_rad + truth.right_rad) - 1e-9
    assert truth.collisions == 0
    assert truth.contact_s == 0.0
