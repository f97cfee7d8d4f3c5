"""Closed-loop turning: PD control of the yaw error (paper section 3.3, eq. 2)."""

from __future__ import annotations

import math

from bridge.motion.control.pid import Pid, PidGains
from bridge.motion.geometry import wrap_angle

ROTARY_GAINS = PidGains(kp=5.0, td_s=0.03)
"""Gains from the heading error (rad) to the yaw rate (rad/s): the fastest with less than 2 %
overshoot of a turn by 90° (``test_step_response``)."""


class RotaryController:
    """Computes the yaw rate that turns the robot to a heading.

    There are three differences from eq. 2. The error e is wrapped to ±π. The output is saturated.
    Near the target the yaw rate stays below sqrt(2 α |e|). This is the maximum rate from which the
    robot stops in time with the deceleration α.
    """

    __slots__ = ("_brake_rad_s2", "_pid")

    def __init__(
        self,
        max_rate_rad_s: float,
        brake_rad_s2: float = math.inf,
        gains: PidGains = ROTARY_GAINS,
    ) -> None:
        """Create a controller. The limits are in rad/s and rad/s²."""
        self._pid = Pid(gains, max_rate_rad_s)
        self._brake_rad_s2 = brake_rad_s2

    def reset(self) -> None:
        """Reset the last error."""
        self._pid.reset()

    def update(self, target_rad: float, yaw_rad: float, dt_s: float) -> float:
        """Return the yaw rate for the target heading and the present heading, rad/s."""
        error = wrap_angle(target_rad - yaw_rad)
        rate = self._pid.update(error, dt_s)
        limit = math.sqrt(2.0 * self._brake_rad_s2 * abs(error))
        return max(min(rate, limit), -limit)
