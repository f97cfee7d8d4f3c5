"""Observations: the input of planner and controllers at each control step."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


class Observation(NamedTuple):
    """Sensor readings and estimate in one control step."""

    time_s: float
    """Time of this control step, s; only differences matter."""
    pose: Pose2
    """Estimated pose."""
    v_m_s: float
    """Estimated forward speed, m/s."""
    yaw_rate_rad_s: float
    """Estimated yaw rate, rad/s; positive: counter-clockwise."""
    ultrasonic_m: float | None
    """Range of the ultrasonic sensor, m; None: no echo."""
    infrared_left_m: float | None
    """Range of the left infrared sensor, m; None: nothing in range."""
    infrared_right_m: float | None
    """Range of the right infrared sensor, m; None: nothing in range."""
    bumper_left: bool
    """True if the left bumper switch is closed."""
    bumper_right: bool
    """True if the right bumper switch is closed."""
    cliff: bool
    """True if a barrier of the cliff sensor detects no floor."""
    gyro_bias_sigma_rad_s: float = 0.0
    """Standard deviation of the gyro bias, rad/s. A standstill reduces it."""
    heading_sigma_rad: float = 0.0
    """Standard deviation of the heading relative to the orthogonal walls, rad. A drive along such a
    wall reduces it. 0: no such walls."""
    lateral_sigma_m: float = 0.0
    """Standard deviation of the position across the heading, m."""
    stands: bool = False
    """True if the wheels turn but the robot stands, according to the accelerometer."""


class VelocityCommand(NamedTuple):
    """A body velocity: forward speed and yaw rate."""

    v_m_s: float
    yaw_rate_rad_s: float


HALT = VelocityCommand(0.0, 0.0)
INFRARED_PERIOD_S = 0.05
"""Age from which an equal infrared range counts as a new reading, s. Readings arrive at 20 Hz."""
