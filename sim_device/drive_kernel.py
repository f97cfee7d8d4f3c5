"""The plant's kernel, compiled: wheels, pose and contact, a millisecond at a time.

``advance`` works on float64 arrays; its parameters and state are named by the indices below.
Each millisecond depends only on the state before it, so equal calls give equal floats however
time is split. Every callee stands in this file: the kept code would notice no change elsewhere.
The models are told in ``plant`` and ``motors``.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

TICK_S = 0.001
TOUCH_M = 2e-5
"""A smaller gap is contact: far below any sensor, far above rounding."""
PENETRATION_M = 1e-9
"""The disc never sticks further into a wall than this (nor than the start did)."""
COLLISION_SPEED_M_S, REARM_MS = 0.03, 500.0
"""Slower onsets of contact are no collision; the next counts after this time free of it."""
MAX_TOUCHES = 16
WALKER = -1
"""In a row of touches, for an edge's index."""
_NEAR_M, _NEAR_MOVED_M = 0.35, 0.25
"""Edges within the radius and this are looked at; renewed as the robot has gone the other."""
_CAREFUL_M = 0.02
_PASSES = 12
_SHOVE_M, _BOUNCE_S = 0.005, 0.05
"""A walker shoves no further at once, so never through a wall. A tyre that spins before a
threshold bounces on it; that dies out so fast."""

# Parameters: those of the parts, then those that the plant renews.
(TAU, DECAY, BACK_EMF, RESISTANCE, FRICTION_V, LOAD_V_N, BODY_RADIUS, WALL_FRICTION) = range(8)
(TRACTION_N, RAD_S_PER_N, CASTER_N, CASTER_X, WHEEL_BASE) = range(8, 13)
(TRAVEL_L, TRAVEL_R, YAW_L, YAW_R, VOLT_L, VOLT_R, DUTY_L, DUTY_R, SUPPLY_V) = range(13, 22)
(CARPET_N_L, CARPET_N_R, SLOPE_N_L, SLOPE_N_R, TILT_X, TILT_Y) = range(22, 28)
(STUCK_L, STUCK_R, LIFTED, HELD) = range(28, 32)
PARAMETERS = 32
"""TRAVEL: half of a wheel's travel over the floor per radian, YAW the turn, slip taken off.
SLOPE: weight's push against a wheel, TILT: what the accelerometer feels of it (m/s²)."""

# State.
(TICK, SPEED_L, SPEED_R, ANGLE_L, ANGLE_R, GRIP_L, GRIP_R, X, Y, THETA, PATH) = range(11)
(SWAY, SLIDE_SWAY, SLIDE_V, SLIDE_LATERAL, GRAVITY_X, GRAVITY_Y) = range(11, 17)
(DRAWN_C, DRAWN_J, BRIDGE_J, WINDING_J, SHAFT_J) = range(17, 22)
(NEAR_X, NEAR_Y, NEAR_COUNT, GAP, TOUCHES, DISTURBED) = range(22, 28)
(COLLISIONS, CONTACT_MS, ARMED, LAST_MS) = range(28, 32)
(MAN_X, MAN_Y, MAN_R, MAN_VX, MAN_VY, MAN_MS) = range(32, 38)
STATE = 38
"""GRIP: speed (rad/s) that the floor under a wheel sees, its own unless it spins. SWAY: Σ ds·dθ,
over a tick the lateral velocity that turning takes up. GRAVITY: impulse felt by tilt."""


@compiled
def _wheel(rad_s: float, net_v: float, drag_v: float, p: Floats) -> tuple[float, float, float]:
    """Turn one wheel by an exact first-order lag; friction holds it as it passes rest.

    Gives its speed after (rad/s), its turn (rad) and the integral of its squared speed.
    """
    target = 0.0
    if rad_s > 0.0 or (rad_s == 0.0 and net_v > drag_v):
        target = (net_v - drag_v) / p[BACK_EMF]
    elif rad_s < 0.0 or net_v < -drag_v:
        target = (net_v + drag_v) / p[BACK_EMF]
    decay = p[DECAY]
    change = (target - rad_s) * decay
    after = rad_s + change
    if after * rad_s < 0.0:
        return 0.0, 0.5 * TICK_S * rad_s, TICK_S * rad_s * rad_s / 3.0
    tau = p[TAU]
    above = rad_s - target
    squared = target * target * TICK_S + above * tau * (
        2.0 * target * decay + 0.5 * above * (1.0 - (1.0 - decay) * (1.0 - decay))
    )
    return after, target * TICK_S - change * tau, squared


