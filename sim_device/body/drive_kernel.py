"""The plant's kernel, compiled: wheels, pose and contact, a millisecond at a time.

``advance`` works on two float64 arrays: the body, whose places are named by the indices below,
and room to work in; it allocates nothing. Each millisecond depends only on the state before it,
so equal calls give equal floats however time is split; what is slow (battery, slip) is renewed
every tenth, by ``slow_kernel``. Every callee stands in this file: the kept code would notice no
change elsewhere. The models are told in ``plant`` and ``motors``.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled
from sim_device.body.power import BRIDGE_LOGIC_V, RAIL_DROPOUT_V

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

TICK_S = 0.001
TOUCH_M = 2e-5
"""A smaller gap is contact: far below any sensor, far above rounding."""
PENETRATION_M = 1e-9
"""The disc never sticks further into a wall than this (nor than the start did)."""
COLLISION_SPEED_M_S, REARM_MS = 0.03, 500.0
"""Slower onsets of contact are no collision; the next counts after this time free of it."""
WALKER = -1
"""In a row of touches, for an edge's index."""
_NEAR_M, _NEAR_MOVED_M = 0.35, 0.25
"""Edges within the radius and this are looked at; renewed as the robot has gone the other."""
_CAREFUL_M = 0.02
_PASSES, _HALVINGS = 12, 10
_SHOVE_M, _BOUNCE_S = 0.005, 0.05
"""A walker shoves no further at once, so never through a wall. A tyre that spins before a
threshold bounces on it; that dies out so fast."""

# The body: parameters of the parts, then those that the plant renews.
(TAU, DECAY, BACK_EMF, RESISTANCE, FRICTION_V, LOAD_V_N, BODY_RADIUS, WALL_FRICTION) = range(8)
(TRACTION_N, RAD_S_PER_N, CASTER_N, CASTER_X, WHEEL_BASE, RADIUS_L, RADIUS_R) = range(8, 15)
(FULL_V, CAPACITY_AH, EMPTY_RATIO, OHM, KNEE, KNEE_FALL, KNEE_OHM, DROP_V) = range(15, 23)
(ELECTRONICS_W, SLIP_KICK, SLIP_FADE, UNSLIPPED, EXTRA_L, EXTRA_R, SLOPE_N_L) = range(23, 30)
(SLOPE_N_R, CARPET_N_L, CARPET_N_R, CARPET_L, CARPET_R, TILT_X, TILT_Y) = range(30, 37)
(STUCK_L, STUCK_R, LIFTED, HELD, WANDERS) = range(37, 42)
"""SLIP: each 10 ms' kick and fade of the slip's share; UNSLIPPED: one less its mean. EXTRA,
CARPET: further shares lost. SLOPE: weight's push against a wheel, TILT: what the accelerometer
feels of it (m/s²). WANDERS: whether the wheels stand on a floor on which they slip."""

# What follows from them, and the state.
(TRAVEL_L, TRAVEL_R, YAW_L, YAW_R, DUTY_L, DUTY_R, VOLT_L, VOLT_R) = range(42, 50)
(TICK, SPEED_L, SPEED_R, ANGLE_L, ANGLE_R, GRIP_L, GRIP_R, X, Y, THETA, PATH) = range(50, 61)
(SWAY, SLIDE_SWAY, SLIDE_V, SLIDE_LATERAL, GRAVITY_X, GRAVITY_Y) = range(61, 67)
(DRAWN_C, BRIDGE_J, WINDING_J, SHAFT_J, SLIP_L, SLIP_R, SLIP_AT) = range(67, 74)
(NEAR_X, NEAR_Y, NEAR_COUNT, GAP, TOUCHES, DISTURBED, AT_X, AT_Y) = range(74, 82)
(COLLISIONS, CONTACT_MS, ARMED, LAST_MS) = range(82, 86)
(MAN_X, MAN_Y, MAN_R, MAN_VX, MAN_VY, MAN_MS) = range(86, 92)
(CHARGE_AH, CURRENT_A, SUPPLY_V, OPEN_V, BATTERY_J, INTERNAL_J) = range(92, 98)
(ELECTRONICS_A, ELECTRONICS_J, SETTLED_MS, SETTLED_C) = range(98, 102)
BODY = 102
"""TRAVEL: half of a wheel's travel over the floor per radian, YAW the turn, slip taken off.
GRIP: speed (rad/s) that the floor under a wheel sees, its own unless it spins. SWAY: Σ ds·dθ,
over a tick the lateral velocity that turning takes up. GRAVITY: impulse felt by tilt. SLIP_AT:
draws used of those in the room to work in. AT: where a move ends. SETTLED: when the battery
felt what was drawn, and how much that was (C)."""

