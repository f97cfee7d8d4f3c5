"""Plain odometry from wheel counts and gyro, shared by all rules.

It sums distances and turns since the start, without corrections by walls or for slip. So the rules
have an independent reference.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.estimation.odometry import encoder_delta

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from protocol.messages.device import Encoders, Range

GAP_S = 0.3
"""Maximum time between two steps or two counts, s. Across a longer gap the motion is unknown."""
SMOOTH_S = 0.3
"""Time constant of the smoothed wheel lead, s; at least ``GAP_S``."""
WHEELS_LATE_S = 0.030
"""Maximum delay of the wheels' turn relative to the gyro's turn, s. Wheel counts are up to 20 ms
old, and a turn from them is the mean over the 20 ms before."""
GYRO_LATE_S = 0.010
"""Maximum delay of the gyro's turn relative to the wheels' turn, s. It is one sample at 100 Hz."""


class Measured:
    """Sums over the control steps; :meth:`restart` resets them."""

    _encoders_s: float
    """Arrival time of the reference counts, s."""
    _excess_m_s: float
    """Smoothed speed of the right wheel relative to the gyro's turn, m/s."""
    _slow_yaw_rad_s: float
    """Smoothed yaw rate of the gyro, rad/s."""

    def __init__(self, model: RobotModel) -> None:
        """Start with all sums at zero."""
        self._per_count_m = model.metres_per_count
        self._base_m = model.wheel_base_m
        self.restart()

    def restart(self) -> None:
        """Reset all sums and references."""
        self.distance_m = 0.0
        """Signed distance travelled, mean of both wheels, m."""
        self.travel_m = 0.0
        """Distance travelled in either direction, m."""
        self.turn_rad = 0.0
        """Turn by the gyro, counter-clockwise, rad."""
        self.slip_m_s = 0.0
        """Smoothed speed of the right wheel relative to the gyro's turn, minus the effect of late
        samples, m/s."""
        self.step_s = 0.0
        """Time since the last step, s; 0 at the first step and after a gap."""
        self.left_m = self.right_m = 0.0
        """Distance of each wheel in this step, m."""
        self.wheel_turn_rad = 0.0
        """Turn in this step by the wheels, rad."""
        self.new_range = False
        """True if a new range sample arrived since the last step."""
        self._time_s: float | None = None
        self._encoders: Encoders | None = None
        self._range: Range | None = None

    def step(self, inputs: RuleInputs) -> None:
        """Add a control step."""
        now_s = inputs.time_s
        before_s, self._time_s = self._time_s, now_s
        dt = math.inf if before_s is None else now_s - before_s
        whole = 0.0 < dt <= GAP_S
        self.step_s = dt if whole else 0.0
        self.new_range = inputs.range is not self._range
        self._range = inputs.range
        self._roll(inputs.encoders, now_s, inputs.wheel_scale)
        turn = inputs.yaw_rate_rad_s * self.step_s
        self.turn_rad += turn
        if not whole:
            self.slip_m_s = self._excess_m_s = 0.0
            self._slow_yaw_rad_s = inputs.yaw_rate_rad_s
            return
        excess_m_s = (self.right_m - self.left_m - turn * self._base_m) / dt
        share = dt / SMOOTH_S
        self._excess_m_s += share * (excess_m_s - self._excess_m_s)
        self._slow_yaw_rad_s += share * (inputs.yaw_rate_rad_s - self._slow_yaw_rad_s)
        self.slip_m_s = self._beyond_lateness(inputs.yaw_rate_rad_s)

    def _beyond_lateness(self, yaw_rate_rad_s: float) -> float:
        """Return the part of the wheels' lead that late samples do not explain, m/s.

        At a yaw acceleration α, wheel samples with a delay L have a yaw rate error of -αL. The lead
        is this error times the wheel base. Smoothed with the time constant τ, the error is
        -(L/τ)·(ω - ω smoothed over τ), for any turn.
        """
        swing_m_s = self._base_m / SMOOTH_S * (yaw_rate_rad_s - self._slow_yaw_rad_s)
        one, other = -WHEELS_LATE_S * swing_m_s, GYRO_LATE_S * swing_m_s
        low, high = min(one, other), max(one, other)
        return self._excess_m_s - min(max(self._excess_m_s, low), high)

    def _roll(self, encoders: Encoders | None, now_s: float, wheel_scale: float) -> None:
        before = self._encoders
        self.left_m = self.right_m = self.wheel_turn_rad = 0.0
        if encoders is before or encoders is None:
            return
        self._encoders = encoders
        if before is None:
            self._encoders_s = now_s
            return
        gap_s, self._encoders_s = now_s - self._encoders_s, now_s
        if gap_s > GAP_S:
            return
        scale = self._per_count_m * wheel_scale
        self.left_m = scale * encoder_delta(before.left, encoders.left)
        self.right_m = scale * encoder_delta(before.right, encoders.right)
        self.wheel_turn_rad = (self.right_m - self.left_m) / self._base_m
        distance_m = 0.5 * (self.left_m + self.right_m)
        self.distance_m += distance_m
        self.travel_m += abs(distance_m)
