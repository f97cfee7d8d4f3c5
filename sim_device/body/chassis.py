"""Mechanical constants of the virtual sweeper, and the faults of its drive."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp
from typing import TYPE_CHECKING

from sim_device.body.drive_kernel import TICK_S
from sim_device.change_flag import ChangeFlag

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.body.drive_kernel import Body
    from sim_device.body.motors import MotorParameters

_MASSLESS = 1e12


@dataclass(frozen=True, slots=True)
class Chassis:
    """Forces between the robot, the floor and the walls, and the load of the electronics."""

    traction_n: float = 7.0
    """Maximum traction of one wheel, N: from 3 kg, 80 % of the weight on the wheels, and a friction
    coefficient of 0.6."""
    wall_friction: float = 0.2
    """Friction coefficient of the plastic bumper on a painted wall."""
    electronics_w: float = 1.5
    """Power of controller, sensors and idle bridges, W, drawn from the battery."""
    mass_kg: float = 3.0
    """Mass of the robot, kg. With 0, wheels do not spin on free floor, and thresholds need no
    force."""
    wheel_share: float = 0.8
    """Share of the weight on the wheels, 0..1; the caster carries the rest."""
    caster_drag_n: float = 0.3
    """Rolling resistance of the caster, N: 5 % of its load."""
    caster_x_m: float = 0.115
    """Distance of the caster ahead of the axle, m; negative if the caster is behind the axle; never
    0."""
    caster_radius_m: float = 0.015


@dataclass(slots=True)
class PlantFaults(ChangeFlag):
    """Present faults of the drive; they may change between two calls of ``Plant.advance_ms``."""

    stuck_left: bool = False
    """True: the left gearbox is jammed. The wheel does not turn, and its motor draws the stall
    current."""
    stuck_right: bool = False
    slip_left: float = 0.0
    """Extra share of the left wheel's travel that is lost on the floor, 0..1."""
    slip_right: float = 0.0
    lifted: bool = False
    """True: the robot is in the air. The wheels turn freely, and the robot has no contacts."""
    changed: bool = field(default=True, init=False, repr=False, compare=False)
    """True if a fault was set since the plant last read this object."""


def fill_parameters(b: Body, motor: MotorParameters, chassis: Chassis, model: RobotModel) -> None:
    """Write the parameters of all parts into the kernel's ``Body``."""
    radius_m = 0.5 * model.wheel_diameter_m
    b.back_emf_v_s, b.resistance_ohm = motor.back_emf_v_s, motor.resistance_ohm
    b.friction_v, b.drop_v = motor.friction_v, model.driver_drop_v
    b.load_v_n = radius_m * motor.resistance_ohm / motor.back_emf_v_s
    b.radius_m, b.wall_friction = model.radius_m, chassis.wall_friction
    b.traction_n, b.electronics_w = chassis.traction_n, chassis.electronics_w
    mass = chassis.mass_kg
    b.rad_s_per_n = TICK_S / (0.5 * mass * radius_m) if mass > 0.0 else _MASSLESS
    b.caster_n, b.caster_x_m = chassis.caster_drag_n, chassis.caster_x_m


def set_lag(
    b: Body,
    motor: MotorParameters,
    chassis: Chassis,
    model: RobotModel,
    *,
    lifted: bool,
) -> None:
    """Write the time constants of the wheels' lag; lifted wheels have only their own inertia."""
    tau = motor.time_constant_s
    if lifted:
        radius_m = 0.5 * model.wheel_diameter_m
        body = 0.5 * chassis.mass_kg * radius_m**2
        tau -= body * motor.resistance_ohm / motor.back_emf_v_s**2
        tau = max(tau, 0.1 * motor.time_constant_s)
    b.tau_s, b.decay = tau, 1.0 - exp(-TICK_S / tau)
