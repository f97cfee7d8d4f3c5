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
NOMINAL_V = 16.0
"""Supply for which the gains are given; duties are scaled to the one measured."""
LEAST_V = 8.0
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

    __slots__ = (
        "_count",
        "_feed_forward",
        "_friction",
        "_integral",
        "_integral_gain",
        "_integral_limit",
        "_proportional",
        "_speed_per_count",
        "speed_m_s",
        "stalled_s",
    )

    def __init__(self, metres_per_count: float, gains: WheelGains) -> None:
        self.speed_m_s = 0.0
        self.stalled_s = 0.0
        """How long it has been driven and has not turned."""
        self._speed_per_count = metres_per_count / PERIOD_S
        self._feed_forward, self._friction = gains.feed_forward, gains.friction
        self._proportional = gains.proportional
        self._integral_gain = gains.integral_s * PERIOD_S
        self._integral_limit = gains.integral_limit
        self._count: int | None = None
        self._integral = 0.0

    def measure(self, count: int) -> None:
        """Take an absolute 16-bit count, one per period."""
        before = self._count
        if before is not None:
            delta = (count - before + _HALF_WRAP & _MASK) - _HALF_WRAP
            # One count a period is 13 mm/s: average two periods.
            self.speed_m_s += 0.5 * (delta * self._speed_per_count - self.speed_m_s)
        self._count = count

    def let_go(self) -> None:
        """Forget what was wanted and what came of it."""
        self._integral = self.stalled_s = 0.0

    def duty(self, count: int, target_m_s: float, scale: float) -> float:
        """Duty for the next period; exactly 0 where the wheel should rest and does.

        ``count`` is as for ``measure``, which this does first; ``scale`` is the nominal supply
        over the present one.
        """
        before, speed = self._count, self.speed_m_s
        if before is not None:  # as measure: each period, twice, and a call costs as much
            delta = (count - before + _HALF_WRAP & _MASK) - _HALF_WRAP
            speed += 0.5 * (delta * self._speed_per_count - speed)
            self.speed_m_s = speed
        self._count = count
        if target_m_s > 0.0:
            base, far = self._feed_forward * target_m_s + self._friction, target_m_s
        elif target_m_s < 0.0:
            base, far = self._feed_forward * target_m_s - self._friction, -target_m_s
        elif -REST_M_S < speed < REST_M_S:
            self._integral = self.stalled_s = 0.0
            return 0.0
        else:
            base = far = 0.0
        if far > STALL_TARGET_M_S and -0.1 * far < speed < 0.1 * far:
            self.stalled_s += PERIOD_S
        else:
            self.stalled_s = 0.0
        error = target_m_s - speed
        limit = self._integral_limit
        integral = self._integral + self._integral_gain * error
        if integral > limit:
            integral = limit
        elif integral < -limit:
            integral = -limit
        self._integral = integral
        duty = (base + integral + self._proportional * error) * scale
        if duty > 1.0:
            return 1.0
        return duty if duty > -1.0 else -1.0  # noqa: FURB136 - each period, twice: no call


class WheelControl:
    """Both wheels, following a body velocity within the acceleration limit."""

    def __init__(
        self, model: RobotModel, stop_decel_m_s2: float, gains: WheelGains | None = None
    ) -> None:
        gains = gains or WheelGains()
        self.left = Wheel(model.metres_per_count, gains)
        self.right = Wheel(model.metres_per_count, gains)
        self._half_base_m = 0.5 * model.wheel_base_m
        self._v = 0.0
        self._yaw = 0.0
        self.limit(model, stop_decel_m_s2)

    def limit(self, model: RobotModel, stop_decel_m_s2: float) -> None:
        """Keep to other limits from now on; wheels and counts stay those of the boot."""
        self._v_max, self._yaw_max = model.max_speed_m_s, model.max_yaw_rate_rad_s
        self._v_step = stop_decel_m_s2 * PERIOD_S
        self._yaw_step = self._v_step / self._half_base_m
        self._limited = True

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
        left_count, right_count = counts
        v, yaw = self._v, self._yaw
        if v_m_s != v or yaw_rate_rad_s != yaw or self._limited:
            v = self._v = _towards(v, _clamp(v_m_s, self._v_max), self._v_step)
            wanted = _clamp(yaw_rate_rad_s, self._yaw_max)
            yaw = self._yaw = _towards(yaw, wanted, self._yaw_step)
            self._limited = False
        turn = self._half_base_m * yaw
        scale = NOMINAL_V / (supply_v if supply_v > LEAST_V else LEAST_V)  # noqa: FURB136 - no call
        return (
            self.left.duty(left_count, v - turn, scale),
            self.right.duty(right_count, v + turn, scale),
        )

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


def _clamp(value: float, limit: float) -> float:
    if value > limit:
        return limit
    return value if value > -limit else -limit  # noqa: FURB136 - each period: no call


def _towards(value: float, wanted: float, step: float) -> float:
    """``wanted``, or as near to it as one step comes."""
    if wanted > value + step:
        return value + step
    return max(value - step, wanted)
