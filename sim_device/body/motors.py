"""The wheel motors and their L298N bridge, with all quantities at the wheel's shaft.

The model is a brushed motor without inductance: V = R·i + K·ω and J·dω/dt = K·i - friction. This is
a first-order lag with time constant τ = J·R/K² towards ω = (V - V_friction)/K. Friction is given as
the voltage that overcomes it. The output of the bridge is |duty| · supply minus the saturation
drop, but at least 0. Drop and friction together cause the dead band, about 15 % of duty.

``drive_kernel`` integrates this model exactly over each millisecond. The drop of the L298
(datasheet, V_CEsat total) is at least 1.8 V at 1 A, and increases by about 1.2 V per ampere. The
constant part is the drop in the robot file; the increase per ampere is included in the winding's
resistance. At duty 0 the bridge connects both ends of the motor, and the motor brakes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MotorParameters:
    """A 12 V gear motor with about 120 revolutions per minute, typical for robots of this size.

    With a 65 mm wheel, a full battery (16 V) and the bridge's drop, it reaches 0.40 m/s. With an
    empty battery the speed still exceeds 0.30 m/s, the maximum speed in the robot file.
    """

    back_emf_v_s: float = 1.10
    """Motor constant K at the wheel, V per rad/s; the same number is the torque constant, N·m/A."""
    resistance_ohm: float = 8.0
    """Resistance of winding, brushes and the bridge's current-dependent part, Ω. The stall current
    at full battery is 1.76 A."""
    friction_v: float = 0.5
    """Voltage lost to friction, V; the no-load current is 62 mA."""
    time_constant_s: float = 0.05
    """Time constant τ of the lag, s, with the robot's mass."""

    def current_a(self, terminal_v: float, wheel_rad_s: float) -> float:
        """Return the motor current; negative while the motor brakes."""
        return (terminal_v - self.back_emf_v_s * wheel_rad_s) / self.resistance_ohm
