"""Speeds of the wheels of a robot that moves with a body velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel


def wheel_speeds_m_s(model: RobotModel, v_m_s: float, yaw_rate_rad_s: float) -> tuple[float, float]:
    """Return left and right wheel speed for a body velocity (inverse of the paper's eq. 4)."""
    half = 0.5 * model.wheel_base_m * yaw_rate_rad_s
    return v_m_s - half, v_m_s + half
