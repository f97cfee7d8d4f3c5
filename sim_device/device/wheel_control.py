"""Wheel speed control from encoder counts: ramp, feed-forward and PI, at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_device.device import wheel_kernel as k
from sim_device.device.wheel_kernel import LEAST_V, PERIODS_A_SECOND, REST_M_S, control

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel


PERIOD_S = 0.01


@dataclass(frozen=True, slots=True)
class WheelGains:
    """Gains in duty per m/s; the feed-forward is that of the drive motors at 16 V."""

    feed_forward: float = 2.12
    friction: float = 0.15
    """Duty that overcomes the bridge's drop and the friction."""
    proportional: float = 1.6
    integral_s: float = 12.0
    integral_limit: float = 0.5


class Wheel:
    """One wheel, as it is measured."""

    __slots__ = ("_side", "_w")

    def __init__(self, w: NDArray[np.float64], side: int) -> None:
        self._w, self._side = w, side

    @property
    def speed_m_s(self) -> float:
        """Forwards."""
        return float(self._w[k.SPEED + self._side])

    @property
    def stalled_s(self) -> float:
        """How long it has been driven and has not turned."""
        return float(self._w[k.STALLED + self._side] / PERIODS_A_SECOND)


class WheelControl:
    """Both wheels, following a body velocity within the acceleration limit."""

    def __init__(
        self, model: RobotModel, stop_decel_m_s2: float, gains: WheelGains | None = None
    ) -> None:
        gains = gains or WheelGains()
        self._w = w = np.zeros(k.SIZE)
        w[k.SPEED_PER_COUNT] = model.left_metres_per_count / PERIOD_S
        w[k.SPEED_PER_COUNT + 1] = model.right_metres_per_count / PERIOD_S
        w[k.FEED_FORWARD], w[k.FRICTION] = gains.feed_forward, gains.friction
        w[k.PROPORTIONAL], w[k.INTEGRAL_LIMIT] = gains.proportional, gains.integral_limit
        w[k.INTEGRAL_GAIN] = gains.integral_s * PERIOD_S
        w[k.HALF_BASE_M] = self._half_base_m = 0.5 * model.wheel_base_m
        w[k.COUNT : k.COUNT + 2] = k.NO_COUNT
        self.left, self.right = Wheel(w, 0), Wheel(w, 1)
        self.stalling = False
        """Whether a driven wheel does not turn."""
        self.limit(model, stop_decel_m_s2)

    def limit(self, model: RobotModel, stop_decel_m_s2: float) -> None:
        """Keep to other limits from now on; wheels and counts stay those of the boot."""
        w = self._w
        w[k.V_MAX], w[k.YAW_MAX] = model.max_speed_m_s, model.max_yaw_rate_rad_s
        w[k.V_STEP] = stop_decel_m_s2 * PERIOD_S
        w[k.YAW_STEP] = w[k.V_STEP] / self._half_base_m

    def coast(self, counts: tuple[int, int]) -> None:
        """One period in which somebody else gives the duties."""
        w = self._w
        control(w, 0.0, 0.0, *counts, LEAST_V)  # for its measuring
        w[k.V] = w[k.YAW] = 0.0
        w[k.INTEGRAL : k.INTEGRAL + 2] = w[k.STALLED : k.STALLED + 2] = 0.0
        self.stalling = False

    def step(
        self, v_m_s: float, yaw_rate_rad_s: float, counts: tuple[int, int], supply_v: float
    ) -> tuple[float, float]:
        """One 10 ms period: counts in, left and right duty out."""
        left_count, right_count = counts
        left, right, self.stalling = control(
            self._w, v_m_s, yaw_rate_rad_s, left_count, right_count, supply_v
        )
        return left, right

    @property
    def yaw_rate_rad_s(self) -> float:
        """As the wheels turn, counter-clockwise."""
        return (self.right.speed_m_s - self.left.speed_m_s) * 0.5 / self._half_base_m

    @property
    def moving(self) -> bool:
        """True where a wheel is measured to turn."""
        return max(abs(self.left.speed_m_s), abs(self.right.speed_m_s)) >= REST_M_S

    @property
    def stalled_s(self) -> float:
        """How long a driven wheel has not turned."""
        return max(self.left.stalled_s, self.right.stalled_s)
