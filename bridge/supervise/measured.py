"""What the supervisor works out of the wheels' counts and the gyro, for all rules at once.

An odometry of its own, and a plain one: ways and turns since the watch began, without walls
seen again or slips put right, so that it can be held against what others make of it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.kinematics import encoder_delta

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from protocol.messages import Encoders, Range

GAP_S = 0.3
"""Between two steps, or two counts: longer, and what was between them is not known."""
SMOOTH_S = 0.3
"""Time constant of the wheels' disagreement with the gyro, no shorter than ``GAP_S``."""
WHEELS_LATE_S = 0.030
"""By which the wheels' turn may be older than the gyro's: counts are up to 20 ms old, and are the
mean of the 20 ms before."""
GYRO_LATE_S = 0.010
"""By which the gyro's may be older: one sample at 100 Hz."""


class Measured:
    """Sums over the steps so far; ``restart`` begins them anew."""

    _encoders_s: float
    """When the counts that are the reference came."""

    def __init__(self, model: RobotModel) -> None:
        """At rest, nothing known."""
        self._per_count_m = model.metres_per_count
        self._base_m = model.wheel_base_m
        self.restart()

    def restart(self) -> None:
        """Forget the references: what was between is not known."""
        self.distance_m = 0.0
        """By both wheels' mean, signed."""
        self.travel_m = 0.0
        """The same, without its sign: grows in either direction."""
        self.turn_rad = 0.0
        """By the gyro, counter-clockwise."""
        self.slip_m_s = 0.0
        """Between the rims, smoothed: by which the right wheel leads the gyro's turn, beyond what a
        late sample of either explains."""
        self.step_s = 0.0
        """Since the step before; 0: unknown, the first or after a gap."""
        self.left_m = self.right_m = 0.0
        """Way of each wheel in this step."""
        self.wheel_turn_rad = 0.0
        """Turn in this step by the wheels."""
        self.new_range = False
        """Whether the rangers were sounded since the step before."""
        self._time_s: float | None = None
        self._encoders: Encoders | None = None
        self._range: Range | None = None
        self._excess_m_s = 0.0
        """The right wheel's lead over the gyro's turn, smoothed."""
        self._slow_yaw_rad_s = 0.0
        """Yaw rate by the gyro, smoothed alike."""

    def step(self, inputs: RuleInputs) -> None:
        """Take a control step."""
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
        """What of the wheels' lead no lateness of their samples explains.

        Wheels that are late by L trail a yaw acceleration α by -αL at their base. Smoothed over τ
        that is -(L/τ)·(ω - ω smoothed over τ), whatever the turn was.
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
        way = 0.5 * (self.left_m + self.right_m)
        self.distance_m += way
        self.travel_m += abs(way)
