"""The wheel motors and their L298N bridge, referred to the wheel's shaft.

A brushed motor without inductance: V = R·i + K·ω and J·dω/dt = K·i - friction, which is a
first-order lag with time constant τ = J·R/K² towards ω = (V - V_friction)/K. Friction is
given as the voltage that overcomes it. The bridge gives |duty| · supply less its saturation
drop, and nothing below it: together with friction that is the dead band, about 15 % of duty.

The plant's ``drive_kernel`` integrates this exactly over each millisecond. The L298 (datasheet,
V_CEsat total) loses 1.8 V at least at 1 A and about 1.2 V more per ampere: the constant is the
robot file's drop, the slope is counted with the winding's resistance. With no duty both ends
of the motor are tied together, and it brakes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MotorParameters:
    """A 12 V gear motor of about 120 turns a minute, as robots of this size carry.

    With a full battery (16 V) and the bridge's drop it tops out at 0.40 m/s on a 65 mm wheel,
    with an empty one above the 0.30 m/s that the robot claims.
    """

    back_emf_v_s: float = 1.10
    """K: volts per rad/s of the wheel, as well as N·m per ampere."""
    resistance_ohm: float = 8.0
    """Winding and brushes, and the bridge's share that grows with the current: a stall at full
    battery takes 1.76 A."""
    friction_v: float = 0.5
    """Voltage lost to friction; 62 mA of no-load current."""
    time_constant_s: float = 0.05
    """τ, with the robot's mass."""

    def terminal_v(self, duty: float, supply_v: float, drop_v: float) -> float:
        """Voltage at the motor for a duty in -1..1, after the bridge's drop (L298N 1.8-2 V)."""
        magnitude = abs(duty) * supply_v - drop_v
        if magnitude <= 0.0:
            return 0.0
        return magnitude if duty > 0.0 else -magnitude

    def target_rad_s(self, terminal_v: float, wheel_rad_s: float, drag_v: float) -> float:
        """Speed that the lag tends to: drag is against the motion, at rest against the pull.

        Equal to ``wheel_rad_s`` = 0 where the pull does not overcome the drag.
        """
        if wheel_rad_s > 0.0:
            return (terminal_v - drag_v) / self.back_emf_v_s
        if wheel_rad_s < 0.0:
            return (terminal_v + drag_v) / self.back_emf_v_s
        if terminal_v > drag_v:
            return (terminal_v - drag_v) / self.back_emf_v_s
        if terminal_v < -drag_v:
            return (terminal_v + drag_v) / self.back_emf_v_s
        return 0.0

    def steady_rad_s(self, terminal_v: float) -> float:
        """Wheel speed reached under no load but friction; 0 in the dead band."""
        return self.target_rad_s(terminal_v, 0.0, self.friction_v)

    def current_a(self, terminal_v: float, wheel_rad_s: float) -> float:
        """Motor current; negative while it brakes."""
        return (terminal_v - self.back_emf_v_s * wheel_rad_s) / self.resistance_ohm

    def charge_c(self, terminal_v: float, turned_rad: float, duration_s: float) -> float:
        """Integral of the motor's current at a constant voltage.

        The current is linear in the wheel's speed, so that only the angle matters.
        """
        return (terminal_v * duration_s - self.back_emf_v_s * turned_rad) / self.resistance_ohm

    def duty_for(self, wheel_rad_s: float, supply_v: float, drop_v: float) -> float:
        """Duty that holds a wheel speed: the inverse of the two above; limited to -1..1."""
        if wheel_rad_s == 0.0:
            return 0.0
        needed_v = abs(wheel_rad_s) * self.back_emf_v_s + self.friction_v + drop_v
        duty = min(1.0, needed_v / supply_v)
        return duty if wheel_rad_s > 0.0 else -duty