# The room to work in.
MAX_TOUCHES = 16
SLIP_DRAWS = 512
KNOWN = 3 * MAX_TOUCHES
SLIPS = KNOWN + MAX_TOUCHES
NEAR = SLIPS + SLIP_DRAWS
"""From 0 rows of what is touched: edge, unit vector to the disc's centre; then what was touched
a millisecond before, standard normal draws for the slip, and an index for each edge near."""


@compiled
def switch(left: float, right: float, b: Floats) -> None:
    """Give the motors what the bridges make of the battery's voltage at these duties (-1..1)."""
    supply_v, drop_v = b[SUPPLY_V], b[DROP_V]
    if supply_v - RAIL_DROPOUT_V < BRIDGE_LOGIC_V:
        left = right = 0.0
    b[DUTY_L], b[DUTY_R] = left, right
    over_l, over_r = abs(left) * supply_v - drop_v, abs(right) * supply_v - drop_v
    b[VOLT_L] = 0.0 if over_l <= 0.0 else over_l if left > 0.0 else -over_l
    b[VOLT_R] = 0.0 if over_r <= 0.0 else over_r if right > 0.0 else -over_r


@compiled
def _turn(side: int, load_n: float, blocked_v: float, b: Floats) -> float:
    """Turn one wheel (0: left) by an exact first-order lag; gives by how much (rad).

    Friction holds it as it passes rest. What its motor took is booked; what a braking motor
    gives back, the bridge burns.
    """
    rad_s, volt, emf = b[SPEED_L + side], b[VOLT_L + side], b[BACK_EMF]
    after = turn = squared = 0.0
    if b[STUCK_L + side] == 0.0:
        net_v = volt - (b[SLOPE_N_L + side] + load_n) * b[LOAD_V_N]
        drag_v = b[FRICTION_V] + b[CARPET_N_L + side] * b[LOAD_V_N] + blocked_v
        target = 0.0
        if rad_s > 0.0 or (rad_s == 0.0 and net_v > drag_v):
            target = (net_v - drag_v) / emf
        elif rad_s < 0.0 or net_v < -drag_v:
            target = (net_v + drag_v) / emf
        decay, tau, above = b[DECAY], b[TAU], rad_s - target
        change = (target - rad_s) * decay
        after, turn = rad_s + change, target * TICK_S - change * tau
        squared = target * target * TICK_S + above * tau * (
            2.0 * target * decay + 0.5 * above * (1.0 - (1.0 - decay) * (1.0 - decay))
        )
        if after * rad_s < 0.0:
            after, turn = 0.0, 0.5 * TICK_S * rad_s
            squared = TICK_S * rad_s * rad_s / 3.0
    b[SPEED_L + side] = after
    b[ANGLE_L + side] += turn
    charge = (volt * TICK_S - emf * turn) / b[RESISTANCE]
    shaft = emf * (volt * turn - emf * squared) / b[RESISTANCE]
    drawn = max(0.0, b[DUTY_L + side] * charge)
    b[DRAWN_C] += drawn
    b[BRIDGE_J] += drawn * b[SUPPLY_V] - volt * charge
    b[WINDING_J] += volt * charge - shaft
    b[SHAFT_J] += shaft
    return turn


@compiled
def _offset(x: float, y: float, i: int, edges: Floats) -> tuple[float, float]:
    """Vector to a point from the closest one of an edge."""
    dx, dy = x - edges[i, 0], y - edges[i, 1]
    t = (dx * edges[i, 2] + dy * edges[i, 3]) * edges[i, 4]
    if t > 0.0:
        t = min(t, 1.0)
        dx -= t * edges[i, 2]
        dy -= t * edges[i, 3]
    return dx, dy


