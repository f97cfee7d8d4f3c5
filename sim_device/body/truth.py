"""The plant's true state, which is never sent to a host."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


class Inertial(NamedTuple):
    """Part of the true state that the inertial sensor needs; the names are as in ``Truth``.

    Each value is an integral since power-on: an angle is the integral of a rate, and a speed is the
    integral of an acceleration. So the difference of two values, divided by the time between them,
    is the mean rate or acceleration.
    """

    tick_ms: int
    heading_rad: float
    impulse_x_m_s: float
    impulse_y_m_s: float
    left_rad: float
    right_rad: float
    pitch_rad: float
    """Pitch angle, rad, nose up positive. ``impulse_x_m_s`` already includes the component of
    gravity that this pitch causes."""
    roll_rad: float
    """Roll angle, rad, left side up positive. ``impulse_y_m_s`` already includes the component of
    gravity that this roll causes."""
    climb_m_s: float
    """Vertical speed of the axle's centre, m/s. A difference divided by its time is a mean
    acceleration."""


class EnergyBalance(NamedTuple):
    """Energy balance of the battery since power-on, J.

    ``battery_j`` = ``electronics_j`` + ``bridge_j`` + ``winding_j`` + ``shaft_j``.
    """

    battery_j: float
    """Energy at the battery's terminals, J."""
    internal_j: float
    """Energy lost in the battery's own resistance, J."""
    electronics_j: float
    bridge_j: float
    """Heat of the L298N, J, including the energy of a braking motor."""
    winding_j: float
    """Heat in the windings of both motors, J."""
    shaft_j: float
    """Mechanical work of the motors, J. Friction and the floor's drag dissipate it, except for the
    present kinetic energy."""


class Truth(NamedTuple):
    """The true state at one tick."""

    tick_ms: int
    pose: Pose2
    """True pose, heading wrapped to [-π, π)."""
    heading_rad: float
    """Heading, rad, continuous."""
    v_m_s: float
    """Forward speed over the floor, m/s."""
    v_lateral_m_s: float
    """Lateral speed, m/s, positive to the left. It is nonzero only while the robot slides along a
    wall."""
    yaw_rate_rad_s: float
    left_rad: float
    """Angle of the left wheel, rad, continuous; turns of a slipping wheel are included."""
    right_rad: float
    left_rad_s: float
    right_rad_s: float
    impulse_x_m_s: float
    """Specific impulse along the body's x axis since power-on, m/s: the time integral of an
    accelerometer at the centre of the axle. It includes centripetal acceleration and, if the body
    is tilted, a component of gravity. A difference divided by its time is a mean acceleration."""
    impulse_y_m_s: float
    path_m: float
    """Path length of the axle's centre over the floor, m."""
    collisions: int
    """Number of onsets of contact with a normal speed above 0.03 m/s, re-armed after 0.5 s without
    contact."""
    contact_s: float
    """Time in contact, s, grazing included."""
    touch_bearings_rad: tuple[float, ...]
    """Bearings of the present contacts relative to the heading, rad, counter-clockwise, [-π, π)."""
    energy_wh: float
    """Energy drawn from the battery, W·h."""
