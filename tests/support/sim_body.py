"""The virtual sweeper's plant in rooms made for a test."""

from __future__ import annotations

import numpy as np

from bridge.floor_plan.floor_plan import FloorPlan, Polygon
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from sim_device.body.battery import BatteryParameters
from sim_device.body.chassis import Chassis
from sim_device.body.motors import MotorParameters
from sim_device.body.plant import Plant
from sim_device.noise import noise_level
from sim_device.sensors.sensors import SensorSuite
from sim_device.world.world import World

MOTOR = MotorParameters()
IDEAL_BATTERY = BatteryParameters(resistance_ohm=0.0, capacity_ah=1e9)
"""Battery with constant voltage, so that the motion has a closed form."""
IDEAL_CHASSIS = Chassis(caster_drag_n=0.0, mass_kg=0.0)
"""Chassis without drag and wheel spin: the robot moves as the wheels roll."""


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """Return a rectangle, counter-clockwise."""
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def room(
    start: tuple[float, float, float],
    *,
    walls: Polygon | None = None,
    obstacles: tuple[Polygon, ...] = (),
) -> FloorPlan:
    """Return a room, 20 m by 20 m by default."""
    return FloorPlan("test", walls or box(0.0, 0.0, 20.0, 20.0), obstacles, Pose2(*start))


def world(plan: FloorPlan) -> World:
    return World(plan, RobotModel())


def plant(
    plan: FloorPlan,
    *,
    level: str = "none",
    seed: int = 1,
    battery: BatteryParameters | None = IDEAL_BATTERY,
    chassis: Chassis = IDEAL_CHASSIS,
) -> Plant:
    return Plant(
        world(plan),
        RobotModel(),
        noise_level(level),
        np.random.default_rng(seed),
        battery=battery,
        chassis=chassis,
    )


def sensors(body: Plant, *, level: str = "none", seed: int = 2) -> SensorSuite:
    return SensorSuite(body, RobotModel(), noise_level(level), np.random.default_rng(seed))


def duty(v_m_s: float) -> float:
    """Return the duty of a noise-free wheel that rolls at this speed with a full ideal battery.

    This inverts ``steady_rad_s`` and ``terminal_v``.
    """
    model = RobotModel()
    if v_m_s == 0.0:
        return 0.0
    wheel_rad_s = v_m_s / (0.5 * model.wheel_diameter_m)
    needed_v = abs(wheel_rad_s) * MOTOR.back_emf_v_s + MOTOR.friction_v + model.driver_drop_v
    value = min(1.0, needed_v / model.battery_v)
    return value if wheel_rad_s > 0.0 else -value


def terminal_v(value: float, supply_v: float, drop_v: float) -> float:
    """Return the motor voltage for a duty in -1..1, after the bridge's drop (L298N 1.8-2 V)."""
    magnitude = abs(value) * supply_v - drop_v
    if magnitude <= 0.0:
        return 0.0
    return magnitude if value > 0.0 else -magnitude


def steady_rad_s(motor_v: float) -> float:
    """Return the steady wheel speed with friction as the only load; 0 in the dead band."""
    if motor_v > MOTOR.friction_v:
        return (motor_v - MOTOR.friction_v) / MOTOR.back_emf_v_s
    if motor_v < -MOTOR.friction_v:
        return (motor_v + MOTOR.friction_v) / MOTOR.back_emf_v_s
    return 0.0