@compiled
def _book(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    duty: float, volt: float, turn: float, squared: float, s: Floats, p: Floats
) -> None:
    """Book what a motor took in a tick; what a braking motor gives back, the bridge burns."""
    charge = (volt * TICK_S - p[BACK_EMF] * turn) / p[RESISTANCE]
    shaft = p[BACK_EMF] * (volt * turn - p[BACK_EMF] * squared) / p[RESISTANCE]
    drawn = max(0.0, duty * charge)
    s[DRAWN_C] += drawn
    s[DRAWN_J] += drawn * p[SUPPLY_V]
    s[BRIDGE_J] += drawn * p[SUPPLY_V] - volt * charge
    s[WINDING_J] += volt * charge - shaft
    s[SHAFT_J] += shaft


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
def _measure_gap(s: Floats, p: Floats, edges: Floats, near: Ints) -> None:
    """Distance from the disc to what it could touch, exact when it is small."""
    gone = hypot(s[X] - s[NEAR_X], s[Y] - s[NEAR_Y])
    if not gone <= _NEAR_MOVED_M:
        gone, count, within = 0.0, 0, p[BODY_RADIUS] + _NEAR_M
        for i in range(edges.shape[0]):
            dx, dy = _offset(s[X], s[Y], i, edges)
            if dx * dx + dy * dy <= within * within:
                near[count] = i
                count += 1
        s[NEAR_COUNT], s[NEAR_X], s[NEAR_Y] = count, s[X], s[Y]
    gap = _NEAR_M - gone
    for k in range(int(s[NEAR_COUNT])):
        dx, dy = _offset(s[X], s[Y], near[k], edges)
        gap = min(gap, sqrt(dx * dx + dy * dy) - p[BODY_RADIUS])
    if s[MAN_R] > 0.0:
        gap = min(gap, hypot(s[X] - s[MAN_X], s[Y] - s[MAN_Y]) - s[MAN_R] - p[BODY_RADIUS])
    s[GAP] = gap


@compiled
def _settle(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    at: Floats,
    s: Floats,
    p: Floats,
    edges: Floats,
    near: Ints,
    touch: Floats,
    push: bool,  # noqa: FBT001
) -> float:
    """Push the disc out of the walker, then of each edge in turn; gives the least gap met.

    For the gap only walls count: a walker is soft, and gives way in a wedge.
    """
    least, count = _CAREFUL_M, 0
    walker = s[MAN_R] > 0.0
    for k in range(int(s[NEAR_COUNT]) + walker):
        edge = WALKER if walker and k == 0 else near[k - walker]
        if edge == WALKER:
            dx, dy = at[0] - s[MAN_X], at[1] - s[MAN_Y]
            radius = p[BODY_RADIUS] + s[MAN_R]
        else:
            dx, dy = _offset(at[0], at[1], edge, edges)
            radius = p[BODY_RADIUS]
        distance = sqrt(dx * dx + dy * dy)
        gap = distance - radius
        if gap < TOUCH_M and distance > 0.0:
            dx, dy = dx / distance, dy / distance
            if count < MAX_TOUCHES:
                touch[count, 0], touch[count, 1], touch[count, 2] = edge, dx, dy
                count += 1
            if edge == WALKER:
                gap = max(gap, -_SHOVE_M)
            if push and gap < -PENETRATION_M:
                at[0] -= gap * dx
                at[1] -= gap * dy
        if edge == WALKER:
            gap = max(gap, 0.0)
        least = min(least, gap)
    s[TOUCHES] = count
    return least


@compiled
def _move(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    dx: float,
    dy: float,
    at: Floats,
    s: Floats,
    p: Floats,
    edges: Floats,
    near: Ints,
    touch: Floats,
) -> None:
    """Move the disc as far as the walls let it; ``at`` gets where it ends.

    Walls touched take the part into them, and Coulomb's friction some of what is left.
    """
    blocked, count = 0.0, int(s[TOUCHES])
    for k in range(2 * count):  # twice: a corner's second wall may send it into the first
        nx, ny = touch[k % count, 1], touch[k % count, 2]
        into = dx * nx + dy * ny
        if into < 0.0:
            dx -= into * nx
            dy -= into * ny
            blocked -= into
    if blocked > 0.0:
        along = hypot(dx, dy)
        kept = along - p[WALL_FRICTION] * blocked
        wedged = False
        for k in range(count if count > 1 else 0):
            wedged = wedged or dx * touch[k, 1] + dy * touch[k, 2] < -PENETRATION_M
        if wedged or kept <= 0.0:
            dx = dy = 0.0
        else:
            dx, dy = dx * kept / along, dy * kept / along
    at[0], at[1] = s[X] + dx, s[Y] + dy
    for _ in range(_PASSES):
        s[GAP] = _settle(at, s, p, edges, near, touch, True)  # noqa: FBT003
        if s[GAP] >= -PENETRATION_M:
            return
    at[0], at[1] = s[X], s[Y]  # a wedge too narrow to go into: stay
    s[GAP] = _settle(at, s, p, edges, near, touch, False)  # noqa: FBT003


