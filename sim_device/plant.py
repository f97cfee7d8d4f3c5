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

from math import atan2, exp, hypot, isfinite
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device import drive_kernel as k
from sim_device.chassis import Chassis, PlantFaults, fill_parameters
from sim_device.drive_kernel import TICK_S, advance
from sim_device.footing import Footing
from sim_device.motors import MotorParameters
from sim_device.noise import Draws
from sim_device.placing import pushed_free
from sim_device.plant_errors import DutyError, WalkerError
from sim_device.power import RAIL_V, RAIL_WHOLE_V, rail_5v_v
from sim_device.supply import Supply
from sim_device.truth import Inertial, Truth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel
    from sim_device.noise import NoiseLevel
    from sim_device.power import BatteryParameters
    from sim_device.truth import EnergyBalance
    from sim_device.world import World

__all__ = ["Chassis", "DutyError", "Inertial", "Plant", "PlantFaults", "Truth", "WalkerError"]

SLOW_MS = 10
"""Period of what changes slowly: battery voltage, slip, the carpet under a wheel."""
_JOULES_PER_WH = 3600.0
_WALKER_GAP_MS = 250
_WALKER_M_S = 3.0
"""A walker set again after longer, or farther off, is just there; else he walked there."""
_CHASSIS, _MOTOR = Chassis(), MotorParameters()
_X, _Y, _THETA, _ANGLE_L, _ANGLE_R = k.X, k.Y, k.THETA, k.ANGLE_L, k.ANGLE_R
_GRIP_L, _GRIP_R, _TOUCHES, _DRAWN_C = k.GRIP_L, k.GRIP_R, k.TOUCHES, k.DRAWN_C
_SWAY, _SLIDE_SWAY, _GRAVITY_X, _GRAVITY_Y = k.SWAY, k.SLIDE_SWAY, k.GRAVITY_X, k.GRAVITY_Y
_inertial = tuple.__new__


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
        self.tick_ms, self._world = 0, world
        self._motor, self._chassis = motor, chassis
        self._p = np.zeros(k.PARAMETERS)
        fill_parameters(self._p, motor, chassis, model)
        self._footing = Footing(model, chassis, noise, Draws(part_rng), Draws(slip_rng), self._p)
        self._supply = Supply(battery, model, motor, chassis.electronics_w, self._p)
        self._wheel_radius_m = 0.5 * model.wheel_diameter_m
        self._applied = (False, False, 0.0, 0.0, False)
        """The faults as the parameters hold them."""
        self._walker_ms = 0
        self._s = np.zeros(k.STATE)
        self._touch = np.zeros((2 * k.MAX_TOUCHES + 1, 3))
        self._s[[k.X, k.Y, k.THETA]] = world.plan.start
        self._s[[k.NEAR_X, k.ARMED, k.LAST_MS]] = np.inf, 1.0, -k.REARM_MS
        self._read: list[float] | None = None
        self._set_tau(lifted=False)
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
        self._supply.set_duty(left, right)

    def advance_ms(self, n: int) -> None:
        """Let ``n`` milliseconds pass."""
        f, s = self.faults, self._s
        footing, supply, world = self._footing, self._supply, self._world
        up = f.lifted or footing.fallen
        faults = (f.stuck_left, f.stuck_right, f.slip_left, f.slip_right, up)
        if faults != self._applied:
            self._apply(faults)
        thresholds = world.thresholds
        uneven = len(thresholds) > 0 and not f.lifted
        while n > 0:
            ticks = SLOW_MS - self.tick_ms % SLOW_MS
            if n < ticks:  # noqa: PLR1730 - each period: no call
                ticks = n
            if uneven and not footing.fallen:
                ticks = min(ticks, footing.on_thresholds(thresholds, s))
            if supply.stale:
                supply.renew()
            advance(ticks, s, self._p, world.edges, self._near, self._touch)
            self.tick_ms = tick_ms = self.tick_ms + ticks
            self._read = None
            n -= ticks
            if tick_ms % SLOW_MS == 0:
                self._read = now = s.tolist()
                supply.settle(tick_ms, now[_DRAWN_C])
                if not f.lifted and footing.renew(world, now[_X], now[_Y], now[_THETA]):
                    self._apply((*self._applied[:4], footing.fallen))

    # What may happen to it.

    def set_charge(self, fraction: float) -> None:
        """Make the battery that full, 0..1 (limited to it); at 0 its voltage is gone."""
        self._supply.set_charge(fraction, self.tick_ms, float(self._s[k.DRAWN_C]))

    def replace_world(self, world: World) -> None:
        """Put other walls and obstacles around the robot; a walker stays.

        What overlaps the robot then pushes it out on the shortest way. Where there is no free
        place within its diameter that it could be pushed to, it is held: its wheels slip or
        stall, it is in contact and does not move, until the world is replaced again. Neither
        counts as a collision: what appears has no speed.
        """
        now = self._now()
        place = pushed_free(self._world, world, now[k.X], now[k.Y])
        if now[k.MAN_R] > 0.0:
            world = world.with_walker(*self._world.walker.tolist())
        self._take_world(world)
        self._footing.off_floor()
        self._p[k.HELD] = place is None
        s = self._s
        if place is None:
            wall = world.nearest(now[k.X], now[k.Y])
            side = 1.0 if world.is_floor(now[k.X], now[k.Y]) else -1.0
            self._touch[0] = 0.0, side * wall.normal_x, side * wall.normal_y
            s[k.TOUCHES] = 1.0
        else:
            s[k.X], s[k.Y] = place
            self._feel_walls()
        self._read = None

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
        s = self._s
        steps = self.tick_ms - self._walker_ms
        self._walker_ms = self.tick_ms
        self._world = self._world.with_walker(x_m, y_m, radius_m)
        speed_x = speed_y = 0.0
        if s[k.MAN_R] > 0.0 and 0 < steps <= _WALKER_GAP_MS:
            speed_x = float(x_m - s[k.MAN_X]) / (steps * TICK_S)
            speed_y = float(y_m - s[k.MAN_Y]) / (steps * TICK_S)
        if not 0.0 < hypot(speed_x, speed_y) <= _WALKER_M_S:
            s[k.MAN_X], s[k.MAN_Y] = x_m, y_m
            speed_x = speed_y = 0.0
            steps = 0
        s[[k.MAN_R, k.MAN_VX, k.MAN_VY, k.MAN_MS]] = radius_m, speed_x, speed_y, steps
        s[k.DISTURBED] = 1.0
        self._read = None

    def clear_walker(self) -> None:
        """Let nobody walk in the room."""
        self._world = self._world.with_walker(0.0, 0.0, 0.0)
        self._s[[k.MAN_R, k.MAN_VX, k.MAN_VY, k.MAN_MS]] = 0.0
        self._s[k.DISTURBED] = 1.0
        self._read = None

    # What is so.

    @property
    def pose(self) -> Pose2:
        """True pose, heading wrapped."""
        s = self._now()
        return Pose2(s[k.X], s[k.Y], wrap_angle(s[k.THETA]))

    @property
    def world(self) -> World:
        """The room it stands in, with its walker."""
        return self._world

    @property
    def wheel_angles_rad(self) -> tuple[float, float]:
        """Left and right wheel angle, continuous."""
        s = self._read or self._now()
        return s[_ANGLE_L], s[_ANGLE_R]

    @property
    def inertial(self) -> Inertial:
        """What the inertial sensor feels, as sums since power-on."""
        s, footing = self._read or self._now(), self._footing
        if s[_TOUCHES]:
            v, lateral = s[k.SLIDE_V], s[k.SLIDE_LATERAL]
        else:
            v, lateral = footing.left_m * s[_GRIP_L] + footing.right_m * s[_GRIP_R], 0.0
        return _inertial(
            Inertial,
            (
                self.tick_ms,
                s[_THETA],
                v - s[_SLIDE_SWAY] / TICK_S + s[_GRAVITY_X],
                lateral + s[_SWAY] / TICK_S + s[_GRAVITY_Y],
                s[_ANGLE_L],
                s[_ANGLE_R],
                footing.pitch_rad,
                footing.roll_rad,
                footing.climb_m_s,
            ),
        )

    @property
    def motor_currents_a(self) -> tuple[float, float]:
        """Left and right motor current at this tick."""
        s, (left_v, right_v), current_a = self._now(), self._supply.bridges_v, self._motor.current_a
        return current_a(left_v, s[k.SPEED_L]), current_a(right_v, s[k.SPEED_R])

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
        """Between the wheels of this very robot."""
        return self._footing.wheel_base_m

    @property
    def supply_v(self) -> float:
        """The battery's voltage, sagging under its load."""
        return self._supply.supply_v

    @property
    def rail_5v_v(self) -> float:
        """The logic rail; it falls with the battery where that is below 6.5 V."""
        supply_v = self._supply.battery.terminal_v
        return rail_5v_v(supply_v) if supply_v < RAIL_WHOLE_V else RAIL_V

    @property
    def state_of_charge(self) -> float:
        """Of the battery, 0..1."""
        return self._supply.battery.state_of_charge

    @property
    def held(self) -> bool:
        """Whether what was put into the room holds it; see ``replace_world``."""
        return bool(self._p[k.HELD])

    @property
    def touch_bearings_rad(self) -> tuple[float, ...]:
        """See ``Truth.touch_bearings_rad``."""
        s = self._now()
        count = int(s[k.TOUCHES])
        if not count:
            return ()
        theta = s[k.THETA]
        return tuple(
            wrap_angle(atan2(-ny, -nx) - theta) for _, nx, ny in self._touch[:count].tolist()
        )

    @property
    def energy(self) -> EnergyBalance:
        """Where the battery's energy went."""
        return self._supply.energy(self.tick_ms, self._now())

    @property
    def truth(self) -> Truth:
        """Everything at this tick."""
        s = self._now()
        v, lateral = self._velocity(s)
        p = self._p
        return Truth(
            tick_ms=self.tick_ms,
            pose=Pose2(s[k.X], s[k.Y], wrap_angle(s[k.THETA])),
            heading_rad=s[k.THETA],
            v_m_s=v,
            v_lateral_m_s=lateral,
            yaw_rate_rad_s=float(p[k.YAW_R] * s[k.GRIP_R] - p[k.YAW_L] * s[k.GRIP_L]),
            left_rad=s[k.ANGLE_L],
            right_rad=s[k.ANGLE_R],
            left_rad_s=s[k.SPEED_L],
            right_rad_s=s[k.SPEED_R],
            impulse_x_m_s=v - s[k.SLIDE_SWAY] / TICK_S + s[k.GRAVITY_X],
            impulse_y_m_s=lateral + s[k.SWAY] / TICK_S + s[k.GRAVITY_Y],
            path_m=s[k.PATH],
            collisions=int(s[k.COLLISIONS]),
            contact_s=s[k.CONTACT_MS] * TICK_S,
            touch_bearings_rad=self.touch_bearings_rad,
            energy_wh=self.energy.battery_j / _JOULES_PER_WH,
        )

    # The state, and what the kernel is told.

    def _now(self) -> list[float]:
        """Give the state as a list; kept until something changes it."""
        if self._read is None:
            self._read = self._s.tolist()
        return self._read

    def _velocity(self, s: list[float]) -> tuple[float, float]:
        """Forwards and to the left, over the floor."""
        if s[k.TOUCHES]:
            return s[k.SLIDE_V], s[k.SLIDE_LATERAL]
        footing = self._footing
        return footing.left_m * s[k.GRIP_L] + footing.right_m * s[k.GRIP_R], 0.0

    def _take_world(self, world: World) -> None:
        self._world = world
        self._near: NDArray[np.int64] = np.zeros(world.edge_count, dtype=np.int64)
        self._s[k.NEAR_X] = np.inf

    def _feel_walls(self) -> None:
        """Let the kernel find what is touched, without time passing."""
        advance(0, self._s, self._p, self._world.edges, self._near, self._touch)
        self._read = None

    def _apply(self, faults: tuple[bool, bool, float, float, bool]) -> None:
        stuck_left, stuck_right, slip_left, slip_right, lifted = faults
        if lifted != self._applied[-1]:
            self._set_tau(lifted=lifted)
            self._footing.off_floor()
            self._s[k.TOUCHES] = 0.0
            self._s[k.DISTURBED] = 1.0
        self._applied = faults
        self._p[[k.STUCK_L, k.STUCK_R, k.LIFTED]] = stuck_left, stuck_right, lifted
        self._footing.set_extra_slip(slip_left, slip_right)
        self._read = None

    def _set_tau(self, *, lifted: bool) -> None:
        """Wheels in the air carry their own inertia only."""
        motor = self._motor
        tau = motor.time_constant_s
        if lifted:
            body = 0.5 * self._chassis.mass_kg * self._wheel_radius_m**2
            tau -= body * motor.resistance_ohm / motor.back_emf_v_s**2
            tau = max(tau, 0.1 * motor.time_constant_s)
        self._p[k.TAU], self._p[k.DECAY] = tau, 1.0 - exp(-TICK_S / tau)
