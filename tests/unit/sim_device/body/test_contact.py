"""Contact with walls: stopping, wheel slip, sliding and counting of collisions."""

from __future__ import annotations

import math

import pytest

from sim_device.body.plant import Chassis
from sim_device.sensors.contacts import Bumpers, bumpers
from support.sim_body import box, duty, plant, room, sensors

WALL_X_M = 2.0
CRUISE = duty(0.2)


def facing_wall(gap_m: float) -> tuple[float, float, float]:
    return (WALL_X_M - 0.16 - gap_m, 1.0, 0.0)


SMALL = box(0.0, 0.0, WALL_X_M, 2.0)


def test_a_wall_stops_the_disc_and_the_wheels_slip() -> None:
    body = plant(room(facing_wall(0.1), walls=SMALL))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(3000)
    truth = body.truth
    assert truth.pose.x_m == pytest.approx(WALL_X_M - 0.16, abs=1e-9)
    assert truth.v_m_s == 0.0
    assert truth.path_m == pytest.approx(0.1, abs=1e-6)
    assert 0.0 < truth.left_rad_s * 0.0325 < 0.17
    assert truth.left_rad * 0.0325 > 0.3
    assert truth.touch_bearings_rad == pytest.approx((0.0,))


def test_a_weak_push_stalls_the_wheels_and_is_no_collision() -> None:
    body = plant(room(facing_wall(0.005), walls=SMALL))
    body.set_duty(duty(0.02), duty(0.02))
    body.advance_ms(2000)
    truth = body.truth
    assert truth.left_rad_s == truth.right_rad_s == 0.0
    assert truth.collisions == 0
    assert truth.contact_s > 1.0
    stalled = body.truth.left_rad
    body.advance_ms(500)
    assert body.truth.left_rad == stalled
    assert body.truth.contact_s == pytest.approx(truth.contact_s + 0.5)


def test_one_bump_is_one_collision_however_long_it_pushes() -> None:
    body = plant(room(facing_wall(0.1), walls=SMALL))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(5000)
    assert body.truth.collisions == 1


@pytest.mark.parametrize(("away_ms", "collisions"), [(150, 1), (900, 2)])
def test_a_collision_counts_again_only_after_half_a_second_free(
    away_ms: int, collisions: int
) -> None:
    body = plant(room(facing_wall(0.1), walls=SMALL))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1500)
    body.set_duty(-CRUISE, -CRUISE)
    body.advance_ms(away_ms)
    assert body.truth.touch_bearings_rad == ()
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1500)
    assert body.truth.collisions == collisions


def test_it_slides_along_a_wall_with_friction() -> None:
    heading = math.radians(30.0)
    body = plant(room((10.0, 0.17, -heading)))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1000)
    before = body.truth
    body.advance_ms(1000)
    after = body.truth
    assert after.pose.y_m == pytest.approx(0.16, abs=1e-9)
    driven = 0.0325 * (after.left_rad - before.left_rad)
    kept = math.cos(heading) - Chassis().wall_friction * math.sin(heading)
    assert after.pose.x_m - before.pose.x_m == pytest.approx(driven * kept, rel=1e-6)
    assert after.v_lateral_m_s == pytest.approx(
        0.0325 * after.left_rad_s * kept * math.sin(heading), rel=1e-6
    )
    assert after.collisions == 1


def test_a_push_within_the_friction_cone_does_not_slide() -> None:
    body = plant(room((10.0, 0.17, math.radians(-85.0))))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(500)
    before = body.pose
    body.advance_ms(1000)
    assert body.pose == before


def test_grazing_is_contact_but_no_collision() -> None:
    body = plant(room((10.0, 0.1601, math.radians(-1.0))))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(4000)
    truth = body.truth
    assert truth.collisions == 0
    assert truth.contact_s > 2.0
    assert truth.pose.x_m > 10.6


def test_sliding_on_into_a_second_wall_is_a_collision() -> None:
    body = plant(room((WALL_X_M - 0.5, 0.1601, math.radians(-1.0)), walls=SMALL))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1200)
    assert body.truth.collisions == 0
    assert body.truth.contact_s > 0.5
    body.advance_ms(1500)
    truth = body.truth
    assert truth.collisions == 1
    assert len(truth.touch_bearings_rad) == 2
    assert (truth.pose.x_m, truth.pose.y_m) == pytest.approx((WALL_X_M - 0.16, 0.16), abs=3e-5)


def test_a_wall_in_many_pieces_is_one_wall() -> None:
    corners = [(0.5 * i, 0.0) for i in range(20)] + [(10.0, 5.0), (0.0, 5.0)]
    body = plant(room((1.0, 0.17, math.radians(-30.0)), walls=tuple(corners)))
    body.set_duty(CRUISE, CRUISE)
    for _ in range(400):
        body.advance_ms(50)
    assert body.pose.x_m > 2.5
    assert body.truth.collisions == 1


