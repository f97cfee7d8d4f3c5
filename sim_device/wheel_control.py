"""Wheel speed control from encoder counts: ramp, feed-forward and PI, at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

PERIOD_S = 0.01
STALL_S = 1.0
STALL_TARGET_M_S = 0.03
REST_M_S = 0.005
"""Below one count a period: a wheel that is measured slower than this stands."""
_HALF_WRAP = 1 << 15
_MASK = 0xFFFF


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
    """One wheel: measures its speed, holds the speed wanted."""

    def __init__(self, metres_per_count: float, gains: WheelGains) -> None:
        self.speed_m_s = 0.0
        self.target_m_s = 0.0
        self.stalled_s = 0.0
        self._metres_per_count = metres_per_count
        self._gains = gains
        self._count: int | None = None
        self._integral = 0.0

    def measure(self, count: int) -> None:
        """Take an absolute 16-bit count, one per period."""
        if self._count is not None:
            delta = (count - self._count + _HALF_WRAP & _MASK) - _HALF_WRAP
            raw = delta * self._metres_per_count / PERIOD_S
            # One count a period is 13 mm/s: average two periods.
            self.speed_m_s += 0.5 * (raw - self.speed_m_s)
        self._count = count

    def let_go(self) -> None:
        """Forget what was wanted and what came of it."""
        self.target_m_s = self._integral = self.stalled_s = 0.0

    def duty(self, supply_v: float) -> float:
        """Duty for the next period; exactly 0 where the wheel should rest and does."""
        gains, target = self._gains, self.target_m_s
        error = target - self.speed_m_s
        if target == 0.0 and abs(self.speed_m_s) < REST_M_S:
            self.let_go()
            return 0.0
        stalled = abs(target) > STALL_TARGET_M_S and abs(self.speed_m_s) < 0.1 * abs(target)
        self.stalled_s = self.stalled_s + PERIOD_S if stalled else 0.0
        limit = gains.integral_limit
        step = gains.integral_s * error * PERIOD_S
        self._integral = min(limit, max(-limit, self._integral + step))
        base = gains.feed_forward * target
        if target:
            base += gains.friction if target > 0 else -gains.friction
        duty = (base + self._integral + gains.proportional * error) * 16.0 / max(supply_v, 8.0)
        return min(1.0, max(-1.0, duty))


class WheelControl:
    """Both wheels, following a body velocity within the acceleration limit."""

    def __init__(
        self, model: RobotModel, stop_decel_m_s2: float, gains: WheelGains | None = None
    ) -> None:
        self._model = model
        self._decel_m_s2 = stop_decel_m_s2
        gains = gains or WheelGains()
        self.left = Wheel(model.metres_per_count, gains)
        self.right = Wheel(model.metres_per_count, gains)
        self._v = 0.0
        self._yaw = 0.0

    def limit(self, model: RobotModel, stop_decel_m_s2: float) -> None:
        """Keep to other limits from now on; wheels and counts stay those of the boot."""
        self._model = model
        self._decel_m_s2 = stop_decel_m_s2

    def coast(self, counts: tuple[int, int]) -> None:
        """One period in which somebody else gives the duties."""
        self.left.measure(counts[0])
        self.right.measure(counts[1])
        self.left.let_go()
        self.right.let_go()
        self._v = self._yaw = 0.0

    def step(
        self, v_m_s: float, yaw_rate_rad_s: float, counts: tuple[int, int], supply_v: float
    ) -> tuple[float, float]:
        """One 10 ms period: counts in, left and right duty out."""
        model = self._model
        self.left.measure(counts[0])
        self.right.measure(counts[1])
        v_m_s = _clamp(v_m_s, model.max_speed_m_s)
        yaw_rate_rad_s = _clamp(yaw_rate_rad_s, model.max_yaw_rate_rad_s)
        self._v += _clamp(v_m_s - self._v, self._decel_m_s2 * PERIOD_S)
        yaw_step = 2.0 * self._decel_m_s2 / model.wheel_base_m * PERIOD_S
        self._yaw += _clamp(yaw_rate_rad_s - self._yaw, yaw_step)
        self.left.target_m_s, self.right.target_m_s = model.wheel_speeds_m_s(self._v, self._yaw)
        return self.left.duty(supply_v), self.right.duty(supply_v)

    @property
    def moving(self) -> bool:
        """True where a wheel is measured to turn."""
        return max(abs(self.left.speed_m_s), abs(self.right.speed_m_s)) >= REST_M_S

    @property
    def stalled(self) -> bool:
        """True where a driven wheel has not turned for a second."""
        return max(self.left.stalled_s, self.right.stalled_s) >= STALL_S


def _clamp(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))
