"""Carpets and thresholds in room files, and their effect on the robot."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bridge.floor_plan.floor_plan import Carpet, FloorPlanError, Threshold, parse_floorplan
from sim_device.body.chassis import Chassis
from sim_device.body.motors import MotorParameters
from support.sim_body import box, duty, plant, room

if TYPE_CHECKING:
    from sim_device.body.plant import Plant

CENTRE = room((10.0, 10.0, 0.0))
CRUISE = duty(0.2)
MOTOR = MotorParameters()
HEAVY = Chassis(caster_drag_n=0.0)
SQUARE = {"walls": [[0, 0], [4, 0], [4, 4], [0, 4]], "start": [1, 1, 0]}


def on(*, carpets: tuple[Carpet, ...] = (), thresholds: tuple[Threshold, ...] = ()) -> Plant:
    return plant(replace(CENTRE, carpets=carpets, thresholds=thresholds), chassis=HEAVY)


def bar(height_m: float, x_m: float = 10.3) -> tuple[Threshold, ...]:
    return (Threshold((x_m, 9.0), (x_m, 11.0), height_m),)


# The room file.


def test_a_room_file_may_declare_carpets_and_thresholds() -> None:
    extra = {
        "carpets": [
            {"polygon": [[1, 1], [2, 1], [2, 2]], "drag_n": 6, "slip": 0.1, "pile": "long"},
            {"polygon": [[1, 1], [2, 1], [2, 2]]},
        ],
        "thresholds": [{"line": [[0, 3], [4, 3]], "height_m": 0.004}],
        "curtains": "ignored",
    }
    plan = parse_floorplan(json.dumps(SQUARE | extra))
    triangle = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))
    assert plan.carpets == (Carpet(triangle, 6.0, 0.1), Carpet(triangle, 4.0, 0.02))
    assert plan.thresholds == (Threshold((0.0, 3.0), (4.0, 3.0), 0.004),)
    assert parse_floorplan(plan.to_json()) == plan
    assert parse_floorplan(json.dumps(SQUARE)).carpets == ()


TRIANGLE = [[1, 1], [2, 1], [2, 2]]


@pytest.mark.parametrize(
    ("key", "value", "names"),
    [
        ("carpets", {}, "carpets:"),
        ("carpets", [3], r"carpets\[0\]:"),
        ("carpets", [{"polygon": [[1, 1]]}], r"carpets\[0\].polygon:"),
        ("carpets", [{"drag_n": 1}], r"carpets\[0\].polygon:"),
        ("carpets", [{"polygon": TRIANGLE, "drag_n": -1}], r"carpets\[0\].drag_n: -1 .* 0 to 50"),
        ("carpets", [{"polygon": TRIANGLE, "slip": 0.9}], r"carpets\[0\].slip: 0.9 .* 0 to 0.5"),
        ("carpets", [{"polygon": TRIANGLE, "slip": "a"}], r"carpets\[0\].slip: 'a' is not a"),
        ("carpets", [{"polygon": TRIANGLE, "slip": None}], r"carpets\[0\].slip: None is not"),
        ("thresholds", "x", "thresholds:"),
        ("thresholds", [{"height_m": 0.01}], r"thresholds\[0\].line: is missing"),
        ("thresholds", [{"line": [[1, 1], [1, 1]], "height_m": 0.01}], r"thresholds\[0\].line:"),
        ("thresholds", [{"line": [[1, 1], [2, "b"]], "height_m": 1}], r"thresholds\[0\].line\[1\]"),
        ("thresholds", [{"line": [[1, 1], [2, 1]]}], r"thresholds\[0\].height_m: is missing"),
        ("thresholds", [{"line": [[1, 1], [2, 1]], "height_m": 0}], r"height_m: must be above 0"),
        ("thresholds", [{"line": [[1, 1], [2, 1]], "height_m": 1}], r"height_m: 1 must be from"),
        ("thresholds", [{"line": [[1, 1], [2, 1]], "height_m": 10**400}], r"height_m: 1000"),
    ],
)
def test_a_wrong_value_is_named_in_one_line(key: str, value: object, names: str) -> None:
    with pytest.raises(FloorPlanError, match=names) as caught:
        parse_floorplan(json.dumps(SQUARE | {key: value}))
    assert "\n" not in str(caught.value)


# Carpets.


def test_a_carpet_drags_on_the_wheels_that_stand_on_it() -> None:
    """Each wheel has half of the drag of 4 N, which reduces its speed by F·r·R/K²."""
    body = on(carpets=(Carpet(box(5.0, 5.0, 15.0, 15.0), 4.0, 0.0),))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(2000)
    slower = 2.0 * 0.0325 * MOTOR.resistance_ohm / MOTOR.back_emf_v_s**2
    assert body.truth.left_rad_s == pytest.approx(0.2 / 0.0325 - slower, rel=1e-9)
    assert body.truth.v_m_s == pytest.approx(0.0325 * body.truth.left_rad_s, rel=1e-9)


def test_a_carpet_under_one_wheel_pulls_the_robot_to_its_side() -> None:
    body = on(carpets=(Carpet(box(5.0, 10.0, 15.0, 15.0), 4.0, 0.0),))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(500)
    slower = 2.0 * 0.0325 * MOTOR.resistance_ohm / MOTOR.back_emf_v_s**2
    assert body.truth.yaw_rate_rad_s == pytest.approx(slower * 0.0325 / 0.23, rel=1e-3)
    assert body.truth.heading_rad > 0.02
    assert body.truth.left_rad_s < body.truth.right_rad_s == pytest.approx(0.2 / 0.0325, rel=1e-3)


def test_a_carpet_takes_its_share_of_the_travel() -> None:
    body = on(carpets=(Carpet(box(5.0, 5.0, 15.0, 15.0), 0.0, 0.1),))
    body.advance_ms(10)
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(2000)
    truth = body.truth
    assert truth.path_m == pytest.approx(0.9 * 0.0325 * truth.left_rad, rel=1e-9)


def test_off_the_carpet_it_is_as_before() -> None:
    body = on(carpets=(Carpet(box(9.0, 9.0, 10.2, 11.0)),))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(1000)
    slow = body.truth.v_m_s
    body.advance_ms(2000)
    assert slow < 0.99 * body.truth.v_m_s
    assert body.truth.v_m_s == pytest.approx(0.2, rel=1e-9)


def test_too_little_duty_stalls_on_a_thick_carpet() -> None:
    body = on(carpets=(Carpet(box(5.0, 5.0, 15.0, 15.0), 10.0, 0.0),))
    body.advance_ms(10)
    body.set_duty(duty(0.03), duty(0.03))
    body.advance_ms(1000)
    assert body.truth.left_rad == 0.0


# Thresholds.


def test_a_threshold_takes_energy_and_gives_it_back() -> None:
    """Gravity is conservative, so crossing the bar needs the same motor work as a flat floor."""
    bodies = [on(), on(thresholds=bar(0.004))]
    slowest = []
    for body in bodies:
        body.set_duty(CRUISE, CRUISE)
        speeds = []
        while body.pose.x_m < 10.6:
            body.advance_ms(1)
            speeds.append(body.truth.v_m_s)
        slowest.append(min(speeds[200:]))
    flat, hill = (body.energy.shaft_j for body in bodies)
    assert hill == pytest.approx(flat, rel=2e-3)
    assert slowest[1] < 0.95 * slowest[0]
    assert bodies[1].truth.v_m_s == pytest.approx(0.2, rel=1e-2)


def test_on_top_the_motors_have_lifted_the_weight() -> None:
    """The wheels carry 80 % of the weight. The additional work is m·g·h of this share."""
    bodies = [on(), on(thresholds=bar(0.004))]
    for body in bodies:
        body.set_duty(CRUISE, CRUISE)
        while body.pose.x_m < 10.3:
            body.advance_ms(1)
    flat, hill = bodies
    inertia = MOTOR.time_constant_s * MOTOR.back_emf_v_s**2 / MOTOR.resistance_ohm
    slowed = inertia * (flat.truth.left_rad_s**2 - hill.truth.left_rad_s**2)
    lifted = 3.0 * 0.8 * 9.80665 * 0.004
    assert hill.energy.shaft_j + slowed - flat.energy.shaft_j == pytest.approx(lifted, rel=0.03)
    assert hill.inertial.pitch_rad == pytest.approx(-0.004 / 0.115, rel=0.02)


def test_a_threshold_stalls_a_slow_robot_and_not_a_quick_one() -> None:
    slow, quick = on(thresholds=bar(0.005)), on(thresholds=bar(0.005))
    slow.set_duty(duty(0.03), duty(0.03))
    quick.set_duty(CRUISE, CRUISE)
    for body in (slow, quick):
        body.advance_ms(20_000)
    assert slow.truth.left_rad_s == pytest.approx(0.0, abs=1e-3)
    assert 10.15 < slow.pose.x_m < 10.3
    assert quick.pose.x_m > 11.0


def test_a_threshold_too_steep_for_the_tyres_lets_the_wheels_spin() -> None:
    body = on(thresholds=bar(0.015))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(10_000)
    assert body.pose.x_m < 10.3
    assert abs(body.truth.v_m_s) < 0.02
    assert body.truth.left_rad_s * 0.0325 > 0.05
    assert body.truth.left_rad * 0.0325 > body.pose.x_m - 10.0 + 0.3


def test_beside_a_threshold_nothing_is_felt() -> None:
    body = on(thresholds=(Threshold((10.3, 10.2), (10.3, 12.0), 0.01),))
    body.set_duty(CRUISE, CRUISE)
    body.advance_ms(4000)
    assert body.truth.v_m_s == pytest.approx(0.2, rel=1e-9)
    assert body.truth.heading_rad == 0.0


def test_the_inertial_sensor_feels_the_tilt() -> None:
    """With the caster on a bar, the robot pitches up and measures g·sin(pitch) forwards."""
    body = on(thresholds=bar(0.003, 10.0 + Chassis().caster_x_m))
    body.advance_ms(100)
    before = body.inertial
    body.advance_ms(1000)
    after = body.inertial
    pitch = 0.003 / Chassis().caster_x_m
    assert after.pitch_rad == pytest.approx(pitch)
    assert after.roll_rad == 0.0
    felt = after.impulse_x_m_s - before.impulse_x_m_s
    assert felt == pytest.approx(9.80665 * math.sin(pitch), rel=1e-6)


def test_one_wheel_on_a_bar_tilts_it_sideways() -> None:
    along = (Threshold((9.0, 10.115), (11.0, 10.115), 0.003),)
    body = on(thresholds=along)
    body.advance_ms(10)
    assert body.inertial.roll_rad == pytest.approx(0.003 / 0.23)
    assert body.inertial.climb_m_s == 0.0


def test_how_time_is_split_changes_nothing_on_uneven_floor() -> None:
    def run(pieces: int) -> object:
        plan = replace(CENTRE, carpets=(Carpet(box(9.0, 10.0, 10.2, 12.0)),), thresholds=bar(0.004))
        body = plant(plan, chassis=Chassis(), level="typical", battery=None)
        body.set_duty(CRUISE, 1.02 * CRUISE)
        for _ in range(3000 // pieces):
            body.advance_ms(pieces)
        return body.truth, body.inertial

    assert run(3000) == run(1) == run(25)
