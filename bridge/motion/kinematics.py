"""Differential-drive kinematics and encoder counts (paper eq. 2-4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel

ENCODER_MODULUS = 1 << 16
_HALF = ENCODER_MODULUS >> 1


class PoseRate(NamedTuple):
    """Time derivative of a pose in the outer frame: m/s, m/s, rad/s."""

    x_m_s: float
    y_m_s: float
    theta_rad_s: float


def pose_rate(pose: Pose2, v_m_s: float, yaw_rate_rad_s: float) -> PoseRate:
    """Forward kinematics without wheel slip (eq. 2)."""
    return PoseRate(
        v_m_s * math.cos(pose.theta_rad),
        v_m_s * math.sin(pose.theta_rad),
        yaw_rate_rad_s,
    )


def encoder_delta(previous: int, current: int) -> int:
    """Return the counts from ``previous`` to ``current`` of a wrapping 16-bit counter.

    The result is the shorter difference, in [-32768, 32767]. It is right while the wheel turns by
    less than half the counter's range, 4.3 m with the default wheel.
    """
    return ((current - previous + _HALF) % ENCODER_MODULUS) - _HALF


def wheel_travel_m(model: RobotModel, counts: int) -> float:
    """Distance rolled by one wheel for a number of counts (eq. 3)."""
    return model.metres_per_count * counts


def body_motion(model: RobotModel, left_m: float, right_m: float) -> tuple[float, float]:
    """Travel of the axle's centre (m) and rotation (rad) from both wheels' travel (eq. 4).

    The same matrix maps wheel speeds to body velocity.
    """
    return 0.5 * (right_m + left_m), (right_m - left_m) / model.wheel_base_m


def wheel_motion(model: RobotModel, travel_m: float, rotation_rad: float) -> tuple[float, float]:
    """Left and right wheel travel for a body motion (eq. 4 inverted)."""
    half = 0.5 * model.wheel_base_m * rotation_rad
    return travel_m - half, travel_m + half