@compiled
def _measure_gap(b: Floats, edges: Floats, w: Floats) -> None:
    """Distance from the disc to what it could touch, exact when it is small."""
    gone = hypot(b[X] - b[NEAR_X], b[Y] - b[NEAR_Y])
    if not gone <= _NEAR_MOVED_M:
        gone, count, within = 0.0, 0, b[BODY_RADIUS] + _NEAR_M
        for i in range(edges.shape[0]):
            dx, dy = _offset(b[X], b[Y], i, edges)
            if dx * dx + dy * dy <= within * within:
                w[NEAR + count] = i
                count += 1
        b[NEAR_COUNT], b[NEAR_X], b[NEAR_Y] = count, b[X], b[Y]
    gap = _NEAR_M - gone
    for k in range(int(b[NEAR_COUNT])):
        dx, dy = _offset(b[X], b[Y], int(w[NEAR + k]), edges)
        gap = min(gap, sqrt(dx * dx + dy * dy) - b[BODY_RADIUS])
    if b[MAN_R] > 0.0:
        gap = min(gap, hypot(b[X] - b[MAN_X], b[Y] - b[MAN_Y]) - b[MAN_R] - b[BODY_RADIUS])
    b[GAP] = gap


@compiled
def _free(push: bool, b: Floats, edges: Floats, w: Floats) -> float:  # noqa: FBT001 - as told
    """Push the disc out of the walker, then of each edge in turn; gives the least gap met.

    Without ``push`` it only looks. For the gap only walls count: a walker is soft, and gives
    way in a wedge.
    """
    least, count = _CAREFUL_M, 0
    walker = b[MAN_R] > 0.0
    for k in range(int(b[NEAR_COUNT]) + walker):
        edge = WALKER if walker and k == 0 else int(w[NEAR + k - walker])
        if edge == WALKER:
            dx, dy = b[AT_X] - b[MAN_X], b[AT_Y] - b[MAN_Y]
            radius = b[BODY_RADIUS] + b[MAN_R]
        else:
            dx, dy = _offset(b[AT_X], b[AT_Y], edge, edges)
            radius = b[BODY_RADIUS]
        distance = sqrt(dx * dx + dy * dy)
        gap = distance - radius
        if gap < TOUCH_M and distance > 0.0:
            dx, dy = dx / distance, dy / distance
            if count < MAX_TOUCHES:
                w[3 * count], w[3 * count + 1], w[3 * count + 2] = edge, dx, dy
                count += 1
            if edge == WALKER:
                gap = max(gap, -_SHOVE_M)
            if push and gap < -PENETRATION_M:
                b[AT_X] -= gap * dx
                b[AT_Y] -= gap * dy
        if edge == WALKER:
            gap = max(gap, 0.0)
        least = min(least, gap)
    b[TOUCHES] = count
    return least


@compiled
def _settle(b: Floats, edges: Floats, w: Floats) -> bool:
    """Push the disc out of all that it is in; whether it is free then."""
    for _ in range(_PASSES):
        b[GAP] = _free(True, b, edges, w)  # noqa: FBT003 - positional, as kernels are called
        if b[GAP] >= -PENETRATION_M:
            return True
    return False


@compiled
def _move(dx: float, dy: float, b: Floats, edges: Floats, w: Floats) -> None:
    """Move the disc as far as the walls let it; ``AT`` gets where it ends.

    Walls touched take the part into them, and Coulomb's friction some of what is left.
    """
    blocked, count = 0.0, int(b[TOUCHES])
    for k in range(2 * count):  # twice: a corner's second wall may send it into the first
        nx, ny = w[3 * (k % count) + 1], w[3 * (k % count) + 2]
        into = dx * nx + dy * ny
        if into < 0.0:
            dx -= into * nx
            dy -= into * ny
            blocked -= into
    if blocked > 0.0:
        along = hypot(dx, dy)
        kept = along - b[WALL_FRICTION] * blocked
        wedged = False
        for k in range(count if count > 1 else 0):
            wedged = wedged or dx * w[3 * k + 1] + dy * w[3 * k + 2] < -PENETRATION_M
        if wedged or kept <= 0.0:
            dx = dy = 0.0
        else:
            dx, dy = dx * kept / along, dy * kept / along
    b[AT_X], b[AT_Y] = b[X] + dx, b[Y] + dy
    if _settle(b, edges, w):
        return
    # a wedge too narrow to go into: as far as its second side, which is touched then
    share, step, end_x, end_y = 0.0, 0.5, b[X], b[Y]
    for _ in range(_HALVINGS):
        b[AT_X], b[AT_Y] = b[X] + (share + step) * dx, b[Y] + (share + step) * dy
        if _settle(b, edges, w):
            share, end_x, end_y = share + step, b[AT_X], b[AT_Y]
        step *= 0.5
    b[AT_X], b[AT_Y] = end_x, end_y
    b[GAP] = _free(False, b, edges, w)  # noqa: FBT003 - positional, as kernels are called