def test_it_slides_round_a_corner_that_juts_out() -> None:
    obstacle = box(5.0, 5.0, 6.0, 6.0)
    body = plant(room((4.6, 6.1, 0.0), obstacles=(obstacle,)))
    body.set_duty(CRUISE, CRUISE)
    for _ in range(100):
        body.advance_ms(100)
        at = body.pose
        nearest = math.hypot(max(5.0 - at.x_m, 0.0, at.x_m - 6.0), max(0.0, at.y_m - 6.0))
        assert nearest >= 0.16 - 1e-8
    assert body.pose.x_m > 6.0
    assert body.truth.path_m < 0.0325 * body.truth.left_rad


@pytest.mark.parametrize("start_y_m", [2.7 + 1e-5 * n for n in range(0, 20, 3)])
@pytest.mark.parametrize("heading_deg", [-90.0, -90.1, -89.6])
def test_in_a_wedge_both_sides_are_touched_for_any_step(
    start_y_m: float, heading_deg: float
) -> None:
    """The disc moves along a wall towards a leg that leaves too narrow a gap, and touches it."""
    leg = ((0.3, 2.4946), (0.342, 2.5076), (0.329, 2.5497), (0.287, 2.5366))
    start = (0.16, start_y_m, math.radians(heading_deg))
    body = plant(room(start, walls=box(0.0, 0.0, 4.0, 4.0), obstacles=(leg,)))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(3000)
    truth = body.truth
    assert truth.v_m_s == 0.0
    assert math.dist(truth.pose[:2], leg[-1]) == pytest.approx(0.16, abs=2e-5)
    assert bumpers(truth.touch_bearings_rad) == Bumpers(left=True, right=False)
    assert truth.collisions == 1


def test_turning_in_place_against_a_wall_is_free() -> None:
    body = plant(room(facing_wall(0.0), walls=SMALL))
    body.set_duty(-CRUISE, CRUISE)
    body.advance_ms(1000)
    truth = body.truth
    assert truth.heading_rad == pytest.approx(2.0 * 0.0325 * truth.right_rad / 0.23)
    assert truth.pose.x_m == pytest.approx(WALL_X_M - 0.16, abs=1e-9)


def test_it_backs_off_freely() -> None:
    body = plant(room(facing_wall(0.05), walls=SMALL))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1000)
    body.set_duty(-CRUISE, -CRUISE)
    body.advance_ms(1000)
    truth = body.truth
    assert truth.v_m_s == pytest.approx(-0.2)
    assert truth.touch_bearings_rad == ()


@pytest.mark.parametrize(
    ("bearing_deg", "pressed"),
    [
        (0.0, Bumpers(left=True, right=True)),
        (9.0, Bumpers(left=True, right=True)),
        (-9.0, Bumpers(left=True, right=True)),
        (11.0, Bumpers(left=True, right=False)),
        (-11.0, Bumpers(left=False, right=True)),
        (80.0, Bumpers(left=True, right=False)),
        (-80.0, Bumpers(left=False, right=True)),
        (90.0, Bumpers(left=False, right=False)),
        (-120.0, Bumpers(left=False, right=False)),
        (180.0, Bumpers(left=False, right=False)),
    ],
)
def test_bumper_halves(bearing_deg: float, pressed: Bumpers) -> None:
    assert bumpers([math.radians(bearing_deg)]) == pressed


def test_two_touches_press_both_halves() -> None:
    assert bumpers([0.9, -0.7]) == Bumpers(left=True, right=True)
    assert bumpers([]) == Bumpers(left=False, right=False)


@pytest.mark.parametrize(
    ("heading_deg", "pressed"), [(0.0, (True, True)), (30.0, (False, True)), (-30.0, (True, False))]
)
def test_bumper_switches_show_the_side_of_a_wall(
    heading_deg: float, pressed: tuple[bool, bool]
) -> None:
    body = plant(room((WALL_X_M - 0.2, 1.0, math.radians(heading_deg)), walls=SMALL))
    suite = sensors(body)
    assert suite.bumpers() == (False, False)
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(600)
    assert suite.bumpers() == pressed
    assert suite.cliff() is False


def test_accelerations_add_up_to_the_velocity_while_sliding_in_a_bend() -> None:
    body = plant(room((10.0, 0.3, math.radians(-20.0))))
    body.set_duty(duty(0.22), duty(0.12))
    vx = vy = 0.0
    before = body.truth
    while body.truth.contact_s < 0.4:
        body.advance_ms(1)
        after = body.truth
        mid = 0.5 * (before.heading_rad + after.heading_rad)
        felt_x = after.impulse_x_m_s - before.impulse_x_m_s
        felt_y = after.impulse_y_m_s - before.impulse_y_m_s
        vx += math.cos(mid) * felt_x - math.sin(mid) * felt_y
        vy += math.sin(mid) * felt_x + math.cos(mid) * felt_y
        before = after
    c, s = math.cos(before.heading_rad), math.sin(before.heading_rad)
    assert before.v_lateral_m_s > 0.02
    assert vx == pytest.approx(before.v_m_s * c - before.v_lateral_m_s * s, abs=3e-4)
    assert vy == pytest.approx(before.v_m_s * s + before.v_lateral_m_s * c, abs=3e-4)
