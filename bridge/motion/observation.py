"""Observations: the input of planner and controllers at each control step."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


class Observation(NamedTuple):
    """Sensor readings and estimate at one control step."""

    time_s: float
    """Time of this step; only differences matter."""
    pose: Pose2
    """Estimated pose."""
    v_m_s: float
    """Estimated forward speed."""
    yaw_rate_rad_s: float
    ultrasonic_m: float | None
    """Range from the ultrasonic's face; ``None``: no echo."""
    infrared_left_m: float | None
    """Range of the left infrared sensor, m; ``None``: nothing within its range."""
    infrared_right_m: float | None
    bumper_left: bool
    bumper_right: bool
    cliff: bool
    gyro_bias_sigma_rad_s: float = 0.0
    """Standard deviation of the gyro's bias; a rest reduces it."""
    heading_sigma_rad: float = 0.0
    """Standard deviation of the heading against the walls that are known to be square; a run along
    one of them reduces it. 0: no such walls."""


class VelocityCommand(NamedTuple):
    """A body velocity: forward speed and yaw rate."""

    v_m_s: float
    yaw_rate_rad_s: float


HALT = VelocityCommand(0.0, 0.0)
