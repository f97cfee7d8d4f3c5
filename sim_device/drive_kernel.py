"""The inner loop of the plant: wheels and pose on free floor, one millisecond at a time.

A pure function of floats, so that a compiled kernel can take its place as it is.
"""

from __future__ import annotations

from math import cos, sin
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_device.motors import MotorParameters

TICK_S = 0.001


class WheelStep(NamedTuple):
    """What does not change while the duty, the supply and the slip do not."""

    decay: float
    """1 - exp(-tick/τ)."""
    tau_s: float
    left_m: float
    """Half of the left wheel's travel over the floor per radian, slip taken off."""
    right_m: float
    left_yaw: float
    """Yaw per radian of the left wheel (to be taken off), slip taken off."""
    right_yaw: float


class Rolling(NamedTuple):
    """The part of the state that changes on free floor."""

    left_rad_s: float
    right_rad_s: float
    left_rad: float
    """Wheel angle, continuous."""
    right_rad: float
    x_m: float
    y_m: float
    theta_rad: float
    """Heading, continuous (not wrapped)."""
    sway_m_rad: float
    """Σ ds·dθ; over the tick it is the lateral velocity that turning takes up."""
    path_m: float


def roll_free(
    ticks: int,
    state: Rolling,
    step: WheelStep,
    target_left_rad_s: float,
    target_right_rad_s: float,
) -> Rolling:
    """Advance by ``ticks`` milliseconds with no wall in reach and no wheel passing rest.

    Wheel speed and angle are exact (a first-order lag towards a constant); the pose takes the
    midpoint heading of each millisecond, a chord shorter than its arc by less than 2·10⁻⁷ at
    2 rad/s.
    """
    wl, wr, al, ar, x, y, th, sway, path = state
    decay, tau, cl, cr, yl, yr = step
    tl, tr = target_left_rad_s, target_right_rad_s
    tl_tick, tr_tick = tl * TICK_S, tr * TICK_S
    for _ in range(ticks):
        dl = (tl - wl) * decay
        dr = (tr - wr) * decay
        wl += dl
        wr += dr
        il = tl_tick - dl * tau
        ir = tr_tick - dr * tau
        al += il
        ar += ir
        ds = cl * il + cr * ir
        dth = yr * ir - yl * il
        mid = th + 0.5 * dth
        x += ds * cos(mid)
        y += ds * sin(mid)
        th += dth
        sway += ds * dth
        path += ds if ds > 0.0 else -ds
    return Rolling(wl, wr, al, ar, x, y, th, sway, path)


def turn_wheel(  # noqa: PLR0913, PLR0917 - positional because it is called each millisecond
    motor: MotorParameters,
    rad_s: float,
    terminal_v: float,
    drag_v: float,
    decay: float,
    tau_s: float,
) -> tuple[float, float]:
    """Advance one wheel by a millisecond that may take it past rest.

    Returns:
        Its speed after (rad/s) and the angle it turned (rad): where it does not pass rest,
        the same floats as in ``roll_free``.

    """
    target = motor.target_rad_s(terminal_v, rad_s, drag_v)
    change = (target - rad_s) * decay
    after = rad_s + change
    if after * rad_s < 0.0:  # friction holds it at rest until a voltage moves it again
        return 0.0, 0.5 * TICK_S * rad_s
    return after, target * TICK_S - change * tau_s
