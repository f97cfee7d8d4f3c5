"""The firmware's wheel control, compiled: ramp, feed-forward and PI of both wheels.

The array is float64 and laid out by the constants here; what belongs to a wheel comes in
pairs, left first. Every callee stands in this file, and nothing is allocated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

PERIODS_A_SECOND = 100.0
STALL_TARGET_M_S = 0.03
REST_M_S = 0.005
"""Below one count a period: a wheel that is measured slower than this stands."""
LEAST_TARGET_M_S = 1e-5
"""A tenth of the wire's step: what is slower is the rounding of a wheel that should rest."""
NOMINAL_V = 16.0
"""Supply for which the gains are given; duties are scaled to the one measured."""
LEAST_V = 8.0
NO_COUNT = -1.0
_HALF_WRAP = 1 << 15
_MASK = 0xFFFF

(FEED_FORWARD, FRICTION, PROPORTIONAL, INTEGRAL_GAIN, INTEGRAL_LIMIT) = range(5)
(HALF_BASE_M, V_MAX, YAW_MAX, V_STEP, YAW_STEP) = range(5, 10)
"""Gains, and limits of the body's velocity and of its change in a period."""
(V, YAW, SPEED_PER_COUNT, COUNT, INTEGRAL, SPEED, STALLED) = (10, 11, 12, 14, 16, 18, 20)
"""The ramp; then per wheel what a count a period is (m/s), its last count, the integral, the
speed measured (m/s), and for how many periods it has been driven and has not turned."""
SIZE = 22


@compiled
def _measure(w: Floats, left_count: int, right_count: int) -> None:
    """Take both absolute 16-bit counts, once a period."""
    for side in range(2):
        count = left_count if side == 0 else right_count
        before = w[COUNT + side]
        if before != NO_COUNT:
            delta = ((count - int(before) + _HALF_WRAP) & _MASK) - _HALF_WRAP
            # One count a period is 13 mm/s: average two periods.
            w[SPEED + side] += 0.5 * (delta * w[SPEED_PER_COUNT + side] - w[SPEED + side])
        w[COUNT + side] = count


@compiled
def _towards(value: float, wanted: float, step: float, limit: float) -> float:
    """``wanted``, limited, or as near to it as one step comes."""
    wanted = max(-limit, min(limit, wanted))
    return value + step if wanted > value + step else max(value - step, wanted)


@compiled
def _duty(w: Floats, side: int, target: float, scale: float) -> float:
    """Duty for the next period; exactly 0 where the wheel should rest and does."""
    speed = w[SPEED + side]
    base = far = 0.0
    if target > LEAST_TARGET_M_S:
        base, far = w[FEED_FORWARD] * target + w[FRICTION], target
    elif target < -LEAST_TARGET_M_S:
        base, far = w[FEED_FORWARD] * target - w[FRICTION], -target
    elif -REST_M_S < speed < REST_M_S:
        w[INTEGRAL + side] = w[STALLED + side] = 0.0
        return 0.0
    if far > STALL_TARGET_M_S and -0.1 * far < speed < 0.1 * far:
        w[STALLED + side] += 1.0
    else:
        w[STALLED + side] = 0.0
    error, limit = target - speed, w[INTEGRAL_LIMIT]
    integral = max(-limit, min(limit, w[INTEGRAL + side] + w[INTEGRAL_GAIN] * error))
    w[INTEGRAL + side] = integral
    duty: float = (base + integral + w[PROPORTIONAL] * error) * scale
    return max(-1.0, min(1.0, duty))


@compiled
def control(  # noqa: PLR0913, PLR0917 - positional, as kernels are called
    w: Floats, v: float, yaw: float, left_count: int, right_count: int, supply_v: float
) -> tuple[float, float, bool]:
    """One period: body velocity wanted (m/s, rad/s), counts and supply in; duties out.

    Returns:
        Left and right duty, and whether a driven wheel does not turn.

    """
    _measure(w, left_count, right_count)
    w[V] = _towards(w[V], v, w[V_STEP], w[V_MAX])
    w[YAW] = _towards(w[YAW], yaw, w[YAW_STEP], w[YAW_MAX])
    turn = w[HALF_BASE_M] * w[YAW]
    scale = NOMINAL_V / max(supply_v, LEAST_V)
    left = _duty(w, 0, w[V] - turn, scale)
    right = _duty(w, 1, w[V] + turn, scale)
    return left, right, w[STALLED] > 0.0 or w[STALLED + 1] > 0.0
