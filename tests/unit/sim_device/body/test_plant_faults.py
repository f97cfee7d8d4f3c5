"""Faults of the drive, a lifted robot, moving obstacles and walking people."""

from __future__ import annotations

import math

import pytest

from bridge.motion.robot_model import RobotModel
from sim_device.body.chassis import Chassis
from sim_device.body.plant import WalkerError
from sim_device.world.world import World
from support.sim_body import box, duty, plant, room

CENTRE = room((10.0, 10.0, 0.0))
CRUISE = duty(0.2)
MODEL = RobotModel()


def test_a_stuck_wheel_is_the_pivot() -> None:
    body = plant(CENTRE)
    body.faults.stuck_left = True
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(3000)
    truth = body.truth
    assert truth.left_rad == truth.left_rad_s == 0.0
    half = 0.5 * MODEL.wheel_base_m
    pivot = truth.pose.transform(0.0, half)
    assert pivot == pytest.approx((10.0, 10.0 + half), abs=1e-5)
    assert truth.heading_rad == pytest.approx(0.0325 * truth.right_rad / MODEL.wheel_base_m)
    body.faults.stuck_left = False
    body.advance_ms(1000)
    assert body.truth.v_m_s == pytest.approx(0.2)


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_slipping_wheel_loses_its_share_of_the_way(share: float) -> None:
    body = plant(CENTRE)
    body.faults.slip_right = share
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(2000)
    truth = body.truth
    gone_left, gone_right = 0.0325 * truth.left_rad, 0.0325 * truth.right_rad * (1.0 - share)
    assert truth.path_m == pytest.approx(0.5 * (gone_left + gone_right))
    assert truth.heading_rad == pytest.approx((gone_right - gone_left) / MODEL.wheel_base_m)


def test_a_lifted_robots_wheels_turn_and_it_stays_until_it_is_set_down() -> None:
    body = plant(room((1.84, 1.0, 0.0), walls=box(0.0, 0.0, 2.0, 2.0)), chassis=Chassis())
    body.advance_ms(10)
    assert body.touch_bearings_rad == pytest.approx((0.0,))
    in_contact = body.truth.contact_s
    body.faults.lifted = True
    body.set_duty(CRUISE, 0.9 * CRUISE)
    body.advance_ms(1000)
    truth = body.truth
    assert truth.pose == (1.84, 1.0, 0.0)
    assert truth.path_m == truth.v_m_s == truth.yaw_rate_rad_s == 0.0
    assert truth.left_rad_s * 0.0325 == pytest.approx(0.2)
    assert truth.touch_bearings_rad == ()
    assert truth.contact_s == in_contact
    body.faults.lifted = False
    body.set_duty(-CRUISE, -CRUISE)
    body.advance_ms(1000)
    assert body.pose.x_m < 1.7


def test_wheels_in_the_air_are_quicker() -> None:
    """In the air the wheels do not accelerate the robot: each has m·r²/2 less inertia."""
    body = plant(CENTRE, chassis=Chassis(mass_kg=3.0, caster_drag_n=0.0))
    body.faults.lifted = True
    body.set_duty(0.5, 0.5)
    body.advance_ms(40)
    tau = 0.05 - 0.5 * 3.0 * 0.0325**2 * 8.0 / 1.1**2
    final = (0.5 * 16.0 - 1.9 - 0.5) / 1.1
    assert body.truth.left_rad_s == pytest.approx(final * (1.0 - math.exp(-0.04 / tau)), rel=1e-9)


def test_a_wheel_spins_beyond_its_traction() -> None:
    """With 7 N at each wheel and 3 kg, traction limits the acceleration to 4.67 m/s²."""
    body = plant(CENTRE, chassis=Chassis(caster_drag_n=0.0, mass_kg=3.0))
    body.set_duty(1.0, 1.0)
    body.advance_ms(30)
    truth = body.truth
    assert truth.v_m_s == pytest.approx(0.030 * 14.0 / 3.0, rel=1e-9)
    assert truth.left_rad_s * 0.0325 > 1.2 * truth.v_m_s
    assert truth.path_m == pytest.approx(0.5 * 0.030**2 * 14.0 / 3.0, rel=1e-9)
    body.advance_ms(1000)
    truth = body.truth
    assert truth.v_m_s == pytest.approx(truth.left_rad_s * 0.0325, rel=1e-12)
    assert truth.path_m < 0.0325 * truth.left_rad - 1e-4


# Moving obstacles.


def _world(*obstacles: tuple[tuple[float, float], ...]) -> World:
    return World(room((10.0, 10.0, 0.0), obstacles=obstacles), MODEL, check_start=False)


def test_an_obstacle_put_before_it_stops_it() -> None:
    body = plant(CENTRE)
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(500)
    body.replace_world(_world(box(10.5, 9.0, 11.0, 11.0)))
    body.advance_ms(4000)
    assert body.pose.x_m == pytest.approx(10.5 - 0.16, abs=1e-9)
    assert body.truth.collisions == 1
    body.replace_world(_world())
    body.advance_ms(1000)
    assert body.pose.x_m > 10.5


