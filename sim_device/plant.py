"""The sweeper's body: wheels, pose, contact and energy, integrated at 1 kHz.

Truth, and nothing of the host's: wheel speeds follow the motors' lag exactly, the pose takes
each millisecond's midpoint heading, walls stop the disc. Equal calls give equal truth, to the
bit, however ``advance_ms`` is split: what is done in a batch depends only on the tick.

Contact is quasi-static. A wall ahead takes the part of the motion that goes into it
(``collide``); the disc slides along with friction, or stays. The wheels meanwhile slip: they
push with at most ``traction_n`` each, which the motor feels as a load in the measure in which
the wall is straight ahead. A duty too low for that load stalls the wheel, a higher one spins
it on the spot, and the encoders count what the wheels turn. The wall's force goes through
the disc's centre, which is the axle's, so it turns nothing; friction at the rim would, and
is left out. Traction is not limited while accelerating freely: the host's 0.4 m/s² is far
below what the tyres hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, exp, hypot, isfinite, sin
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device.collide import TOUCH_M, ContactCounter, Touch, move_disc, nearest_m
from sim_device.drive_kernel import TICK_S, Rolling, WheelStep, roll_free, turn_wheel
from sim_device.motors import MotorParameters
from sim_device.noise import SLIP_TIME_S, Draws
from sim_device.power import Battery, BatteryParameters, Draw
from sim_device.truth import Inertial, Truth

if TYPE_CHECKING:
    import numpy as np

    from bridge.motion.robot_model import RobotModel
    from sim_device.noise import NoiseLevel
    from sim_device.world import Edge, World

__all__ = ["Chassis", "DutyError", "Inertial", "Plant", "Truth"]

SLOW_MS = 10
"""Period of what changes slowly: battery voltage and slip."""
_NEAR_M = 0.35
"""Edges within the radius and this are looked at; renewed as the robot has gone ..."""
_NEAR_MOVED_M = 0.25
_CAREFUL_M = 0.02
"""Farther walls cannot be met within a batch: at most 10 ms, far below 2 m/s."""
_JOULES_PER_WH = 3600.0


class DutyError(ValueError):
    """A duty that is not a finite number: a fault of the caller, not of the robot."""

    def __init__(self, left: float, right: float) -> None:
        """Keep both duties."""
        self.left, self.right = left, right
        super().__init__(f"duty must be finite, not ({left}, {right})")


@dataclass(frozen=True, slots=True)
class Chassis:
    """Forces between the robot, the floor and the walls, and the load of its electronics."""

    traction_n: float = 7.0
    """Greatest push of one wheel: 3 kg, 80 % of it on the wheels, coefficient 0.6."""
    wall_friction: float = 0.2
    """Bumper's plastic on a painted wall."""
    electronics_w: float = 1.5
    """Controller, sensors and bridges at rest, drawn from the battery."""


