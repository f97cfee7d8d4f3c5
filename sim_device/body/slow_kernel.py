"""What changes slowly in the plant, compiled: the battery, and how the wheels slip.

It works on the body of ``drive_kernel``, whose places it names as ``k``. Every callee stands in
this file, and nothing is allocated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled
from sim_device.body import drive_kernel as k
from sim_device.body.drive_kernel import TICK_S
from sim_device.body.power import RAIL_WHOLE_V

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Felt = tuple[float, float, float, float, float, float, float, float]

SLOW_MS = 10
"""Period of what changes slowly."""
_SECONDS_PER_HOUR = 3600.0


@compiled
def sag(b: Floats) -> None:
    """Work out the battery's voltage at its charge and current, as ``power`` tells."""
    charge = b[k.CHARGE_AH] / b[k.CAPACITY_AH]
    ohm = b[k.OHM]
    open_v = b[k.FULL_V] * (b[k.EMPTY_RATIO] + (1.0 - b[k.EMPTY_RATIO]) * charge)
    if charge < b[k.KNEE]:
        depth = 1.0 - charge / b[k.KNEE]
        open_v *= 1.0 - b[k.KNEE_FALL] * depth
        ohm *= 1.0 + b[k.KNEE_OHM] * depth
    supply_v = open_v - b[k.CURRENT_A] * ohm
    if supply_v < 0.0 or charge == 0.0:
        supply_v = 0.0
    b[k.OPEN_V], b[k.SUPPLY_V] = open_v, supply_v
    if supply_v >= RAIL_WHOLE_V:
        b[k.ELECTRONICS_A] = b[k.ELECTRONICS_W] / supply_v
    else:  # the rail's load takes less
        b[k.ELECTRONICS_A] = b[k.ELECTRONICS_W] / RAIL_WHOLE_V if supply_v > 0.0 else 0.0


@compiled
def settle(b: Floats) -> None:
    """Let the battery feel what was drawn since the last time.

    Its voltage was constant meanwhile: it follows the current of the time before.
    """
    duration_s = (b[k.TICK] - b[k.SETTLED_MS]) * TICK_S
    if duration_s > 0.0:
        electronics_c = b[k.ELECTRONICS_A] * duration_s
        b[k.ELECTRONICS_J] += electronics_c * b[k.SUPPLY_V]
        charge_c = b[k.DRAWN_C] - b[k.SETTLED_C] + electronics_c
        b[k.BATTERY_J] += charge_c * b[k.SUPPLY_V]
        b[k.INTERNAL_J] += charge_c * (b[k.OPEN_V] - b[k.SUPPLY_V])
        b[k.CURRENT_A] = charge_c / duration_s
        b[k.CHARGE_AH] = max(0.0, b[k.CHARGE_AH] - charge_c / _SECONDS_PER_HOUR)
        b[k.SETTLED_MS], b[k.SETTLED_C] = b[k.TICK], b[k.DRAWN_C]
    sag(b)


@compiled
def tread(b: Floats) -> None:
    """Work out what a radian of each wheel is worth on the floor, slip taken off."""
    left = b[k.UNSLIPPED] - b[k.SLIP_L] - b[k.CARPET_L] - b[k.EXTRA_L]
    right = b[k.UNSLIPPED] - b[k.SLIP_R] - b[k.CARPET_R] - b[k.EXTRA_R]
    left_m = b[k.RADIUS_L] * left if left > 0.0 else 0.0
    right_m = b[k.RADIUS_R] * right if right > 0.0 else 0.0
    b[k.TRAVEL_L], b[k.TRAVEL_R] = 0.5 * left_m, 0.5 * right_m
    b[k.YAW_L], b[k.YAW_R] = left_m / b[k.WHEEL_BASE], right_m / b[k.WHEEL_BASE]


@compiled
def felt(b: Floats) -> Felt:
    """Give what is asked for each time.

    Returns:
        Place and heading, both wheels' angles, the specific impulses ahead and to the left as
        ``Truth`` has them, and the battery's voltage.

    """
    v, lateral = b[k.TRAVEL_L] * b[k.GRIP_L] + b[k.TRAVEL_R] * b[k.GRIP_R], 0.0
    if b[k.TOUCHES] != 0.0:
        v, lateral = b[k.SLIDE_V], b[k.SLIDE_LATERAL]
    return (
        b[k.X],
        b[k.Y],
        b[k.THETA],
        b[k.ANGLE_L],
        b[k.ANGLE_R],
        v - b[k.SLIDE_SWAY] / TICK_S + b[k.GRAVITY_X],
        lateral + b[k.SWAY] / TICK_S + b[k.GRAVITY_Y],
        b[k.SUPPLY_V],
    )


@compiled
def renew(b: Floats, w: Floats) -> Felt:
    """Let the battery feel the last ``SLOW_MS`` and the slip wander; gives what ``felt`` does.

    Args:
        b: The body; changed.
        w: The room to work in; two of its draws are taken while the wheels slip.

    """
    settle(b)
    if b[k.WANDERS] > 0.0 and b[k.SLIP_KICK] > 0.0:
        at = k.SLIPS + int(b[k.SLIP_AT])
        b[k.SLIP_L] += b[k.SLIP_KICK] * w[at] - b[k.SLIP_FADE] * b[k.SLIP_L]
        b[k.SLIP_R] += b[k.SLIP_KICK] * w[at + 1] - b[k.SLIP_FADE] * b[k.SLIP_R]
        b[k.SLIP_AT] += 2.0
        tread(b)
    return felt(b)
