"""The firmware's wheel control, compiled: ramp, feed-forward and PI of both wheels."""

from __future__ import annotations

import cython

REST_M_S = 0.005
"""Maximum measured speed of a standing wheel, m/s. It is less than one count per period."""
MIN_V = 8.0
"""Minimum supply voltage that duties are scaled to, V."""

_PERIODS_A_SECOND = cython.declare(cython.double, 100.0)
_REST_M_S = cython.declare(cython.double, REST_M_S)
_MIN_V = cython.declare(cython.double, MIN_V)
_NO_COUNT = cython.declare(cython.int, -1)
_STALL_TARGET_M_S = cython.declare(cython.double, 0.03)
_MIN_TARGET_M_S = cython.declare(cython.double, 1e-5)
"""Minimum target speed of a wheel, m/s: a tenth of the resolution of a velocity setpoint. A smaller
target is a rounding error of zero."""
_RELEASE_PERIODS = cython.declare(cython.double, 8.0)
"""Number of periods in which the duty falls to 0 in the safe state, in addition to the ramp's time.
The limit of 0.1 s includes the first period and rounding."""
_NOMINAL_V = cython.declare(cython.double, 16.0)
"""Supply voltage that the gains refer to, V; duties are scaled to the measured voltage."""
_HALF_WRAP = cython.declare(cython.int, 1 << 15)
_MASK = cython.declare(cython.int, 0xFFFF)


@cython.final
@cython.cclass
class WheelControlState:
    """Measurement and control state of one wheel."""

    m_s_per_count = cython.declare(cython.double, visibility="public")
    """Wheel speed at one count per period, m/s."""
    count = cython.declare(cython.int, visibility="public")
    """Last encoder count, 16 bits; -1 before the first count."""
    integral = cython.declare(cython.double, visibility="public")
    speed_m_s = cython.declare(cython.double, visibility="public")
    """Measured forward speed, m/s."""
    stalled = cython.declare(cython.double, visibility="public")
    """Number of periods for which the wheel has been driven without turning."""
    duty = cython.declare(cython.double, visibility="public")
    """Duty in the last period."""
    fall = cython.declare(cython.double, visibility="public")
    """Decrease of the duty per period in the safe state."""

    def __init__(self, m_s_per_count: cython.double) -> None:
        """Start at rest, before the first encoder count."""
        self.m_s_per_count = m_s_per_count
        self.count = _NO_COUNT
        self.integral = self.speed_m_s = self.stalled = self.duty = self.fall = 0.0

    @property
    def stalled_s(self) -> float:
        """Return the time for which the wheel has been driven without turning, s."""
        return self.stalled / _PERIODS_A_SECOND


@cython.final
@cython.cclass
class Loop:
    """Gains and limits, both wheels, and the ramp of the body velocity."""

    left = cython.declare(WheelControlState, visibility="public")
    right = cython.declare(WheelControlState, visibility="public")
    feed_forward = cython.declare(cython.double, visibility="public")
    """Feed-forward gain, duty per m/s; the other gains have the same unit."""
    friction = cython.declare(cython.double, visibility="public")
    """Duty that overcomes friction."""
    proportional = cython.declare(cython.double, visibility="public")
    integral_gain = cython.declare(cython.double, visibility="public")
    """Integral gain per period."""
    integral_limit = cython.declare(cython.double, visibility="public")
    half_base_m = cython.declare(cython.double, visibility="public")
    v_max = cython.declare(cython.double, visibility="public")
    """Maximum body speed, m/s. ``yaw_max``: maximum yaw rate, rad/s."""
    yaw_max = cython.declare(cython.double, visibility="public")
    v_step = cython.declare(cython.double, visibility="public")
    """Maximum change of the speed per period, m/s. ``yaw_step``: maximum change of the yaw rate,
    rad/s."""
    yaw_step = cython.declare(cython.double, visibility="public")
    v = cython.declare(cython.double, visibility="public")
    """Present speed of the ramp, m/s. ``yaw``: present yaw rate of the ramp, rad/s."""
    yaw = cython.declare(cython.double, visibility="public")
    released = cython.declare(cython.bint, visibility="public")
    """True if the last period was in the safe state."""

    def __init__(self, left: WheelControlState, right: WheelControlState) -> None:
        """Create the control of both wheels; the caller sets gains and limits."""
        self.left, self.right = left, right
        self.feed_forward = self.friction = self.proportional = 0.0
        self.integral_gain = self.integral_limit = self.half_base_m = 0.0
        self.v_max = self.yaw_max = self.v_step = self.yaw_step = self.v = self.yaw = 0.0
        self.released = False