_CHASSIS, _MOTOR = Chassis(), MotorParameters()


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
        self._world, self._noise = world, noise
        self._motor, self._chassis = motor, chassis
        self._battery = Battery(
            battery or BatteryParameters(full_v=model.battery_v, capacity_ah=model.battery_ah),
        )
        self._drop_v = model.driver_drop_v
        self._radius_m = model.radius_m

        parts = Draws(part_rng)
        common = 1.0 + parts.tolerance(noise.wheel_diameter_error)
        skew = 0.5 * parts.tolerance(noise.wheel_mismatch)
        nominal_m = 0.5 * model.wheel_diameter_m
        self.left_radius_m = nominal_m * common * (1.0 + skew)
        self.right_radius_m = nominal_m * common * (1.0 - skew)
        self.wheel_base_m = model.wheel_base_m * (1.0 + parts.tolerance(noise.wheel_base_error))
        self._slip_draws = Draws(slip_rng)
        self._slip_left = self._slip_right = 0.0
        self._load_v = chassis.traction_n * nominal_m * motor.resistance_ohm / motor.back_emf_v_s

        start = world.plan.start
        self._r = Rolling(0.0, 0.0, 0.0, 0.0, start.x_m, start.y_m, start.theta_rad, 0.0, 0.0)
        self.tick_ms = 0
        self._duty_left = self._duty_right = 0.0
        self._since_ms, self._since_left_rad, self._since_right_rad = 0, 0.0, 0.0
        self.supply_v = self._battery.terminal_v

        self._near: list[Edge] = []
        self._near_x = self._near_y = float("inf")
        self._gap_m = 0.0
        self._slide_m_rad = 0.0
        self._slide_v = self._slide_lateral_v = 0.0
        self._contacts = ContactCounter()
        self._renew_near()
        self._close = self._near
        self._touches: tuple[Touch, ...] = move_disc(
            start.x_m,
            start.y_m,
            0.0,
            0.0,
            self._radius_m,
            self._near,
            (),
            chassis.wall_friction,
        ).touches
        self._set_step()
        self._set_voltages()

    # What drives it.

    def set_duty(self, left: float, right: float) -> None:
        """Set both bridges' duty; limited to -1..1, held until set again.

        Raises:
            DutyError: a duty is not finite.

        """
        if not (isfinite(left) and isfinite(right)):
            raise DutyError(left, right)
        left = min(1.0, max(-1.0, left))
        right = min(1.0, max(-1.0, right))
        if left == self._duty_left and right == self._duty_right:
            return
        self._book()
        self._duty_left, self._duty_right = left, right
        self._set_voltages()

    def advance_ms(self, n: int) -> None:
        """Let ``n`` milliseconds pass."""
        while n > 0:
            ticks = min(n, SLOW_MS - self.tick_ms % SLOW_MS)
            self._advance_block(ticks)
            n -= ticks
            if self.tick_ms % SLOW_MS == 0:
                self._slow_tick()

    # What is so.

    @property
    def pose(self) -> Pose2:
        """True pose, heading wrapped."""
        r = self._r
        return Pose2(r.x_m, r.y_m, wrap_angle(r.theta_rad))

    @property
    def world(self) -> World:
        """The room it stands in."""
        return self._world

    @property
    def wheel_angles_rad(self) -> tuple[float, float]:
        """Left and right wheel angle, continuous."""
        return self._r.left_rad, self._r.right_rad

    @property
    def inertial(self) -> Inertial:
        """What the inertial sensor feels, as sums since power-on."""
        r, s = self._r, self._step
        if self._touches:
            v, lateral = self._slide_v, self._slide_lateral_v
        else:
            v, lateral = s.left_m * r.left_rad_s + s.right_m * r.right_rad_s, 0.0
        return Inertial(
            self.tick_ms,
            r.theta_rad,
            v - self._slide_m_rad / TICK_S,
            lateral + r.sway_m_rad / TICK_S,
            r.left_rad,
            r.right_rad,
        )

    @property
    def motor_currents_a(self) -> tuple[float, float]:
        """Left and right motor current at this tick."""
        return (
            self._motor.current_a(self._left_v, self._r.left_rad_s),
            self._motor.current_a(self._right_v, self._r.right_rad_s),
        )

    @property
    def state_of_charge(self) -> float:
        """Of the battery, 0..1."""
        return self._battery.state_of_charge

    @property
    def touch_bearings_rad(self) -> tuple[float, ...]:
        """See ``Truth.touch_bearings_rad``."""
        if not self._touches:
            return ()
        return tuple(_bearing(t, self._r.theta_rad) for t in self._touches)

    @property
    def truth(self) -> Truth:
        """Everything at this tick."""
        r, s = self._r, self._step
        _, _, impulse_x, impulse_y, _, _ = self.inertial
        if self._touches:
            v, lateral = self._slide_v, self._slide_lateral_v
        else:
            v, lateral = s.left_m * r.left_rad_s + s.right_m * r.right_rad_s, 0.0
        return Truth(
            tick_ms=self.tick_ms,
            pose=Pose2(r.x_m, r.y_m, wrap_angle(r.theta_rad)),
            heading_rad=r.theta_rad,
            v_m_s=v,
            v_lateral_m_s=lateral,
            yaw_rate_rad_s=s.right_yaw * r.right_rad_s - s.left_yaw * r.left_rad_s,
            left_rad=r.left_rad,
            right_rad=r.right_rad,
            left_rad_s=r.left_rad_s,
            right_rad_s=r.right_rad_s,
            impulse_x_m_s=impulse_x,
            impulse_y_m_s=impulse_y,
            path_m=r.path_m,
            collisions=self._contacts.collisions,
            contact_s=self._contacts.contact_ms * TICK_S,
            touch_bearings_rad=self.touch_bearings_rad,
            energy_wh=(self._battery.drawn_j + self._drawn().energy_j) / _JOULES_PER_WH,
        )

    # One batch.

    def _advance_block(self, ticks: int) -> None:
        r, s = self._r, self._step
        motor = self._motor
        target_left = motor.target_rad_s(self._left_v, r.left_rad_s, motor.friction_v)
        target_right = motor.target_rad_s(self._right_v, r.right_rad_s, motor.friction_v)
        no_reversal = r.left_rad_s * target_left >= 0.0 and r.right_rad_s * target_right >= 0.0
        if no_reversal and not self._touches:
            reach_m = (ticks * TICK_S) * (
                s.left_m * max(abs(r.left_rad_s), abs(target_left))
                + s.right_m * max(abs(r.right_rad_s), abs(target_right))
            )
            if self._gap_m <= reach_m + TOUCH_M:
                self._measure_gap()
            if self._gap_m > reach_m + TOUCH_M:
                self._r = roll_free(ticks, r, s, target_left, target_right)
                self._gap_m -= self._r.path_m - r.path_m
                self.tick_ms += ticks
                return
        self._measure_gap()
        reach_m = self._radius_m + _CAREFUL_M
        r = self._r
        self._close = [e for e in self._near if nearest_m(r.x_m, r.y_m, (e,)) < reach_m]
        for _ in range(ticks):
            self._careful_tick()

    def _careful_tick(self) -> None:
        """One millisecond in which a wheel may pass rest or a wall may be met.

        Where neither happens it computes the same floats as ``roll_free``.
        """
        wl, wr, al, ar, x, y, th, sway, path = self._r
        decay, tau, cl, cr, yl, yr = self._step
        drag_left, drag_right = self._drags(th)
        wl1, il = turn_wheel(self._motor, wl, self._left_v, drag_left, decay, tau)
        wr1, ir = turn_wheel(self._motor, wr, self._right_v, drag_right, decay, tau)
        ds = cl * il + cr * ir
        dth = yr * ir - yl * il
        mid = th + 0.5 * dth
        c, s = cos(mid), sin(mid)
        dx, dy = ds * c, ds * s
        travel = ds if ds > 0.0 else -ds
        self.tick_ms += 1
        if not self._touches and self._gap_m > travel + TOUCH_M:
            self._gap_m -= travel
            self._r = Rolling(
                wl1,
                wr1,
                al + il,
                ar + ir,
                x + dx,
                y + dy,
                th + dth,
                sway + ds * dth,
                path + travel,
            )
            return
        before = self._touches
        if before:
            vx, vy = self._floor_velocity(th)
        else:
            v = cl * wl + cr * wr
            vx, vy = v * cos(th), v * sin(th)
        x1, y1 = x, y
        if travel > 0.0:
            x1, y1, self._touches, gap_m = move_disc(
                x,
                y,
                dx,
                dy,
                self._radius_m,
                self._close,
                before,
                self._chassis.wall_friction,
            )
            self._gap_m = min(gap_m, _CAREFUL_M)
        if x1 == x + dx and y1 == y + dy:  # unhindered: the floats of the free floor
            ahead, aside = ds, 0.0
        else:
            gone_x, gone_y = x1 - x, y1 - y
            ahead, aside = gone_x * c + gone_y * s, gone_y * c - gone_x * s
            travel = hypot(gone_x, gone_y)
        self._slide_v, self._slide_lateral_v = ahead / TICK_S, aside / TICK_S
        self._slide_m_rad += aside * dth
        self._r = Rolling(
            wl1,
            wr1,
            al + il,
            ar + ir,
            x1,
            y1,
            th + dth,
            sway + ahead * dth,
            path + travel,
        )
        if self._touches:
            self._contacts.count(self.tick_ms, before, self._touches, vx, vy)

    def _drags(self, theta: float) -> tuple[float, float]:
        """Voltage that friction, and a wall pushed against, takes from each motor."""
        friction = self._motor.friction_v
        if not self._touches:
            return friction, friction
        left_v, right_v = self._left_v, self._right_v
        total = abs(left_v) + abs(right_v)
        if total == 0.0:
            return friction, friction
        push = (left_v + right_v) / total
        c, s = push * cos(theta), push * sin(theta)
        blocked = 0.0
        for _, nx, ny in self._touches:
            against = -(c * nx + s * ny)
            if against > blocked:  # noqa: PLR1730 - each millisecond: no call
                blocked = against
        load = blocked * self._load_v
        return (
            friction + load if left_v * push > 0.0 else friction,
            friction + load if right_v * push > 0.0 else friction,
        )

    def _floor_velocity(self, theta: float) -> tuple[float, float]:
        c, s = cos(theta), sin(theta)
        v, lateral = self._slide_v, self._slide_lateral_v
        return v * c - lateral * s, v * s + lateral * c

    # Contact.

    def _measure_gap(self) -> None:
        """Distance from the disc to the walls, exact when it is small."""
        r = self._r
        gone = hypot(r.x_m - self._near_x, r.y_m - self._near_y)
        if gone > _NEAR_MOVED_M:
            self._renew_near()
            gone = 0.0
        nearest = nearest_m(r.x_m, r.y_m, self._near) - self._radius_m
        self._gap_m = min(nearest, _NEAR_M - gone)

    def _renew_near(self) -> None:
        r = self._r
        self._near = self._world.edges_near(r.x_m, r.y_m, self._radius_m + _NEAR_M)
        self._near_x, self._near_y = r.x_m, r.y_m

    # Power and what else changes slowly.

    def _slow_tick(self) -> None:
        self._book()
        self._battery.settle(SLOW_MS * TICK_S)
        self.supply_v = self._battery.terminal_v
        if self._noise.slip_sigma > 0.0:
            fade = SLOW_MS * TICK_S / SLIP_TIME_S
            kick = self._noise.slip_sigma * (2.0 * fade) ** 0.5
            self._slip_left += kick * self._slip_draws.normal() - fade * self._slip_left
            self._slip_right += kick * self._slip_draws.normal() - fade * self._slip_right
            self._set_step()
        self._set_voltages()

    def _set_step(self) -> None:
        grip_left = 1.0 - self._noise.slip_mean - self._slip_left
        grip_right = 1.0 - self._noise.slip_mean - self._slip_right
        left_m, right_m = self.left_radius_m * grip_left, self.right_radius_m * grip_right
        tau = self._motor.time_constant_s
        self._step = WheelStep(
            1.0 - exp(-TICK_S / tau),
            tau,
            0.5 * left_m,
            0.5 * right_m,
            left_m / self.wheel_base_m,
            right_m / self.wheel_base_m,
        )

    def _set_voltages(self) -> None:
        terminal_v = self._motor.terminal_v
        self._left_v = terminal_v(self._duty_left, self.supply_v, self._drop_v)
        self._right_v = terminal_v(self._duty_right, self.supply_v, self._drop_v)

    def _drawn(self) -> Draw:
        """Charge and energy drawn since the duty or the supply last changed."""
        r = self._r
        duration_s = (self.tick_ms - self._since_ms) * TICK_S
        charge = self._motor.charge_c
        left_c = charge(self._left_v, r.left_rad - self._since_left_rad, duration_s)
        right_c = charge(self._right_v, r.right_rad - self._since_right_rad, duration_s)
        # What a braking motor gives back is lost in the bridge.
        motors_c = max(0.0, self._duty_left * left_c) + max(0.0, self._duty_right * right_c)
        base_j = self._chassis.electronics_w * duration_s
        return Draw(motors_c + base_j / self.supply_v, motors_c * self.supply_v + base_j)

    def _book(self) -> None:
        """Book what was drawn, before the duty or the supply changes."""
        self._battery.draw(self._drawn())
        self._since_ms = self.tick_ms
        self._since_left_rad, self._since_right_rad = self._r.left_rad, self._r.right_rad


def _bearing(touch: Touch, theta: float) -> float:
    return wrap_angle(atan2(-touch.normal_y, -touch.normal_x) - theta)
