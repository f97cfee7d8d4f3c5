"""The energy balance of the battery, and a robot with an empty battery."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from sim_device.body.battery import BatteryParameters
from sim_device.body.chassis import Chassis
from sim_device.body.motors import MotorParameters
from support.sim_body import IDEAL_BATTERY, box, duty, plant, room

if TYPE_CHECKING:
    from sim_device.body.plant import Plant

CENTRE = room((10.0, 10.0, 0.0))
MOTOR = MotorParameters()
DROP_V = 1.9


def _both(body: Plant) -> list[tuple[float, float]]:
    return list(zip(body.motor_voltages_v, body.motor_currents_a, strict=True))


def test_the_batterys_energy_equals_the_sum_of_its_consumers() -> None:
    """The test integrates voltages and currents itself, by the trapezoidal rule."""
    body = plant(CENTRE, battery=BatteryParameters(), chassis=Chassis())
    battery = internal = electronics = bridge = winding = shaft = 0.0
    for drive in ((0.5, 0.8), (0.9, 0.3), (-0.7, 0.7), (0.0, 0.0), (0.6, 0.6)):
        body.set_duty(*drive)
        for _ in range(400):
            rates = []
            duties, supply_v = drive, body.supply_v
            for after in (False, True):
                if after:
                    body.advance_ms(1)
                terms = [0.0, 0.0, 0.0, 0.0]
                left, right = (before := _both(body)) if not after else _same_volt(before, body)
                for share, (volt, amp) in zip(duties, (left, right), strict=True):
                    drawn = max(0.0, share * amp) * supply_v
                    terms[0] += drawn
                    terms[1] += drawn - volt * amp
                    terms[2] += amp * amp * MOTOR.resistance_ohm
                    terms[3] += volt * amp - amp * amp * MOTOR.resistance_ohm
                rates.append(terms)
            mean = [0.5 * (a + b) for a, b in zip(*rates, strict=True)]
            battery += 0.001 * (mean[0] + 1.5)
            internal += 0.001 * (mean[0] + 1.5) / supply_v * (_open_v(body) - supply_v)
            electronics += 0.0015
            bridge, winding = bridge + 0.001 * mean[1], winding + 0.001 * mean[2]
            shaft += 0.001 * mean[3]
    energy = body.energy
    assert energy.battery_j == pytest.approx(battery, rel=2e-3)
    assert energy.internal_j == pytest.approx(internal, rel=2e-2)
    assert energy.electronics_j == pytest.approx(electronics, rel=1e-9)
    assert energy.bridge_j == pytest.approx(bridge, rel=5e-3)
    assert energy.winding_j == pytest.approx(winding, rel=5e-3)
    assert energy.shaft_j == pytest.approx(shaft, rel=5e-3)
    spent = energy.electronics_j + energy.bridge_j + energy.winding_j + energy.shaft_j
    assert energy.battery_j == pytest.approx(spent, rel=1e-12)
    assert body.truth.energy_wh * 3600.0 == energy.battery_j


def _same_volt(before: list[tuple[float, float]], body: Plant) -> list[tuple[float, float]]:
    """Return the currents at the end of a tick for the voltages at its start."""
    speeds = (body.truth.left_rad_s, body.truth.right_rad_s)
    return [
        (volt, (volt - MOTOR.back_emf_v_s * speed) / MOTOR.resistance_ohm)
        for (volt, _), speed in zip(before, speeds, strict=True)
    ]


def _open_v(body: Plant) -> float:
    return 16.0 * (0.85 + 0.15 * body.state_of_charge)


def test_the_motors_work_is_friction_and_the_motion_that_is_left() -> None:
    body = plant(CENTRE)
    body.set_duty(0.6, 0.8)
    body.advance_ms(700)
    truth, torque = body.truth, MOTOR.friction_v * MOTOR.back_emf_v_s / MOTOR.resistance_ohm
    inertia = MOTOR.time_constant_s * MOTOR.back_emf_v_s**2 / MOTOR.resistance_ohm
    work = torque * (truth.left_rad + truth.right_rad)
    work += 0.5 * inertia * (truth.left_rad_s**2 + truth.right_rad_s**2)
    assert body.energy.shaft_j == pytest.approx(work, rel=1e-9)


def test_a_stalled_motor_draws_its_stall_current_and_only_heats() -> None:
    body = plant(CENTRE)
    body.faults.stuck_left = body.faults.stuck_right = True
    body.set_duty(0.75, -0.75)
    body.advance_ms(2000)
    stall_a = (0.75 * 16.0 - DROP_V) / MOTOR.resistance_ohm
    assert body.motor_currents_a == pytest.approx((stall_a, -stall_a))
    energy = body.energy
    assert energy.shaft_j == 0.0
    assert energy.winding_j == pytest.approx(2.0 * 2.0 * stall_a**2 * MOTOR.resistance_ohm)
    assert energy.bridge_j == pytest.approx(2.0 * 2.0 * stall_a * DROP_V)
    assert energy.battery_j == pytest.approx(2.0 * (1.5 + 2.0 * 0.75 * 16.0 * stall_a))


def test_the_battery_sags_by_its_resistance_and_falls_in_a_line() -> None:
    body = plant(CENTRE, battery=BatteryParameters(state_of_charge=0.5, resistance_ohm=0.4))
    body.faults.stuck_left = body.faults.stuck_right = True
    body.set_duty(0.5, 0.5)
    body.advance_ms(2000)
    open_v = 16.0 * (0.85 + 0.15 * body.state_of_charge)
    motor_a = (0.5 * body.supply_v - DROP_V) / MOTOR.resistance_ohm
    current_a = 2.0 * 0.5 * motor_a + 1.5 / body.supply_v
    assert body.supply_v == pytest.approx(open_v - 0.4 * current_a, abs=1e-3)


def test_charge_and_internal_loss_close_the_batterys_balance() -> None:
    """At a constant open-circuit voltage, charge times voltage is the energy from the cells."""
    parameters = BatteryParameters(empty_ratio=1.0, capacity_ah=0.05)
    body = plant(CENTRE, battery=parameters)
    body.set_duty(0.9, -0.9)
    body.advance_ms(30_000)
    used_c = (1.0 - body.state_of_charge) * 0.05 * 3600.0
    energy = body.energy
    assert energy.battery_j + energy.internal_j == pytest.approx(16.0 * used_c, rel=1e-9)


def test_below_the_knee_the_voltage_falls_to_that_of_an_empty_pack() -> None:
    body = plant(CENTRE, battery=BatteryParameters())
    at = {}
    for charge in (0.06, 0.05, 0.01, 0.001):
        body.set_charge(charge)
        body.advance_ms(50)
        at[charge] = body.supply_v
    assert at[0.06] - at[0.05] < 0.1
    assert at[0.05] == pytest.approx(13.7, abs=0.1)
    assert 8.0 < at[0.001] < at[0.01] < 10.5
    assert body.rail_5v_v == 5.0
    body.set_duty(1.0, 1.0)
    body.set_charge(0.0)
    assert body.supply_v == body.rail_5v_v == 0.0
    assert body.motor_voltages_v == (0.0, 0.0)
    spent = body.energy.battery_j
    body.advance_ms(1000)
    assert body.energy.battery_j == spent
    assert body.truth.v_m_s == 0.0
    body.set_charge(0.8)
    body.advance_ms(500)
    assert body.rail_5v_v == 5.0
    assert body.truth.v_m_s > 0.2


def test_a_nearly_empty_battery_browns_the_rail_out_under_load() -> None:
    """Two stalled motors and a high internal resistance pull the rail down; then it recovers."""
    parameters = BatteryParameters(resistance_ohm=0.6)
    body = plant(CENTRE, battery=parameters)
    body.set_charge(0.002)
    body.advance_ms(100)
    assert body.rail_5v_v == 5.0
    body.faults.stuck_left = body.faults.stuck_right = True
    body.set_duty(1.0, 1.0)
    lowest = min(_after(body, 1) for _ in range(100))
    assert lowest < 4.3
    body.set_duty(0.0, 0.0)
    body.advance_ms(50)
    assert body.rail_5v_v == 5.0


def _after(body: Plant, ms: int) -> float:
    body.advance_ms(ms)
    return body.rail_5v_v


def test_a_battery_driven_empty_ends_the_drive_and_stays_dead() -> None:
    body = plant(
        room((0.5, 0.5, 0.0), walls=box(0.0, 0.0, 1.0, 1.0)),
        battery=BatteryParameters(capacity_ah=0.002),
    )
    body.set_duty(duty(0.2), -duty(0.2))
    body.advance_ms(120_000)
    assert body.state_of_charge == 0.0
    assert body.supply_v == 0.0
    before = body.truth
    body.advance_ms(5000)
    assert body.truth.pose == before.pose
    assert body.truth.energy_wh == before.energy_wh
    full_j = 16.0 * 0.002 * 3600.0
    assert 0.8 * full_j < body.energy.battery_j < full_j


def test_the_caster_drags_as_much_as_configured() -> None:
    """Straight ahead, each motor carries half of the caster's drag: a torque of F·r/2."""
    dragged = Chassis(caster_drag_n=2.0, mass_kg=0.0)
    free, held = plant(CENTRE, battery=IDEAL_BATTERY), plant(CENTRE, chassis=dragged)
    for body in (free, held):
        body.set_duty(0.7, 0.7)
        body.advance_ms(3000)
    lost_v = 1.0 * 0.0325 * MOTOR.resistance_ohm / MOTOR.back_emf_v_s
    slower = lost_v / MOTOR.back_emf_v_s
    assert free.truth.left_rad_s - held.truth.left_rad_s == pytest.approx(slower, rel=1e-6)
    assert math.isclose(held.truth.pose.y_m, 10.0)