@compiled
def _count_contact(vx: float, vy: float, known: int, b: Floats, w: Floats) -> None:
    """Count a millisecond in contact, and a collision where one began in it.

    That is a fast touch of an edge not among the ``known`` ones touched a millisecond before;
    a slow one counts nothing.
    """
    if b[TICK] - b[LAST_MS] > REARM_MS:
        b[ARMED] = 1.0
    for k in range(int(b[TOUCHES])):
        new = True
        for j in range(known):
            new = new and w[KNOWN + j] != w[3 * k]
        ux, uy = (vx - b[MAN_VX], vy - b[MAN_VY]) if w[3 * k] == WALKER else (vx, vy)
        closing = -(ux * w[3 * k + 1] + uy * w[3 * k + 2])
        if new and b[ARMED] > 0.0 and closing > COLLISION_SPEED_M_S:
            b[COLLISIONS] += 1.0
            b[ARMED] = 0.0
    b[LAST_MS] = b[TICK]
    b[CONTACT_MS] += 1.0


@compiled
def _blocked(push: float, b: Floats, w: Floats) -> float:
    """How straight the wheels push (forwards or backwards) into what is touched, 0..1."""
    if b[HELD] > 0.0:
        return 1.0
    c, d = push * cos(b[THETA]), push * sin(b[THETA])
    blocked = 0.0
    for k in range(int(b[TOUCHES])):
        blocked = max(blocked, -(c * w[3 * k + 1] + d * w[3 * k + 2]))
    return blocked


@compiled
def _grip(grip: float, wheel: float, turn: float, load_n: float, b: Floats) -> tuple[float, float]:
    """Let the floor follow a wheel as fast as traction allows: speed after, and turn gripped."""
    least = grip - (b[TRACTION_N] + load_n) * b[RAD_S_PER_N]
    most = grip + (b[TRACTION_N] - load_n) * b[RAD_S_PER_N]
    if least <= wheel <= most:
        return wheel, turn
    after = least if wheel < least else most
    if load_n != 0.0:
        after -= after * (TICK_S / _BOUNCE_S)
    return after, 0.5 * (grip + after) * TICK_S


@compiled
def _pose_tick(  # noqa: PLR0913, PLR0917 - positional, as kernels are called
    ds: float, dth: float, v: float, b: Floats, edges: Floats, w: Floats
) -> None:
    """Move the body by ``ds`` along the tick's middle heading, as far as it is let."""
    mid = b[THETA] + 0.5 * dth
    c, d = cos(mid), sin(mid)
    dx, dy = ds * c, ds * d
    travel = abs(ds)
    man_step = 0.0
    if b[MAN_MS] > 0.0:
        b[MAN_MS] -= 1.0
        b[MAN_X] += b[MAN_VX] * TICK_S
        b[MAN_Y] += b[MAN_VY] * TICK_S
        man_step = hypot(b[MAN_VX], b[MAN_VY]) * TICK_S
    reach = travel + man_step + TOUCH_M
    if b[TOUCHES] == 0.0 and b[DISTURBED] == 0.0:
        b[GAP] -= man_step
        if not b[GAP] > reach:
            _measure_gap(b, edges, w)
        if b[GAP] > reach:
            b[GAP] -= travel
            b[X] += dx
            b[Y] += dy
            b[THETA] += dth
            b[SWAY] += ds * dth
            b[PATH] += travel
            return
    known = int(b[TOUCHES])
    c0, d0 = cos(b[THETA]), sin(b[THETA])
    vx, vy = v * c0, v * d0
    if known > 0:
        for k in range(known):  # a slice would compile an error's whole text with it: seconds
            w[KNOWN + k] = w[3 * k]
        vx = b[SLIDE_V] * c0 - b[SLIDE_LATERAL] * d0
        vy = b[SLIDE_V] * d0 + b[SLIDE_LATERAL] * c0
    b[AT_X], b[AT_Y] = b[X], b[Y]
    if travel > 0.0 or man_step > 0.0 or b[DISTURBED] > 0.0:
        _measure_gap(b, edges, w)  # for the list of what is near
        _move(dx, dy, b, edges, w)
        b[DISTURBED] = 0.0
    ahead, aside = ds, 0.0
    if b[AT_X] != b[X] + dx or b[AT_Y] != b[Y] + dy:
        gone_x, gone_y = b[AT_X] - b[X], b[AT_Y] - b[Y]
        ahead, aside = gone_x * c + gone_y * d, gone_y * c - gone_x * d
        travel = hypot(gone_x, gone_y)
    b[SLIDE_V], b[SLIDE_LATERAL] = ahead / TICK_S, aside / TICK_S
    b[SLIDE_SWAY] += aside * dth
    b[X], b[Y] = b[AT_X], b[AT_Y]
    b[THETA] += dth
    b[SWAY] += ahead * dth
    b[PATH] += travel
    if b[TOUCHES] > 0.0:
        _count_contact(vx, vy, known, b, w)


