"""Closed-loop turning: PD on the yaw error (paper section 3.3 eq. 2)."""

from __future__ import annotations

import math

from bridge.motion.control.pid import Pid, PidGains
from bridge.motion.geometry import wrap_angle

ROTARY_GAINS = PidGains(kp=5.0, td_s=0.03)


class RotaryController:
    """Yaw rate that turns the robot to a heading.

    Beyond eq. 2, the error is wrapped to ±π, the output is saturated, and near the target it stays
    below sqrt(2 α |e|), the highest rate from which a deceleration α still stops in time.
    """

    __slots__ = ("_brake_rad_s2", "_pid")

    def __init__(
        self,
        max_rate_rad_s: float,
        brake_rad_s2: float = math.inf,
        gains: PidGains = ROTARY_GAINS,
    ) -> None:
        """Limits in rad/s and rad/s²."""
        self._pid = Pid(gains, max_rate_rad_s)
        self._brake_rad_s2 = brake_rad_s2

    def reset(self) -> None:
        """Reset the last error."""
        self._pid.reset()

    def update(self, target_rad: float, yaw_rad: float, dt_s: float) -> float:
        """Yaw rate in rad/s for the target heading and the present one."""
        error = wrap_angle(target_rad - yaw_rad)
        rate = self._pid.update(error, dt_s)
        limit = math.sqrt(2.0 * self._brake_rad_s2 * abs(error))
        return max(min(rate, limit), -limit)
