"""The sweeper's body: wheels, pose, contact and energy, integrated at 1 kHz.

Truth, and nothing of the host's: wheel speeds follow the motors' lag exactly, the pose takes
each millisecond's midpoint heading, walls stop the disc. Equal calls give equal truth, to the
bit, however ``advance_ms`` is split: the compiled ``drive_kernel`` takes each millisecond from
the one before, and what is slow is renewed every tenth.

Contact is quasi-static. A wall ahead takes the part of the motion that goes into it; the disc
slides along with friction, or stays. The wheels meanwhile slip: they push with at most
``traction_n`` each, which the motor feels as a load in the measure in which the wall is
straight ahead. A duty too low for that load stalls the wheel, a higher one spins it on the
spot, and the encoders count what the wheels turn. The wall's force goes through the disc's
centre, which is the axle's, so it turns nothing; friction at the rim would, and is left out.

Traction also limits how fast the robot can gain or lose speed; a wheel that asks for more
spins. Its own lag stays that of a wheel which moves the robot. The caster drags against its
own way over the floor. Thresholds are hills of a few millimetres, which take and give back
the weight's energy; one too steep for the tyres lets the wheels spin before it. Where a wheel
comes over a room's ``cliffs`` the robot lies on its belly at the edge until there is floor
again (``replace_world``): its wheels turn freely and it moves no more, as if held up.
"""

from __future__ import annotations

from math import atan2, hypot, isfinite
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device.body.chassis import Chassis, PlantFaults, fill_parameters, set_lag
from sim_device.body.drive_kernel import SLOW_MS, TICK_S, Body, advance, felt, renew
from sim_device.body.errors import DutyError, WalkerError
from sim_device.body.footing import Footing
from sim_device.body.motors import MotorParameters
from sim_device.body.power import RAIL_V, RAIL_WHOLE_V, rail_5v_v
from sim_device.body.supply import Supply
from sim_device.body.truth import Inertial, Truth
from sim_device.noise import Draws
from sim_device.world.placing import pushed_free

if TYPE_CHECKING:
    import numpy as np

    from bridge.motion.robot_model import RobotModel
    from sim_device.body.power import BatteryParameters
    from sim_device.body.truth import EnergyBalance
    from sim_device.noise import NoiseLevel
    from sim_device.world.world import World

__all__ = ["Chassis", "DutyError", "Inertial", "Plant", "PlantFaults", "Truth", "WalkerError"]

_JOULES_PER_WH = 3600.0
_WALKER_GAP_MS = 250
_WALKER_M_S = 3.0
"""Maximum speed of a walker that is set again, m/s; a faster one appears at its place."""
_CHASSIS, _MOTOR = Chassis(), MotorParameters()
_new = tuple.__new__