@compiled
def _count_contact(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    vx: float, vy: float, known: Floats, count: int, s: Floats, touch: Floats
) -> None:
    """Count a millisecond in contact, and a collision where one began in it.

    That is a fast touch of an edge not touched a millisecond before; a slow one counts nothing.
    """
    if s[TICK] - s[LAST_MS] > REARM_MS:
        s[ARMED] = 1.0
    for k in range(int(s[TOUCHES])):
        new = True
        for j in range(count):
            new = new and known[j, 0] != touch[k, 0]
        ux, uy = (vx - s[MAN_VX], vy - s[MAN_VY]) if touch[k, 0] == WALKER else (vx, vy)
        closing = -(ux * touch[k, 1] + uy * touch[k, 2])
        if new and s[ARMED] > 0.0 and closing > COLLISION_SPEED_M_S:
            s[COLLISIONS] += 1.0
            s[ARMED] = 0.0
    s[LAST_MS] = s[TICK]
    s[CONTACT_MS] += 1.0


@compiled
def _blocked(s: Floats, p: Floats, push: float, touch: Floats) -> float:
    """How straight the wheels push (forwards or backwards) into what is touched, 0..1."""
    if p[HELD] > 0.0:
        return 1.0
    c, d = push * cos(s[THETA]), push * sin(s[THETA])
    blocked = 0.0
    for k in range(int(s[TOUCHES])):
        blocked = max(blocked, -(c * touch[k, 1] + d * touch[k, 2]))
    return blocked


@compiled
def _grip(grip: float, wheel: float, turn: float, load_n: float, p: Floats) -> tuple[float, float]:
    """Let the floor follow a wheel as fast as traction allows: speed after, and turn gripped."""
    least = grip - (p[TRACTION_N] + load_n) * p[RAD_S_PER_N]
    most = grip + (p[TRACTION_N] - load_n) * p[RAD_S_PER_N]
    if least <= wheel <= most:
        return wheel, turn
    after = least if wheel < least else most
    if load_n != 0.0:
        after -= after * (TICK_S / _BOUNCE_S)
    return after, 0.5 * (grip + after) * TICK_S


@compiled
def _pose_tick(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    ds: float,
    dth: float,
    s: Floats,
    p: Floats,
    edges: Floats,
    near: Ints,
    touch: Floats,
    known: Floats,
    at: Floats,
    v: float,
) -> None:
    """Move the body by ``ds`` along the tick's middle heading, as far as it is let."""
    mid = s[THETA] + 0.5 * dth
    c, d = cos(mid), sin(mid)
    dx, dy = ds * c, ds * d
    travel = abs(ds)
    man_step = 0.0
    if s[MAN_MS] > 0.0:
        s[MAN_MS] -= 1.0
        s[MAN_X] += s[MAN_VX] * TICK_S
        s[MAN_Y] += s[MAN_VY] * TICK_S
        man_step = hypot(s[MAN_VX], s[MAN_VY]) * TICK_S
    reach = travel + man_step + TOUCH_M
    if s[TOUCHES] == 0.0 and s[DISTURBED] == 0.0:
        s[GAP] -= man_step
        if not s[GAP] > reach:
            _measure_gap(s, p, edges, near)
        if s[GAP] > reach:
            s[GAP] -= travel
            s[X] += dx
            s[Y] += dy
            s[THETA] += dth
            s[SWAY] += ds * dth
            s[PATH] += travel
            return
    before = int(s[TOUCHES])
    c0, d0 = cos(s[THETA]), sin(s[THETA])
    vx, vy = v * c0, v * d0
    if before > 0:
        for k in range(before):  # a slice would compile an error's whole text with it: seconds
            known[k, 0] = touch[k, 0]
        vx = s[SLIDE_V] * c0 - s[SLIDE_LATERAL] * d0
        vy = s[SLIDE_V] * d0 + s[SLIDE_LATERAL] * c0
    at[0], at[1] = s[X], s[Y]
    if travel > 0.0 or man_step > 0.0 or s[DISTURBED] > 0.0:
        _measure_gap(s, p, edges, near)  # for the list of what is near
        _move(dx, dy, at, s, p, edges, near, touch)
        s[DISTURBED] = 0.0
    ahead, aside = ds, 0.0
    if at[0] != s[X] + dx or at[1] != s[Y] + dy:
        gone_x, gone_y = at[0] - s[X], at[1] - s[Y]
        ahead, aside = gone_x * c + gone_y * d, gone_y * c - gone_x * d
        travel = hypot(gone_x, gone_y)
    s[SLIDE_V], s[SLIDE_LATERAL] = ahead / TICK_S, aside / TICK_S
    s[SLIDE_SWAY] += aside * dth
    s[X], s[Y] = at[0], at[1]
    s[THETA] += dth
    s[SWAY] += ahead * dth
    s[PATH] += travel
    if s[TOUCHES] > 0.0:
        _count_contact(vx, vy, known, before, s, touch)


