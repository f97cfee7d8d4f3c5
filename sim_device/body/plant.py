"""The sweeper's mechanics: wheels, pose, contact and energy, integrated at 1 kHz.

The plant contains the true state, not the host's estimates. Wheel speeds follow the motors'
first-order lag exactly. The pose is integrated with the midpoint heading of each millisecond. Walls
stop the disc (the robot's footprint). The compiled ``drive_kernel`` computes each millisecond from
the previous one, and updates slow quantities every ten milliseconds. So the result is bit-equal for
any split of the time into calls of ``advance_ms``.

Contact is quasi-static. A wall removes the motion component towards the wall; the disc slides along
the wall with friction, or stops. The wheels then slip. Each wheel pushes with at most
``traction_n``. This push loads the motor, and the load is greatest with the wall straight ahead. A
duty too low for the load stalls the wheel. With a higher duty the wheel spins, and the encoders
count its turns. The force of the wall acts through the centre of the disc, which is the centre of
the axle, so it causes no rotation. Friction at the rim would turn the robot; the model omits it.

Traction also limits acceleration and deceleration; a wheel that would need more traction spins. A
spinning wheel has the same lag as a wheel that moves the robot. The caster's drag acts against the
caster's motion over the floor. Door thresholds are modelled as hills of a few millimetres; the
robot gains potential energy uphill and loses it downhill. If a threshold is too steep for the
tyres, the wheels spin. When a wheel passes the edge of a cliff of the room, the robot falls on its
underside. The wheels then turn freely and the robot does not move, until ``replace_world`` gives it
floor again.
"""

from __future__ import annotations

from math import atan2, hypot, isfinite
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device.body.battery import RAIL_V, RAIL_WHOLE_V, rail_5v_v
from sim_device.body.chassis import Chassis, PlantFaults, fill_parameters, set_lag
from sim_device.body.drive_kernel import SLOW_MS, TICK_S, Body, advance, felt, renew
from sim_device.body.errors import DutyError, WalkerError
from sim_device.body.footing import Footing
from sim_device.body.motors import MotorParameters
from sim_device.body.supply import Supply
from sim_device.body.truth import Inertial, Truth
from sim_device.noise import Draws
from sim_device.world.placing import pushed_free

if TYPE_CHECKING:
    import numpy as np

    from bridge.motion.robot_model import RobotModel
    from sim_device.body.battery import BatteryParameters
    from sim_device.body.truth import EnergyBalance
    from sim_device.noise import NoiseLevel
    from sim_device.world.world import World

__all__ = ["Chassis", "DutyError", "Inertial", "Plant", "PlantFaults", "Truth", "WalkerError"]

_JOULES_PER_WH = 3600.0
_WALKER_GAP_MS = 250
_WALKER_M_S = 3.0
"""Maximum speed of a walker between two places that are set, m/s. If a higher speed is needed, the
walker jumps to the new place.
"""
_PLACES = 50
"""Number of places to try on the line from an occupied place to the robot's present place."""
_CHASSIS, _MOTOR = Chassis(), MotorParameters()
_new = tuple.__new__