class Plant:
    """The virtual sweeper's body in its room.

    ``rng`` only gives birth to children here, so that it may be shared with the sensors.
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
        """Put the robot at rest at the room's start; the battery defaults to the model's."""
        part_rng, slip_rng = rng.spawn(2)
        self.faults = PlantFaults()
        self.tick_ms = 0
        self._motor, self._chassis, self._model = motor, chassis, model
        self._b = b = Body()
        fill_parameters(b, motor, chassis, model)
        self._footing = Footing(model, chassis, noise, Draws(part_rng), Draws(slip_rng), b)
        self._supply = Supply(battery, model, b)
        self._applied = (False, False, 0.0, 0.0, False)
        """The faults as the kernels know them."""
        self._walker_ms = 0
        b.x_m, b.y_m, b.theta_rad = world.plan.start
        self.felt = felt(b)
        """What ``drive_kernel.felt`` gives, at this tick; as quick to read as can be."""
        set_lag(b, motor, chassis, model, lifted=False)
        self._world = world
        self._take_world(world)
        self._feel_walls()

    # What drives it.

    def set_duty(self, left: float, right: float) -> None:
        """Set both bridges' duty; limited to -1..1, held until set again.

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
        """Let ``n`` milliseconds pass."""
        if self.faults.touched:
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

    # What may happen to it.

    def set_charge(self, fraction: float) -> None:
        """Set the battery's charge, 0..1; at 0 it has no voltage."""
        self._supply.set_charge(fraction)
        self._changed()

    def replace_world(self, world: World) -> None:
        """Put other walls and obstacles around the robot; a walker stays.

        What overlaps the robot then pushes it out on the shortest way. Where there is no free
        place within its diameter that it could be pushed to, it is held: its wheels slip or
        stall, it is in contact and does not move, until the world is replaced again. Neither
        counts as a collision: what appears has no speed.
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

    def set_walker(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Let a round obstacle (a person's leg) stand at (x, y), or walk there.

        Set again within 250 ms he walks to the new place, for as long as it was since he was
        last set; else he is there at once. He pushes the robot before him until a wall
        holds it: then he gives way (a leg is soft, a wall is not). Range sensors see him
        where he is heading (``world.walker``).

        Raises:
            WalkerError: a number is not finite, or the radius not above 0.

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
        """Let nobody walk in the room."""
        self._world = self._world.with_walker(0.0, 0.0, 0.0)
        b = self._b
        b.walker_radius_m = b.walker_vx_m_s = b.walker_vy_m_s = b.walker_ms = 0.0
        b.disturbed = True
        self._changed()

    # What is so.

    @property
    def pose(self) -> Pose2:
        """True pose, heading wrapped."""
        x_m, y_m, theta_rad, _, _, _, _, _ = self.felt
        return Pose2(x_m, y_m, wrap_angle(theta_rad))

    @property
    def world(self) -> World:
        """The room it stands in, with its walker."""
        return self._world

    @property
    def wheel_angles_rad(self) -> tuple[float, float]:
        """Left and right wheel angle, continuous."""
        return self.felt[3:5]

    @property
    def inertial(self) -> Inertial:
        """What the inertial sensor feels, as sums since power-on."""
        _, _, theta, left, right, ahead, aside, _ = self.felt
        footing = self._footing
        return _new(
            Inertial,
            (
                self.tick_ms,
                theta,
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
        """Left and right motor current at this tick."""
        (left_v, right_v), current_a, b = self._supply.bridges_v, self._motor.current_a, self._b
        return current_a(left_v, b.left.rad_s), current_a(right_v, b.right.rad_s)

    @property
    def motor_voltages_v(self) -> tuple[float, float]:
        """Left and right voltage behind the bridge."""
        return self._supply.bridges_v

    @property
    def left_radius_m(self) -> float:
        """The left wheel's, its tolerance included."""
        return self._footing.left_radius_m

    @property
    def right_radius_m(self) -> float:
        """The right wheel's."""
        return self._footing.right_radius_m

    @property
    def wheel_base_m(self) -> float:
        """Wheel base of this robot, m."""
        return self._footing.wheel_base_m

    @property
    def supply_v(self) -> float:
        """The battery's voltage, sagging under its load."""
        return self.felt[7]

    @property
    def rail_5v_v(self) -> float:
        """The logic rail; it falls with the battery where that is below 6.5 V."""
        supply_v = self.felt[7]
        return RAIL_V if supply_v >= RAIL_WHOLE_V else rail_5v_v(supply_v)

    @property
    def state_of_charge(self) -> float:
        """State of charge of the battery, 0..1."""
        return self._supply.state_of_charge

    @property
    def held(self) -> bool:
        """Whether what was put into the room holds it; see ``replace_world``."""
        return self._b.held

    @property
    def touch_bearings_rad(self) -> tuple[float, ...]:
        """See ``Truth.touch_bearings_rad``."""
        if not self._b.touches:
            return ()
        theta = self.felt[2]
        return tuple(wrap_angle(atan2(-ny, -nx) - theta) for nx, ny in self._b.normals())

    @property
    def energy(self) -> EnergyBalance:
        """Where the battery's energy went."""
        return self._supply.energy()

    @property
    def truth(self) -> Truth:
        """Everything at this tick."""
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

    # The state, and what the kernels are told.

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
        f.touched = False
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
