"""Applies faults to the adjustable parts of a virtual sweeper."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from protocol.messages.values import ResetCause
from sim_device.faults.person import PersonPath
from sim_device.sensors.faults import SensorFaultValues
from sim_device.world.world import World

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.floor_plan.floor_plan import FloorPlan
    from sim_device.faults.knobs import Carry, Knobs, Walker
    from sim_device.faults.spec import Value
    from sim_device.rigged import RiggedDevice

_PLANT = ("stuck_left", "stuck_right", "slip_left", "slip_right", "lifted")
_SENSORS = tuple(field.name for field in fields(SensorFaultValues))


class UnknownObstacleError(ValueError):
    """A fault refers to an obstacle that the room does not have."""

    def __init__(self, index: int, count: int) -> None:
        """Store both numbers."""
        self.index, self.count = index, count
        has = f"0 to {count - 1}" if count > 1 else "only 0" if count else "none"
        super().__init__(f"the room has no obstacle {index}; it has {has}")


class FaultTarget:
    """Applies faults to one device."""

    def __init__(self, device: RiggedDevice) -> None:
        """Start without any fault."""
        self._device = device
        self._world = device.plant.world
        self._drift_ppm = 0.0
        self._moved: dict[int, tuple[float, float]] = {}
        self._carry: Carry | None = None
        self._walker: Walker | None = None
        self._path: PersonPath | None = None

    # ---- lasting faults -------------------------------------------------------------------

    def turn(self, knobs: Knobs, now_us: int) -> None:
        """Apply the values of all knobs to the device."""
        device = self._device
        if knobs.carry != self._carry:
            if self._carry is not None:
                self._place(self._carry.dx_m, self._carry.dy_m, self._carry.turn_deg)
            self._carry = knobs.carry
        for name in _PLANT:
            setattr(device.plant.faults, name, getattr(knobs, name))
        for name in _SENSORS:
            setattr(device.sensors.faults, name, getattr(knobs, name))
        if knobs.drift_ppm != self._drift_ppm:
            device.clock.drift_ppm += knobs.drift_ppm - self._drift_ppm
            self._drift_ppm = knobs.drift_ppm
        if knobs.moved != self._moved:
            device.plant.replace_world(self._rebuilt(knobs.moved))
            self._moved = dict(knobs.moved)
        if knobs.walker != self._walker:
            self._walker = knobs.walker
            if knobs.walker is None:
                self._path = None
                device.plant.clear_walker()
            else:
                self._path = PersonPath(knobs.walker, device, now_us)
                self._path.step(now_us)

    def check(self, values: Mapping[str, Value]) -> None:
        """Check the arguments of a fault before its start.

        Raises:
            UnknownObstacleError: the room has no obstacle with this index.

        """
        check_obstacle(self._world.plan, values)

    def _rebuilt(self, moved: Mapping[int, tuple[float, float]]) -> World:
        if not moved:
            return self._world
        plan = moved_plan(self._world.plan, moved)
        model = RobotModel(robot_diameter_m=2.0 * self._world.radius_m)
        return World(plan, model, check_start=False)

    # ---- a person -------------------------------------------------------------------------

    def next_us(self) -> int | None:
        """Return the time of the person's next simulation step, µs, or None."""
        return None if self._path is None else self._path.next_us

    def walk(self, now_us: int) -> None:
        """Move the person up to ``now_us``."""
        if self._path is not None:
            self._path.step(now_us)

    # ---- momentary faults -----------------------------------------------------------------

    def strike(self, what: str, values: Mapping[str, Value]) -> None:
        """Apply a momentary fault; ``what`` is the attribute ``strike`` of its kind."""
        {
            "reset": self._reset,
            "hang": self._hang,
            "crash": self._crash,
            "hse_failed": self._hse_failed,
            "brown_out": self._brown_out,
            "clock_jump": self._clock_jump,
            "battery_flat": self._battery_flat,
            "displaced": self._displaced,
        }[what](values)

    def _reset(self, values: Mapping[str, Value]) -> None:
        self._device.reset(ResetCause[str(values["cause"]).upper()])

    def _hang(self, values: Mapping[str, Value]) -> None:
        del values
        self._device.hang()

    def _crash(self, values: Mapping[str, Value]) -> None:
        del values
        self._device.crash()

    def _hse_failed(self, values: Mapping[str, Value]) -> None:
        self._device.fail_crystal(float(values["ppm"]))

    def _brown_out(self, values: Mapping[str, Value]) -> None:
        self._device.reset(ResetCause.BROWN_OUT, off_s=float(values["off"]))

    def _clock_jump(self, values: Mapping[str, Value]) -> None:
        self._device.clock.jump_us(round(1000.0 * float(values["ms"])))

    def _displaced(self, values: Mapping[str, Value]) -> None:
        self._place(float(values["dx"]), float(values["dy"]), float(values["turn"]))

    def _place(self, dx_m: float, dy_m: float, turn_deg: float) -> None:
        plant = self._device.plant
        x_m, y_m, theta_rad = plant.pose
        plant.place(Pose2(x_m + dx_m, y_m + dy_m, theta_rad + math.radians(turn_deg)))

    def _battery_flat(self, values: Mapping[str, Value]) -> None:
        self._device.plant.set_charge(float(values["charge"]))


def check_obstacle(plan: FloorPlan, values: Mapping[str, Value]) -> None:
    """Check that the room has the obstacle with the index in a fault's arguments.

    Raises:
        UnknownObstacleError: the room has no obstacle with this index.

    """
    count = len(plan.obstacles)
    if "index" in values and float(values["index"]) >= count:
        raise UnknownObstacleError(round(float(values["index"])), count)


def moved_plan(plan: FloorPlan, moved: Mapping[int, tuple[float, float]]) -> FloorPlan:
    """Return the room with some obstacles moved by (dx, dy) metres."""
    obstacles = tuple(
        tuple((x + moved[i][0], y + moved[i][1]) for x, y in obstacle) if i in moved else obstacle
        for i, obstacle in enumerate(plan.obstacles)
    )
    return replace(plan, obstacles=obstacles)