class Plant:
    """The virtual sweeper's mechanics in its room.

    The plant only spawns child generators from ``rng``, so the sensors may share this generator.
    """

    def __init__(  # noqa: PLR0913 - the parts of a robot, each with a default
        self,
        world: World,
        model: RobotModel,
        noise: NoiseLevel,
        rng: np.random.Generator,
        *,
        motor: MotorParameters = _MOTOR,
        battery: BatteryParameters | None = None,
        chassis: Chassis = _CHASSIS,
    ) -> None:
        """Start at rest at the room's start pose; the default battery is the model's battery."""
        part_rng, slip_rng = rng.spawn(2)
        self.faults = PlantFaults()
        self.tick_ms = 0
        self._motor, self._chassis, self._model = motor, chassis, model
        self._b = b = Body()
        fill_parameters(b, motor, chassis, model)
        self._footing = Footing(model, chassis, noise, Draws(part_rng), Draws(slip_rng), b)
        self._supply = Supply(battery, model, b)
        self._applied = (False, False, 0.0, 0.0, False)
        """Faults that the kernels presently apply."""
        self._walker_ms = 0
        self._unfelt_rad = 0.0
        """Sum of the heading changes by :meth:`place`, rad. The inertial sensor does not measure
        these changes."""
        b.x_m, b.y_m, b.theta_rad = world.plan.start
        self.felt = felt(b)
        """Result of ``drive_kernel.felt`` at this tick, cached because it is read often."""
        set_lag(b, motor, chassis, model, lifted=False)
        self._world = world
        self._take_world(world)
        self._feel_walls()

    # Inputs of the drive.

    def set_duty(self, left: float, right: float) -> None:
        """Set the duty of both bridges, limited to -1..1 and valid until the next call.

        Raises:
            DutyError: a duty is not finite.

        """
        if not (-1.0 <= left <= 1.0 and -1.0 <= right <= 1.0):
            if not (isfinite(left) and isfinite(right)):
                raise DutyError(left, right)
            left = min(1.0, max(-1.0, left))
            right = min(1.0, max(-1.0, right))
        supply = self._supply
        supply.left, supply.right = left, right

    def advance_ms(self, n: int) -> None:
        """Advance by ``n`` milliseconds."""
        if self.faults.changed:
            self._obey_faults()
        b, supply, footing = self._b, self._supply, self._footing
        left, right = supply.left, supply.right
        while n > 0:
            ticks = SLOW_MS - self.tick_ms % SLOW_MS
            if n < ticks:  # noqa: PLR1730 - each period: no call
                ticks = n
            if self._uneven and not b.lifted:
                ticks = min(ticks, footing.on_thresholds(self._world.thresholds))
            advance(ticks, left, right, b)
            self.tick_ms += ticks
            n -= ticks
            if self.tick_ms % SLOW_MS:
                self.felt = felt(b)
                continue
            if not footing.periods_left:
                footing.draw()
            footing.periods_left -= 1
            self.felt = renew(b)
            if self._varied and not self.faults.lifted:
                self._look_at_floor()

    # Events from outside.

    def set_charge(self, fraction: float) -> None:
        """Set the battery's charge, 0..1; at 0 it has no voltage."""
        self._supply.set_charge(fraction)
        self._changed()

    def replace_world(self, world: World) -> None:
        """Replace the walls and obstacles around the robot; a walker stays.

        If an obstacle overlaps the robot, the robot is moved on the shortest path to a free place.
        If no free place within one robot diameter can be reached, the robot is held until the next
        call: it stays in contact and does not move, and its wheels slip or stall. Neither case
        counts as a collision, because a new obstacle has no speed.
        """
        b = self._b
        x_m, y_m = b.x_m, b.y_m
        place = pushed_free(self._world, world, x_m, y_m)
        if b.walker_radius_m > 0.0:
            world = world.with_walker(*self._world.walker.tolist())
        self._take_world(world)
        self._footing.off_floor()
        b.held = place is None
        if place is None:
            wall = world.nearest(x_m, y_m)
            side = 1.0 if world.is_floor(x_m, y_m) else -1.0
            b.touch(side * wall.normal_x, side * wall.normal_y)
        else:
            b.x_m, b.y_m = place
            self._feel_walls()
        self._changed()

    def place(self, pose: Pose2) -> Pose2:
        """Move the robot to another pose at once; the inertial sensor does not measure this.

        If the place is not free, the robot is put at the nearest free place on the straight line to
        its previous place. Return the resulting pose.
        """
        b, world = self._b, self._world
        x_m, y_m, theta_rad = b.x_m, b.y_m, b.theta_rad
        for k in range(_PLACES + 1):
            share = 1.0 - k / _PLACES
            x, y = x_m + share * (pose.x_m - x_m), y_m + share * (pose.y_m - y_m)
            if world.is_floor(x, y) and world.clearance_m(x, y) >= 0.0:
                b.x_m, b.y_m = x, y
                break
        turn_rad = wrap_angle(pose.theta_rad - theta_rad)
        b.theta_rad = theta_rad + turn_rad
        self._unfelt_rad += turn_rad
        b.touches, b.disturbed = 0, True
        self._feel_walls()
        return self.pose

    def set_walker(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Put a round obstacle (a person's leg) at (x, y), or let it walk there.

        A second call within 250 ms makes the walker walk to the new place. The walk lasts as long
        as the time since the last call. After more than 250 ms, the walker appears at the new place
        at once. The walker pushes the robot until a wall holds the robot; then the walker yields,
        because a leg is soft and a wall is not. Range sensors measure the walker at its destination
        (``world.walker``).

        Raises:
            WalkerError: a number is not finite, or the radius is not positive.

        """
        if not (isfinite(x_m) and isfinite(y_m) and isfinite(radius_m) and radius_m > 0.0):
            raise WalkerError(x_m, y_m, radius_m)
        b = self._b
        steps = self.tick_ms - self._walker_ms
        self._walker_ms = self.tick_ms
        self._world = self._world.with_walker(x_m, y_m, radius_m)
        speed_x = speed_y = 0.0
        if b.walker_radius_m > 0.0 and 0 < steps <= _WALKER_GAP_MS:
            speed_x = (x_m - b.walker_x_m) / (steps * TICK_S)
            speed_y = (y_m - b.walker_y_m) / (steps * TICK_S)
        if not 0.0 < hypot(speed_x, speed_y) <= _WALKER_M_S:
            b.walker_x_m, b.walker_y_m = x_m, y_m
            speed_x = speed_y = 0.0
            steps = 0
        b.walker_radius_m, b.walker_ms = radius_m, steps
        b.walker_vx_m_s, b.walker_vy_m_s = speed_x, speed_y
        b.disturbed = True
        self._changed()

    def clear_walker(self) -> None:
        """Remove the walker from the room."""
        self._world = self._world.with_walker(0.0, 0.0, 0.0)
        b = self._b
        b.walker_radius_m = b.walker_vx_m_s = b.walker_vy_m_s = b.walker_ms = 0.0
        b.disturbed = True
        self._changed()

    # The true state.

    @property
    def pose(self) -> Pose2:
        """True pose; the heading is wrapped to [-π, π)."""
        x_m, y_m, theta_rad, _, _, _, _, _ = self.felt
        return Pose2(x_m, y_m, wrap_angle(theta_rad))

    @property
    def world(self) -> World:
        """The room, including the walker."""
        return self._world

    @property
    def wheel_angles_rad(self) -> tuple[float, float]:
        """Angles of the left and the right wheel, rad, continuous."""
        return self.felt[3:5]

    @property
    def inertial(self) -> Inertial:
        """Inputs of the inertial sensor, as sums since power-on."""
        _, _, theta, left, right, ahead, aside, _ = self.felt
        footing = self._footing
        return _new(
            Inertial,
            (
                self.tick_ms,
                theta - self._unfelt_rad,
                ahead,
                aside,
                left,
                right,
                footing.pitch_rad,
                footing.roll_rad,
                footing.climb_m_s,
            ),
        )

    @property
    def motor_currents_a(self) -> tuple[float, float]:
        """Currents of the left and the right motor at this tick, A."""
        (left_v, right_v), current_a, b = self._supply.bridges_v, self._motor.current_a, self._b
        return current_a(left_v, b.left.rad_s), current_a(right_v, b.right.rad_s)

    @property
    def motor_voltages_v(self) -> tuple[float, float]:
        """Voltages of the left and the right motor after the bridge, V."""
        return self._supply.bridges_v

    @property
    def left_radius_m(self) -> float:
        """Radius of the left wheel, m, with its tolerance."""
        return self._footing.left_radius_m

    @property
    def right_radius_m(self) -> float:
        """Radius of the right wheel, m, with its tolerance."""
        return self._footing.right_radius_m

    @property
    def wheel_base_m(self) -> float:
        """Wheel base of this robot, m."""
        return self._footing.wheel_base_m

    @property
    def supply_v(self) -> float:
        """Voltage of the battery under load, V."""
        return self.felt[7]

    @property
    def rail_5v_v(self) -> float:
        """Voltage of the logic rail, V; it falls if the battery voltage is below 6.5 V."""
        supply_v = self.felt[7]
        return RAIL_V if supply_v >= RAIL_WHOLE_V else rail_5v_v(supply_v)

    @property
    def state_of_charge(self) -> float:
        """State of charge of the battery, 0..1."""
        return self._supply.state_of_charge

    @property
    def held(self) -> bool:
        """Whether a new obstacle holds the robot; see ``replace_world``."""
        return self._b.held

    @property
    def touch_bearings_rad(self) -> tuple[float, ...]:
        """Bearings of the contacts; see ``Truth.touch_bearings_rad``."""
        if not self._b.touches:
            return ()
        theta = self.felt[2]
        return tuple(wrap_angle(atan2(-ny, -nx) - theta) for nx, ny in self._b.normals())

    @property
    def energy(self) -> EnergyBalance:
        """Energy balance of the battery."""
        return self._supply.energy()

    @property
    def truth(self) -> Truth:
        """Complete true state at this tick."""
        b, left, right = self._b, self._b.left, self._b.right
        x_m, y_m, theta_rad, left_rad, right_rad, ahead_m_s, aside_m_s, _ = self.felt
        v = left.travel_m_rad * left.grip_rad_s + right.travel_m_rad * right.grip_rad_s
        lateral = 0.0
        if b.touches:
            v, lateral = b.slide_v_m_s, b.slide_aside_m_s
        return Truth(
            tick_ms=self.tick_ms,
            pose=Pose2(x_m, y_m, wrap_angle(theta_rad)),
            heading_rad=theta_rad,
            v_m_s=v,
            v_lateral_m_s=lateral,
            yaw_rate_rad_s=right.yaw_rad_rad * right.grip_rad_s
            - left.yaw_rad_rad * left.grip_rad_s,
            left_rad=left_rad,
            right_rad=right_rad,
            left_rad_s=left.rad_s,
            right_rad_s=right.rad_s,
            impulse_x_m_s=ahead_m_s,
            impulse_y_m_s=aside_m_s,
            path_m=b.path_m,
            collisions=b.collisions,
            contact_s=b.contact_ms * TICK_S,
            touch_bearings_rad=self.touch_bearings_rad,
            energy_wh=self.energy.battery_j / _JOULES_PER_WH,
        )

    # The state, and the inputs of the kernels.

    def _changed(self) -> None:
        """Discard cached values."""
        self.felt = felt(self._b)

    def _take_world(self, world: World) -> None:
        self._world = world
        self._b.take_edges(world.edges)
        self._uneven = len(world.thresholds) > 0
        self._varied = len(world.carpets) > 0 or bool(world.plan.cliffs) or self._footing.fallen

    def _feel_walls(self) -> None:
        """Update the contacts without a time step."""
        supply = self._supply
        advance(0, supply.left, supply.right, self._b)
        self._changed()

    def _look_at_floor(self) -> None:
        x_m, y_m, theta_rad = self.felt[:3]
        if self._footing.look(self._world, Pose2(x_m, y_m, theta_rad)):
            self._apply((*self._applied[:4], self._footing.fallen))
        self._changed()

    def _obey_faults(self) -> None:
        f = self.faults
        f.changed = False
        self._b.wanders = not f.lifted
        up = f.lifted or self._footing.fallen
        faults = (f.stuck_left, f.stuck_right, f.slip_left, f.slip_right, up)
        if faults != self._applied:
            self._apply(faults)

    def _apply(self, faults: tuple[bool, bool, float, float, bool]) -> None:
        stuck_left, stuck_right, slip_left, slip_right, lifted = faults
        b = self._b
        if lifted != self._applied[-1]:
            set_lag(b, self._motor, self._chassis, self._model, lifted=lifted)
            self._footing.off_floor()
            b.touches, b.disturbed = 0, True
        self._applied = faults
        b.left.stuck, b.right.stuck, b.lifted = stuck_left, stuck_right, lifted
        self._footing.set_extra_slip(slip_left, slip_right)
        self._changed()
