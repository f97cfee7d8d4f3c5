"""The plant's true motion and energy, compared with closed-form solutions."""

from __future__ import annotations

import math

import pytest

from bridge.motion.robot_model import RobotModel
from sim_device.body.battery import BatteryParameters
from sim_device.body.plant import DutyError
from support.sim_body import MOTOR, duty, plant, room, steady_rad_s, terminal_v

MODEL = RobotModel()
RADIUS_M = 0.5 * MODEL.wheel_diameter_m
CENTRE = room((10.0, 10.0, 0.0))


def duty_rad_s(value: float) -> float:
    """Return the steady wheel speed of a duty with a full ideal battery."""
    return steady_rad_s(terminal_v(value, MODEL.battery_v, MODEL.driver_drop_v))


def test_a_step_of_duty_gives_a_first_order_response() -> None:
    body = plant(CENTRE)
    body.set_duty(0.6, 0.6)
    for elapsed_ms in (1, 7, 50, 120):
        body.advance_ms(elapsed_ms - body.tick_ms)
        lag = 1.0 - math.exp(-0.001 * elapsed_ms / MOTOR.time_constant_s)
        assert body.truth.left_rad_s == pytest.approx(duty_rad_s(0.6) * lag, rel=1e-9)


def test_straight_ahead_it_drives_as_far_as_the_lag_implies() -> None:
    body = plant(CENTRE)
    body.set_duty(0.6, 0.6)
    body.advance_ms(3000)
    tau = MOTOR.time_constant_s
    distance = RADIUS_M * duty_rad_s(0.6) * (3.0 - tau * (1.0 - math.exp(-3.0 / tau)))
    truth = body.truth
    assert truth.pose.x_m - 10.0 == pytest.approx(distance, rel=1e-9)
    assert truth.path_m == pytest.approx(distance, rel=1e-9)
    assert truth.pose.y_m == 10.0
    assert truth.v_m_s == pytest.approx(RADIUS_M * duty_rad_s(0.6))


def test_unequal_wheels_drive_a_circle() -> None:
    body = plant(CENTRE)
    body.set_duty(duty(0.15), duty(0.25))
    body.advance_ms(2000)
    radius = 0.20 / (0.10 / MODEL.wheel_base_m)
    pose = body.pose
    centre = pose.transform(0.0, radius)
    start_heading = body.truth.heading_rad
    for _ in range(50):
        body.advance_ms(300)
        at = body.pose
        assert math.dist((at.x_m, at.y_m), centre) == pytest.approx(radius, abs=2e-6)
    assert body.truth.heading_rad - start_heading == pytest.approx(
        15.0 * 0.10 / MODEL.wheel_base_m, rel=1e-9
    )


def test_opposite_wheels_turn_in_place() -> None:
    body = plant(CENTRE)
    body.set_duty(-duty(0.1), duty(0.1))
    body.advance_ms(4000)
    truth = body.truth
    assert (truth.pose.x_m, truth.pose.y_m) == pytest.approx((10.0, 10.0), abs=1e-12)
    assert truth.heading_rad == pytest.approx(
        2.0 * RADIUS_M * truth.right_rad / MODEL.wheel_base_m, rel=1e-12
    )
    assert truth.yaw_rate_rad_s == pytest.approx(0.2 / MODEL.wheel_base_m)
    assert -math.pi <= truth.pose.theta_rad < math.pi < truth.heading_rad


def test_without_duty_it_comes_to_rest_and_stays() -> None:
    body = plant(CENTRE)
    body.set_duty(duty(0.2), duty(0.2))
    body.advance_ms(1000)
    body.set_duty(0.0, 0.0)
    body.advance_ms(400)
    at_rest = body.truth
    assert at_rest.left_rad_s == at_rest.right_rad_s == at_rest.v_m_s == 0.0
    body.advance_ms(1000)
    assert body.pose == at_rest.pose


@pytest.mark.parametrize("value", [0.05, 0.11, 0.149, -0.14])
def test_a_duty_in_the_dead_band_moves_nothing(value: float) -> None:
    body = plant(CENTRE)
    body.set_duty(value, value)
    body.advance_ms(500)
    assert body.pose == CENTRE.start
    assert body.motor_currents_a[0] == pytest.approx(
        terminal_v(value, 16.0, 1.9) / MOTOR.resistance_ohm
    )


def test_duty_is_limited_and_must_be_finite() -> None:
    body = plant(CENTRE)
    body.set_duty(7.0, 7.0)
    body.advance_ms(1000)
    assert body.truth.v_m_s == pytest.approx(RADIUS_M * duty_rad_s(1.0))
    with pytest.raises(DutyError, match="finite"):
        body.set_duty(math.nan, 0.0)


def test_at_rest_it_draws_the_electronics_only() -> None:
    body = plant(CENTRE)
    body.advance_ms(7205)
    assert body.truth.energy_wh == pytest.approx(1.5 * 7.205 / 3600.0, rel=1e-9)


def test_energy_is_the_integral_of_the_battery_power() -> None:
    body = plant(CENTRE, battery=None)
    body.set_duty(0.5, 0.8)
    joules = 0.0
    for _ in range(1500):
        before = sum(d * i for d, i in zip((0.5, 0.8), body.motor_currents_a, strict=True))
        supply_v = body.supply_v
        body.advance_ms(1)
        after = sum(d * i for d, i in zip((0.5, 0.8), body.motor_currents_a, strict=True))
        joules += 0.001 * (1.5 + supply_v * 0.5 * (before + after))
    assert body.truth.energy_wh * 3600.0 == pytest.approx(joules, rel=1e-3)


def test_the_battery_loses_the_charge_that_the_energy_implies() -> None:
    body = plant(CENTRE, battery=BatteryParameters(capacity_ah=0.5))
    body.set_duty(-0.6, 0.6)
    body.advance_ms(60_000)
    used_ah = 0.5 * (1.0 - body.state_of_charge)
    assert body.supply_v < 16.0
    assert body.truth.energy_wh / 16.0 < used_ah < body.truth.energy_wh / body.supply_v


def test_a_sagging_battery_slows_the_wheels() -> None:
    strong, weak = plant(CENTRE), plant(CENTRE, battery=BatteryParameters(resistance_ohm=3.0))
    for body in (strong, weak):
        body.set_duty(0.8, 0.8)
        body.advance_ms(1000)
    assert weak.truth.v_m_s < 0.99 * strong.truth.v_m_s


def test_wheel_tolerances_bend_the_path_and_slip_shortens_it() -> None:
    ideal, harsh = plant(CENTRE), plant(CENTRE, level="harsh", seed=3)
    assert harsh.left_radius_m != harsh.right_radius_m
    for body in (ideal, harsh):
        body.set_duty(0.6, 0.6)
        body.advance_ms(5000)
    assert abs(harsh.truth.heading_rad) > 1e-3
    rolled = 0.5 * (
        harsh.truth.left_rad * harsh.left_radius_m + harsh.truth.right_rad * harsh.right_radius_m
    )
    assert harsh.truth.path_m == pytest.approx(rolled * 0.995, rel=0.015)
    assert harsh.truth.path_m != pytest.approx(rolled, rel=1e-5)


def test_equal_seeds_give_equal_truth_and_others_do_not() -> None:
    def run(seed: int) -> object:
        body = plant(CENTRE, level="typical", seed=seed)
        body.set_duty(0.5, 0.55)
        body.advance_ms(3000)
        return body.truth

    assert run(5) == run(5)
    assert run(5) != run(6)