def test_an_obstacle_put_over_its_rim_pushes_it_off() -> None:
    body = plant(CENTRE)
    body.replace_world(_world(box(10.1, 9.0, 11.0, 11.0)))
    assert body.pose == pytest.approx((9.94, 10.0, 0.0))
    assert not body.held
    assert body.touch_bearings_rad == pytest.approx((0.0,))
    body.advance_ms(100)
    truth = body.truth
    assert truth.collisions == 0
    assert truth.contact_s == pytest.approx(0.1)


def test_an_obstacle_put_over_its_middle_pushes_it_off_too() -> None:
    body = plant(CENTRE)
    body.replace_world(_world(box(9.95, 9.0, 11.0, 11.0)))
    assert (body.pose.x_m, body.pose.y_m) == pytest.approx((9.79, 10.0))


def test_an_enclosing_obstacle_holds_the_robot_until_it_is_removed() -> None:
    body = plant(CENTRE)
    body.replace_world(_world(box(9.0, 9.0, 11.0, 11.0)))
    held = [body.held]
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1000)
    truth = body.truth
    assert truth.pose == CENTRE.start
    assert truth.contact_s == pytest.approx(1.0)
    assert truth.collisions == 0
    assert truth.v_m_s == 0.0
    assert truth.touch_bearings_rad
    body.replace_world(_world())
    held.append(body.held)
    assert held == [True, False]
    body.advance_ms(1000)
    assert body.pose.x_m > 10.1
    assert body.touch_bearings_rad == ()


def test_it_is_never_pushed_through_a_wall_that_stood() -> None:
    """A box pushes the robot towards a shelf that is 20 mm thick."""
    shelf = box(10.17, 9.0, 10.19, 11.0)
    body = plant(room((10.0, 10.0, 0.0), obstacles=(shelf,)))
    body.replace_world(_world(shelf, box(9.0, 9.0, 10.1, 11.0)))
    assert body.held
    assert body.pose == CENTRE.start


# People.


def test_a_chair_leg_ahead_stops_the_robot_and_is_detected() -> None:
    body = plant(CENTRE)
    body.set_walker(10.5, 10.0, 0.06)
    assert body.world.walker.tolist() == [10.5, 10.0, 0.06]
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(3000)
    truth = body.truth
    assert truth.pose.x_m == pytest.approx(10.5 - 0.06 - 0.16, abs=1e-6)
    assert truth.collisions == 1
    assert truth.touch_bearings_rad == pytest.approx((0.0,))
    body.clear_walker()
    body.advance_ms(500)
    assert body.touch_bearings_rad == ()
    assert body.pose.x_m > 10.3
    assert body.world.walker[2] == 0.0


def test_a_leg_that_walks_pushes_it_and_counts_by_its_own_speed() -> None:
    body = plant(CENTRE)
    for step in range(101):
        body.set_walker(10.0, 9.5 + 0.005 * step, 0.06)
        body.advance_ms(10)
    truth = body.truth
    assert truth.pose.y_m == pytest.approx(10.0 + 0.22, abs=1e-6)
    assert truth.pose.x_m == pytest.approx(10.0, abs=1e-9)
    assert truth.collisions == 1
    assert truth.v_lateral_m_s == pytest.approx(0.5, rel=1e-3)
    assert truth.touch_bearings_rad == pytest.approx((-math.pi / 2,))
    for _ in range(2):
        body.set_walker(10.0, 9.0, 0.06)
        body.advance_ms(10)
    assert body.touch_bearings_rad == ()


def test_a_leg_that_creeps_up_is_contact_but_no_collision() -> None:
    body = plant(CENTRE)
    for step in range(200):
        body.set_walker(9.76 + 0.0002 * step, 10.0, 0.06)
        body.advance_ms(10)
    assert body.truth.collisions == 0
    assert body.truth.contact_s > 0.5
    assert body.pose.x_m > 10.015


def test_between_a_leg_and_a_wall_the_wall_wins() -> None:
    body = plant(room((1.83, 1.0, 0.0), walls=box(0.0, 0.0, 2.0, 2.0)))
    for step in range(60):
        body.set_walker(1.5 + 0.005 * step, 1.0, 0.06)
        body.advance_ms(10)
    assert body.pose.x_m == pytest.approx(1.84, abs=1e-6)
    assert len(body.touch_bearings_rad) == 2


@pytest.mark.parametrize("radius_m", [0.0, -1.0, math.nan])
def test_a_leg_has_a_size(radius_m: float) -> None:
    with pytest.raises(WalkerError, match="radius above 0"):
        plant(CENTRE).set_walker(1.0, 1.0, radius_m)


def test_rays_meet_a_leg_on_its_round_side() -> None:
    import numpy as np  # noqa: PLC0415 - used here only

    made = World(CENTRE, MODEL).with_walker(12.0, 10.0, 0.1)
    rays = np.array([[10.0, 10.0, 1.0, 0.0], [10.0, 10.06, 1.0, 0.0], [10.0, 10.2, 1.0, 0.0]])
    ranges, cosines = made.cast(*rays.T)
    assert ranges == pytest.approx([1.9, 2.0 - 0.08, 10.0])
    assert cosines == pytest.approx([1.0, 0.8, 1.0])