@compiled
def advance(  # noqa: PLR0913, PLR0915, PLR0917 - positional: a compiled call of many a second
    ticks: int, s: Floats, p: Floats, edges: Floats, near: Ints, touch: Floats
) -> None:
    """Let ``ticks`` milliseconds pass.

    Args:
        ticks: How many, during which no parameter changes; with 0 it only feels for walls.
        s: The state, ``STATE`` long; changed.
        p: The parameters, ``PARAMETERS`` long.
        edges: Of the room, as in ``ray_kernel``.
        near: Room for as many indices as there are edges; the kernel's own, changed.
        touch: What is touched: edge, unit vector to the disc's centre; below is room for as many
            from before and a place: ``(2 * MAX_TOUCHES + 1, 3)``.

    """
    known, at = touch[MAX_TOUCHES : 2 * MAX_TOUCHES], touch[2 * MAX_TOUCHES]
    if ticks == 0:
        _measure_gap(s, p, edges, near)
        _move(0.0, 0.0, at, s, p, edges, near, touch)
        s[X], s[Y] = at[0], at[1]
    for _ in range(ticks):
        v = p[TRAVEL_L] * s[GRIP_L] + p[TRAVEL_R] * s[GRIP_R]
        s[GRAVITY_X] += p[TILT_X] * TICK_S
        s[GRAVITY_Y] += p[TILT_Y] * TICK_S
        caster_l = caster_r = 0.0
        aside = p[CASTER_X] * (p[YAW_R] * s[GRIP_R] - p[YAW_L] * s[GRIP_L])
        speed = sqrt(v * v + aside * aside)
        if speed > 0.0 and p[CASTER_N] > 0.0:
            straight = 0.5 * p[CASTER_N] * v / speed
            turning = p[CASTER_N] * aside / speed * p[CASTER_X] / p[WHEEL_BASE]
            caster_l, caster_r = straight - turning, straight + turning
        drag_l = p[FRICTION_V] + p[CARPET_N_L] * p[LOAD_V_N]
        drag_r = p[FRICTION_V] + p[CARPET_N_R] * p[LOAD_V_N]
        volt_l, volt_r = p[VOLT_L], p[VOLT_R]
        if (s[TOUCHES] > 0.0 or p[HELD] > 0.0) and abs(volt_l) + abs(volt_r) > 0.0:
            push = (volt_l + volt_r) / (abs(volt_l) + abs(volt_r))
            blocked_v = _blocked(s, p, push, touch) * p[TRACTION_N] * p[LOAD_V_N]
            drag_l += blocked_v if volt_l * push > 0.0 else 0.0
            drag_r += blocked_v if volt_r * push > 0.0 else 0.0
        turn_l = turn_r = squared_l = squared_r = 0.0
        if p[STUCK_L] > 0.0:
            s[SPEED_L] = 0.0
        else:
            net_v = volt_l - (p[SLOPE_N_L] + caster_l) * p[LOAD_V_N]
            s[SPEED_L], turn_l, squared_l = _wheel(s[SPEED_L], net_v, drag_l, p)
        if p[STUCK_R] > 0.0:
            s[SPEED_R] = 0.0
        else:
            net_v = volt_r - (p[SLOPE_N_R] + caster_r) * p[LOAD_V_N]
            s[SPEED_R], turn_r, squared_r = _wheel(s[SPEED_R], net_v, drag_r, p)
        s[ANGLE_L] += turn_l
        s[ANGLE_R] += turn_r
        _book(p[DUTY_L], volt_l, turn_l, squared_l, s, p)
        _book(p[DUTY_R], volt_r, turn_r, squared_r, s, p)
        s[TICK] += 1.0
        if p[LIFTED] > 0.0 or p[HELD] > 0.0:
            s[GRIP_L] = s[GRIP_R] = s[SLIDE_V] = s[SLIDE_LATERAL] = 0.0
            if p[HELD] > 0.0 and p[LIFTED] == 0.0:
                s[LAST_MS] = s[TICK]
                s[CONTACT_MS] += 1.0
            continue
        s[GRIP_L], turn_l = _grip(s[GRIP_L], s[SPEED_L], turn_l, p[SLOPE_N_L], p)
        s[GRIP_R], turn_r = _grip(s[GRIP_R], s[SPEED_R], turn_r, p[SLOPE_N_R], p)
        ds = p[TRAVEL_L] * turn_l + p[TRAVEL_R] * turn_r
        dth = p[YAW_R] * turn_r - p[YAW_L] * turn_l
        _pose_tick(ds, dth, s, p, edges, near, touch, known, at, v)
