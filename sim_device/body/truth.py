"""What is really so: the plant's answers, which no host ever sees."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


class Inertial(NamedTuple):
    """The part of the truth that the inertial sensor needs, named as in ``Truth``.

    All are sums since power-on (angles and speeds among them), so that differences over time
    are means.
    """

    tick_ms: int
    heading_rad: float
    impulse_x_m_s: float
    impulse_y_m_s: float
    left_rad: float
    right_rad: float
    pitch_rad: float
    """Nose up positive; its weight is in the impulses already. So is ``roll_rad``'s."""
    roll_rad: float
    """Left side up positive."""
    climb_m_s: float
    """Vertical speed of the axle's centre: differences over time are mean accelerations."""


class EnergyBalance(NamedTuple):
    """Where the battery's energy went since power-on, in joules.

    ``battery_j`` = ``electronics_j`` + ``bridge_j`` + ``winding_j`` + ``shaft_j``.
    """

    battery_j: float
    """Given at the battery's terminals."""
    internal_j: float
    """Lost before them, in the battery's own resistance."""
    electronics_j: float
    bridge_j: float
    """Heat of the L298N, what a braking motor gives back included."""
    winding_j: float
    """Heat of both motors' windings."""
    shaft_j: float
    """Work of the motors: friction, the floor, and the motion that is left at the end."""


class Truth(NamedTuple):
    """What is really so at one tick."""

    tick_ms: int
    pose: Pose2
    """Heading wrapped to [-π, π)."""
    heading_rad: float
    """Heading, continuous."""
    v_m_s: float
    """Forward speed over the floor."""
    v_lateral_m_s: float
    """To the left; not 0 only while sliding along a wall."""
    yaw_rate_rad_s: float
    left_rad: float
    """Wheel angle, continuous: what the wheel turned, slipping or not."""
    right_rad: float
    left_rad_s: float
    right_rad_s: float
    impulse_x_m_s: float
    """Specific impulse along the body's x since power-on: the integral of what an
    accelerometer at the axle's centre feels, centripetal share and a tilted body's weight
    included; differences over time are mean accelerations."""
    impulse_y_m_s: float
    path_m: float
    """Travelled by the axle's centre over the floor."""
    collisions: int
    """Onsets of contact with normal speed above 0.03 m/s, re-armed after 0.5 s free."""
    contact_s: float
    """Time in contact, grazing included."""
    touch_bearings_rad: tuple[float, ...]
    """Bearings of the present contacts from the heading, counter-clockwise, [-π, π)."""
    energy_wh: float
    """Drawn from the battery."""
