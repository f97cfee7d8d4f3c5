"""Wheel speed control from encoder counts: ramp, feed-forward and PI, at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_device.device.wheel_kernel import (
    MIN_V,
    REST_M_S,
    Loop,
    WheelControlState,
    control,
    release,
)

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel


PERIOD_S = 0.01


@dataclass(frozen=True, slots=True)
class WheelGains:
    """Control gains in duty per m/s; the feed-forward is for the drive motors at 16 V."""

    feed_forward: float = 2.12
    friction: float = 0.15
    """Duty that overcomes the voltage drop of the bridge and the friction."""
    proportional: float = 1.6
    integral_s: float = 12.0
    integral_limit: float = 0.5


class WheelControl:
    """Controls both wheels so that the body follows a velocity within the acceleration limit."""

    def __init__(
        self, model: RobotModel, stop_decel_m_s2: float, gains: WheelGains | None = None
    ) -> None:
        gains = gains or WheelGains()
        self.left = WheelControlState(model.left_metres_per_count / PERIOD_S)
        self.right = WheelControlState(model.right_metres_per_count / PERIOD_S)
        self._loop = loop = Loop(self.left, self.right)
        loop.feed_forward, loop.friction = gains.feed_forward, gains.friction
        loop.proportional, loop.integral_limit = gains.proportional, gains.integral_limit
        loop.integral_gain = gains.integral_s * PERIOD_S
        loop.half_base_m = self._half_base_m = 0.5 * model.wheel_base_m
        self.stalling = False
        """True if a wheel with a duty does not turn."""
        self.limit(model, stop_decel_m_s2)

    def limit(self, model: RobotModel, stop_decel_m_s2: float) -> None:
        """Set new limits; the state of the wheels does not change."""
        loop = self._loop
        loop.v_max, loop.yaw_max = model.max_speed_m_s, model.max_yaw_rate_rad_s
        loop.v_step = stop_decel_m_s2 * PERIOD_S
        loop.yaw_step = loop.v_step / self._half_base_m

    def coast(self, counts: tuple[int, int], duties: tuple[float, float]) -> None:
        """Run one period in which other code sets the duties: only measure the wheel speeds."""
        loop = self._loop
        control(loop, 0.0, 0.0, *counts, MIN_V)  # only for its measurement
        loop.v = loop.yaw = 0.0
        for wheel, duty in zip((self.left, self.right), duties, strict=True):
            wheel.integral = wheel.stalled = 0.0
            wheel.duty = duty
        self.stalling = False

    def release(self, counts: tuple[int, int]) -> tuple[float, float]:
        """Run a period of the safe state: duties fall to 0 open loop, then the motors brake."""
        self.stalling = False
        return release(self._loop, *counts)

    def step(
        self, v_m_s: float, yaw_rate_rad_s: float, counts: tuple[int, int], supply_v: float
    ) -> tuple[float, float]:
        """Run one 10 ms period with new encoder counts; return left and right duty."""
        left_count, right_count = counts
        left, right, self.stalling = control(
            self._loop, v_m_s, yaw_rate_rad_s, left_count, right_count, supply_v
        )
        return left, right

    @property
    def yaw_rate_rad_s(self) -> float:
        """Yaw rate computed from the wheels, rad/s, counter-clockwise."""
        return (self.right.speed_m_s - self.left.speed_m_s) * 0.5 / self._half_base_m

    @property
    def moving(self) -> bool:
        """True if a wheel turns, according to its counts."""
        return max(abs(self.left.speed_m_s), abs(self.right.speed_m_s)) >= REST_M_S

    @property
    def stalled_s(self) -> float:
        """Time for which a driven wheel has not turned, s."""
        return max(self.left.stalled_s, self.right.stalled_s)