@compiled
def _tick(b: Floats, edges: Floats, w: Floats) -> None:
    """Let a millisecond pass."""
    v = b[TRAVEL_L] * b[GRIP_L] + b[TRAVEL_R] * b[GRIP_R]
    b[GRAVITY_X] += b[TILT_X] * TICK_S
    b[GRAVITY_Y] += b[TILT_Y] * TICK_S
    caster_l = caster_r = 0.0
    aside = b[CASTER_X] * (b[YAW_R] * b[GRIP_R] - b[YAW_L] * b[GRIP_L])
    speed = sqrt(v * v + aside * aside)
    if speed > 0.0 and b[CASTER_N] > 0.0:
        straight = 0.5 * b[CASTER_N] * v / speed
        turning = b[CASTER_N] * aside / speed * b[CASTER_X] / b[WHEEL_BASE]
        caster_l, caster_r = straight - turning, straight + turning
    volt_l, volt_r = b[VOLT_L], b[VOLT_R]
    blocked_l = blocked_r = 0.0
    if (b[TOUCHES] > 0.0 or b[HELD] > 0.0) and abs(volt_l) + abs(volt_r) > 0.0:
        push = (volt_l + volt_r) / (abs(volt_l) + abs(volt_r))
        blocked_v = _blocked(push, b, w) * b[TRACTION_N] * b[LOAD_V_N]
        blocked_l = blocked_v if volt_l * push > 0.0 else 0.0
        blocked_r = blocked_v if volt_r * push > 0.0 else 0.0
    turn_l = _turn(0, caster_l, blocked_l, b)
    turn_r = _turn(1, caster_r, blocked_r, b)
    b[TICK] += 1.0
    if b[LIFTED] > 0.0 or b[HELD] > 0.0:
        b[GRIP_L] = b[GRIP_R] = b[SLIDE_V] = b[SLIDE_LATERAL] = 0.0
        if b[HELD] > 0.0 and b[LIFTED] == 0.0:
            b[LAST_MS] = b[TICK]
            b[CONTACT_MS] += 1.0
        return
    b[GRIP_L], turn_l = _grip(b[GRIP_L], b[SPEED_L], turn_l, b[SLOPE_N_L], b)
    b[GRIP_R], turn_r = _grip(b[GRIP_R], b[SPEED_R], turn_r, b[SLOPE_N_R], b)
    ds = b[TRAVEL_L] * turn_l + b[TRAVEL_R] * turn_r
    dth = b[YAW_R] * turn_r - b[YAW_L] * turn_l
    _pose_tick(ds, dth, v, b, edges, w)


@compiled
def advance(  # noqa: PLR0913, PLR0917 - positional: a compiled call of many a second
    ticks: int, left: float, right: float, b: Floats, edges: Floats, w: Floats
) -> None:
    """Let ``ticks`` milliseconds pass.

    Args:
        ticks: How many, not beyond the next whole ``SLOW_TICKS``, during which no parameter
            changes; with 0 it only feels for walls.
        left: Duty of the left motor, -1..1; so ``right``.
        right: See ``left``.
        b: The body, ``BODY`` long; changed.
        edges: Of the room, as in ``ray_kernel``.
        w: Room to work in: ``NEAR``, and as many more as there are edges.

    """
    switch(left, right, b)
    if ticks == 0:
        _measure_gap(b, edges, w)
        _move(0.0, 0.0, b, edges, w)
        b[X], b[Y] = b[AT_X], b[AT_Y]
    for _ in range(ticks):
        _tick(b, edges, w)