@cython.cfunc
@cython.exceptval(check=False)
def _measure(wheel: WheelControlState, count: cython.int) -> cython.void:
    """Measure the speed from an absolute 16-bit count; call once per period."""
    if wheel.count != _NO_COUNT:
        delta = ((count - wheel.count + _HALF_WRAP) & _MASK) - _HALF_WRAP
        # One count per period is 13 mm/s, a coarse step, so average two periods.
        wheel.speed_m_s += 0.5 * (delta * wheel.m_s_per_count - wheel.speed_m_s)
    wheel.count = count


@cython.cfunc
@cython.exceptval(check=False)
def _towards(
    value: cython.double, wanted: cython.double, step: cython.double, limit: cython.double
) -> cython.double:
    """Move a value towards ``wanted`` by at most one step, within the limit."""
    wanted = max(-limit, min(limit, wanted))
    return value + step if wanted > value + step else max(value - step, wanted)


@cython.cfunc
@cython.exceptval(check=False)
def _duty(
    loop: Loop, wheel: WheelControlState, target: cython.double, scale: cython.double
) -> cython.double:
    """Return the duty for the next period; exactly 0 if the wheel's target is rest and it rests."""
    speed = wheel.speed_m_s
    base = far = 0.0
    if target > _MIN_TARGET_M_S:
        base, far = loop.feed_forward * target + loop.friction, target
    elif target < -_MIN_TARGET_M_S:
        base, far = loop.feed_forward * target - loop.friction, -target
    elif -_REST_M_S < speed < _REST_M_S:
        wheel.integral = wheel.stalled = 0.0
        return 0.0
    if far > _STALL_TARGET_M_S and -0.1 * far < speed < 0.1 * far:
        wheel.stalled += 1.0
    else:
        wheel.stalled = 0.0
    error, limit = target - speed, loop.integral_limit
    integral = max(-limit, min(limit, wheel.integral + loop.integral_gain * error))
    wheel.integral = integral
    duty = (base + integral + loop.proportional * error) * scale
    return max(-1.0, min(1.0, duty))


def control(  # noqa: PLR0913, PLR0917 - positional, because it is called very often
    loop: Loop,
    v: cython.double,
    yaw: cython.double,
    left_count: cython.int,
    right_count: cython.int,
    supply_v: cython.double,
) -> tuple[float, float, bool]:
    """Run one period with body velocity (m/s, rad/s), counts and supply; return duties.

    Returns:
        Left and right duty, and whether a driven wheel does not turn.

    """
    _measure(loop.left, left_count)
    _measure(loop.right, right_count)
    loop.v = _towards(loop.v, v, loop.v_step, loop.v_max)
    loop.yaw = _towards(loop.yaw, yaw, loop.yaw_step, loop.yaw_max)
    turn = loop.half_base_m * loop.yaw
    scale = _NOMINAL_V / max(supply_v, _MIN_V)
    left = loop.left.duty = _duty(loop, loop.left, loop.v - turn, scale)
    right = loop.right.duty = _duty(loop, loop.right, loop.v + turn, scale)
    loop.released = False
    return left, right, loop.left.stalled > 0.0 or loop.right.stalled > 0.0


@cython.cfunc
@cython.exceptval(check=False)
def _let_fall(loop: Loop, wheel: WheelControlState, target: cython.double) -> cython.double:
    """Return a reduced duty in the safe state; ``target`` is the wheel's last ramp value."""
    if not loop.released:
        periods = max(target, -target) / loop.v_step + _RELEASE_PERIODS
        wheel.fall = max(wheel.duty, -wheel.duty) / periods
    wheel.integral = wheel.stalled = 0.0
    wheel.duty = _towards(wheel.duty, 0.0, wheel.fall, 1.0)
    return wheel.duty


def release(loop: Loop, left_count: cython.int, right_count: cython.int) -> tuple[float, float]:
    """Run one period of the safe state: duties only decrease, for any encoder counts.

    Returns:
        Left and right duty.

    """
    _measure(loop.left, left_count)
    _measure(loop.right, right_count)
    turn = loop.half_base_m * loop.yaw
    left = _let_fall(loop, loop.left, loop.v - turn)
    right = _let_fall(loop, loop.right, loop.v + turn)
    loop.v = _towards(loop.v, 0.0, loop.v_step, loop.v_max)
    loop.yaw = _towards(loop.yaw, 0.0, loop.yaw_step, loop.yaw_max)
    loop.released = True
    return left, right
