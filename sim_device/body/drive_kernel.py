"""Compiled kernel of the plant: wheels, pose, contact and battery, one millisecond at a time.

``advance`` changes a ``Body`` and allocates no memory. Each step depends only on the previous
state, so the results are bit-equal for any split of the time into calls. ``renew`` updates the slow
quantities (battery, slip) every ten milliseconds. The modules ``plant`` and ``motors`` describe the
models.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
import numpy as np
from cython.cimports.libc.math import cos, fabs, hypot, sin, sqrt

from sim_device.body.battery import BRIDGE_LOGIC_V, RAIL_DROPOUT_V, RAIL_WHOLE_V

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid, Floats, Ints, Pair

if TYPE_CHECKING:
    Felt = tuple[float, float, float, float, float, float, float, float]

TICK_S = 0.001
SLOW_MS = 10
"""Update period of the slow quantities (battery, slip), ms."""
REARM_MS = 500.0
"""Time without contact after which the next onset of contact counts as a collision, ms."""
MAX_TOUCHES = 16
SLIP_DRAWS = 512

_TICK_S = cython.declare(cython.double, TICK_S)
_REARM_MS = cython.declare(cython.double, REARM_MS)
_MAX_TOUCHES = cython.declare(cython.int, MAX_TOUCHES)
_INFINITY = cython.declare(cython.double, math.inf)
_RAIL_DROPOUT_V = cython.declare(cython.double, RAIL_DROPOUT_V)
_RAIL_WHOLE_V = cython.declare(cython.double, RAIL_WHOLE_V)
_BRIDGE_LOGIC_V = cython.declare(cython.double, BRIDGE_LOGIC_V)
_SECONDS_PER_HOUR = cython.declare(cython.double, 3600.0)
_TOUCH_M = cython.declare(cython.double, 2e-5)
"""Gap below which the disc (the robot's footprint) is in contact, m. It is far below the resolution
of any sensor, and far above rounding errors."""
_PENETRATION_M = cython.declare(cython.double, 1e-9)
"""Maximum depth of the disc in a wall, m, unless the disc started deeper."""
_COLLISION_SPEED_M_S = cython.declare(cython.double, 0.03)
"""Minimum normal speed of a collision, m/s; slower onsets of contact do not count."""
_WALKER = cython.declare(cython.int, -1)
"""Index that marks the walker (a moving round obstacle) in the list of edges in contact."""
_NEAR_M = cython.declare(cython.double, 0.35)
_NEAR_MOVED_M = cython.declare(cython.double, 0.25)
"""Distance after which the list of near edges is renewed, m. The list contains the edges within the
disc's radius plus ``_NEAR_M``."""
_SMALL_STEP_M = cython.declare(cython.double, 0.02)
_PASSES = cython.declare(cython.int, 12)
_HALVINGS = cython.declare(cython.int, 10)
_SHOVE_M = cython.declare(cython.double, 0.005)
"""Maximum distance that a walker pushes the disc in one step, m. It keeps the disc from crossing a
wall.
"""
_BOUNCE_S = cython.declare(cython.double, 0.05)
"""Decay time of the bouncing of a spinning tyre at a threshold, s."""


@cython.final
@cython.cclass
class Wheel:
    """One wheel with its motor and its contact with the floor."""

    radius_m = cython.declare(cython.double, visibility="public")
    stuck = cython.declare(cython.bint, visibility="public")
    slope_n = cython.declare(cython.double, visibility="public")
    """Downhill force of the robot's weight on a slope, against the wheel, N."""
    carpet_n = cython.declare(cython.double, visibility="public")
    """Drag of the carpet under the wheel, N."""
    carpet_slip = cython.declare(cython.double, visibility="public")
    """Share of the wheel's travel that is lost on the present carpet."""
    extra_slip = cython.declare(cython.double, visibility="public")
    """Additional share of the travel that a fault makes the wheel lose."""
    slip = cython.declare(cython.double, visibility="public")
    """Random part of the lost share, with zero mean."""
    travel_m_rad = cython.declare(cython.double, visibility="public")
    """Motion of the body's centre per radian of the wheel, m/rad: half of the wheel's travel after
    slip."""
    yaw_rad_rad = cython.declare(cython.double, visibility="public")
    """Turn of the body per radian of the wheel, rad/rad."""
    duty = cython.declare(cython.double, visibility="public")
    """Duty of the motor bridge, -1..1."""
    volt = cython.declare(cython.double, visibility="public")
    """Motor voltage after the bridge, V."""
    rad_s = cython.declare(cython.double, visibility="public")
    angle_rad = cython.declare(cython.double, visibility="public")
    grip_rad_s = cython.declare(cython.double, visibility="public")
    """Speed at which the wheel would roll without spin, rad/s; it equals the wheel speed unless the
    wheel spins."""

    def __init__(self) -> None:
        """Start at rest on level floor."""
        self.radius_m = self.slope_n = self.carpet_n = self.carpet_slip = 0.0
        self.extra_slip = self.slip = self.travel_m_rad = self.yaw_rad_rad = 0.0
        self.duty = self.volt = self.rad_s = self.angle_rad = self.grip_rad_s = 0.0
        self.stuck = False


@cython.final
@cython.cclass
class Body:
    """The robot in its room: parameters of the parts, and the state."""

    left = cython.declare(Wheel, visibility="public")
    right = cython.declare(Wheel, visibility="public")

    # Parameters.
    tau_s = cython.declare(cython.double, visibility="public")
    """Time constant of a wheel's lag, s. ``decay`` is the share that remains after a tick (1
    ms)."""
    decay = cython.declare(cython.double, visibility="public")
    back_emf_v_s = cython.declare(cython.double, visibility="public")
    resistance_ohm = cython.declare(cython.double, visibility="public")
    friction_v = cython.declare(cython.double, visibility="public")
    drop_v = cython.declare(cython.double, visibility="public")
    """Voltage drop of the bridges, V."""
    load_v_n = cython.declare(cython.double, visibility="public")
    """Voltage drop caused by a wheel's load, V/N."""
    radius_m = cython.declare(cython.double, visibility="public")
    wheel_base_m = cython.declare(cython.double, visibility="public")
    wall_friction = cython.declare(cython.double, visibility="public")
    traction_n = cython.declare(cython.double, visibility="public")
    rad_s_per_n = cython.declare(cython.double, visibility="public")
    """Change of a wheel's speed in one tick per newton of push, rad/s/N."""
    caster_n = cython.declare(cython.double, visibility="public")
    caster_x_m = cython.declare(cython.double, visibility="public")
    full_v = cython.declare(cython.double, visibility="public")
    """Open-circuit voltage of the full battery, V. This attribute and the next ones are the values
    of ``BatteryParameters``."""
    capacity_ah = cython.declare(cython.double, visibility="public")
    empty_ratio = cython.declare(cython.double, visibility="public")
    battery_ohm = cython.declare(cython.double, visibility="public")
    knee = cython.declare(cython.double, visibility="public")
    knee_fall = cython.declare(cython.double, visibility="public")
    knee_resistance = cython.declare(cython.double, visibility="public")
    electronics_w = cython.declare(cython.double, visibility="public")
    slip_kick = cython.declare(cython.double, visibility="public")
    """Standard deviation of the slip's random step every ``SLOW_MS``. ``slip_fade`` is the share by
    which the slip decays in this time."""
    slip_fade = cython.declare(cython.double, visibility="public")
    unslipped = cython.declare(cython.double, visibility="public")
    """1 minus the mean slip."""
    tilt_x_m_s2 = cython.declare(cython.double, visibility="public")
    """Specific force along x that a tilt causes at the accelerometer, m/s². ``tilt_y_m_s2``: along
    y."""
    tilt_y_m_s2 = cython.declare(cython.double, visibility="public")
    lifted = cython.declare(cython.bint, visibility="public")
    held = cython.declare(cython.bint, visibility="public")
    """True: the robot is immobile, because a new obstacle overlaps it and there is no free
    place."""
    wanders = cython.declare(cython.bint, visibility="public")
    """True: the wheels are on a floor on which they slip."""

    # The pose, and the quantities from which sensor readings are computed.
    tick = cython.declare(cython.double, visibility="public")
    """Time since power-on, ms."""
    x_m = cython.declare(cython.double, visibility="public")
    y_m = cython.declare(cython.double, visibility="public")
    theta_rad = cython.declare(cython.double, visibility="public")
    path_m = cython.declare(cython.double, visibility="public")
    sway = cython.declare(cython.double, visibility="public")
    """Sum of ds·dθ over all ticks, m·rad. Divided by the tick's length, it is the time integral of
    the centripetal acceleration. ``slide_sway`` is the sum for lateral motion.
    """
    slide_sway = cython.declare(cython.double, visibility="public")
    slide_v_m_s = cython.declare(cython.double, visibility="public")
    """Forward part of the speed at which the robot slides along a wall, m/s. ``slide_aside_m_s``:
    the part to the left."""
    slide_aside_m_s = cython.declare(cython.double, visibility="public")
    gravity_x_m_s = cython.declare(cython.double, visibility="public")
    """Time integral of gravity's component along x in a tilted body, m/s. ``gravity_y_m_s``: along
    y."""
    gravity_y_m_s = cython.declare(cython.double, visibility="public")

    # The energy.
    drawn_c = cython.declare(cython.double, visibility="public")
    """Charge that the bridges have drawn since power-on, C."""
    bridge_j = cython.declare(cython.double, visibility="public")
    winding_j = cython.declare(cython.double, visibility="public")
    shaft_j = cython.declare(cython.double, visibility="public")
    charge_ah = cython.declare(cython.double, visibility="public")
    current_a = cython.declare(cython.double, visibility="public")
    supply_v = cython.declare(cython.double, visibility="public")
    open_v = cython.declare(cython.double, visibility="public")
    battery_j = cython.declare(cython.double, visibility="public")
    internal_j = cython.declare(cython.double, visibility="public")
    electronics_a = cython.declare(cython.double, visibility="public")
    electronics_j = cython.declare(cython.double, visibility="public")
    settled_ms = cython.declare(cython.double, visibility="public")
    """Time of the last battery update, ms. ``settled_c``: the charge drawn up to then, C."""
    settled_c = cython.declare(cython.double, visibility="public")

    # Contact.
    touches = cython.declare(cython.int, visibility="public")
    """Number of edges in contact."""
    disturbed = cython.declare(cython.bint, visibility="public")
    """True if the contacts may have changed although the robot has not moved."""
    collisions = cython.declare(cython.int, visibility="public")
    contact_ms = cython.declare(cython.double, visibility="public")
    armed = cython.declare(cython.bint, visibility="public")
    """True if the next onset of contact counts as a collision."""
    last_ms = cython.declare(cython.double, visibility="public")
    """Time of the last contact, ms."""
    walker_x_m = cython.declare(cython.double, visibility="public")
    walker_y_m = cython.declare(cython.double, visibility="public")
    walker_radius_m = cython.declare(cython.double, visibility="public")
    """Radius of the walker, m; 0: no walker."""
    walker_vx_m_s = cython.declare(cython.double, visibility="public")
    walker_vy_m_s = cython.declare(cython.double, visibility="public")
    walker_ms = cython.declare(cython.double, visibility="public")
    """Remaining time of the walker's motion, ms."""

    gap_m: cython.double
    """Distance to the nearest obstacle, m; a lower bound."""
    at_x_m: cython.double
    """End of the present move, x, m."""
    at_y_m: cython.double
    edges: FloatGrid
    """Edges of the room, in the format of ``ray_kernel``."""
    near: Ints
    """Indices of the edges near the robot's place at the last search."""
    near_count: cython.int
    near_x_m: cython.double
    near_y_m: cython.double
    touch_edge: Ints
    """Index of each edge in contact. ``touch_x`` and ``touch_y`` are the unit vectors from the
    contacts to the disc's centre."""
    touch_x: Floats
    touch_y: Floats
    known: Ints
    """Indices of the edges that were in contact one millisecond ago."""
    slips: Floats
    """Standard normal random values for the slip. The first ``slip_at`` values are used."""
    slip_at: cython.int

    def __init__(self) -> None:
        """Start at rest; the caller must set parameters and room."""
        self.left, self.right = Wheel(), Wheel()
        self.tau_s = self.decay = self.back_emf_v_s = self.resistance_ohm = 0.0
        self.friction_v = self.drop_v = self.load_v_n = self.radius_m = self.wheel_base_m = 0.0
        self.wall_friction = self.traction_n = self.rad_s_per_n = 0.0
        self.caster_n = self.caster_x_m = self.full_v = self.capacity_ah = 0.0
        self.empty_ratio = self.battery_ohm = self.knee = self.knee_fall = 0.0
        self.knee_resistance = self.electronics_w = self.slip_kick = self.slip_fade = 0.0
        self.unslipped = self.tilt_x_m_s2 = self.tilt_y_m_s2 = 0.0
        self.lifted = self.held = False
        self.wanders = True
        self.tick = self.x_m = self.y_m = self.theta_rad = self.path_m = 0.0
        self.sway = self.slide_sway = self.slide_v_m_s = self.slide_aside_m_s = 0.0
        self.gravity_x_m_s = self.gravity_y_m_s = 0.0
        self.drawn_c = self.bridge_j = self.winding_j = self.shaft_j = self.charge_ah = 0.0
        self.current_a = self.supply_v = self.open_v = self.battery_j = self.internal_j = 0.0
        self.electronics_a = self.electronics_j = self.settled_ms = self.settled_c = 0.0
        self.touches = self.collisions = 0
        self.disturbed, self.armed, self.last_ms = False, True, -_REARM_MS
        self.contact_ms = self.walker_x_m = self.walker_y_m = self.walker_radius_m = 0.0
        self.walker_vx_m_s = self.walker_vy_m_s = self.walker_ms = 0.0
        self.gap_m = self.at_x_m = self.at_y_m = self.near_y_m = 0.0
        self.touch_edge = np.zeros(MAX_TOUCHES, dtype=np.int32)
        self.touch_x, self.touch_y = np.zeros(MAX_TOUCHES), np.zeros(MAX_TOUCHES)
        self.known = np.zeros(MAX_TOUCHES, dtype=np.int32)
        self.slips, self.slip_at = np.zeros(SLIP_DRAWS), SLIP_DRAWS
        self.take_edges(np.zeros((0, 7)))

    def take_edges(self, edges: FloatGrid) -> None:
        """Set the edges of another room."""
        self.edges, self.near = edges, np.zeros(edges.shape[0], dtype=np.int32)
        self.near_count, self.near_x_m = 0, _INFINITY

    def touch(self, normal_x: cython.double, normal_y: cython.double) -> None:
        """Add a contact; the unit vector points from the contact to the disc's centre."""
        self.touch_edge[0], self.touch_x[0], self.touch_y[0] = 0, normal_x, normal_y
        self.touches = 1

    def normals(self) -> list[tuple[float, float]]:
        """Return the unit vector from each contact to the disc's centre."""
        return [(self.touch_x[i], self.touch_y[i]) for i in range(self.touches)]

    def draws_used(self) -> int:
        """Return the number of used random values for the slip."""
        return self.slip_at

    def take_draws(self, draws: Floats) -> None:
        """Remove the used random values for the slip and append new values."""
        left: cython.int = SLIP_DRAWS - self.slip_at
        k: cython.int
        for k in range(left):
            self.slips[k] = self.slips[self.slip_at + k]
        for k in range(self.slip_at):
            self.slips[left + k] = draws[k]
        self.slip_at = 0


@cython.ccall
@cython.exceptval(check=False)
def switch(left: cython.double, right: cython.double, b: Body) -> cython.void:
    """Compute the motor voltages at these duties (-1..1) and the present battery voltage."""
    supply_v, drop_v = b.supply_v, b.drop_v
    if supply_v - _RAIL_DROPOUT_V < _BRIDGE_LOGIC_V:
        left = right = 0.0
    b.left.duty, b.right.duty = left, right
    over_l, over_r = fabs(left) * supply_v - drop_v, fabs(right) * supply_v - drop_v
    b.left.volt = 0.0 if over_l <= 0.0 else over_l if left > 0.0 else -over_l
    b.right.volt = 0.0 if over_r <= 0.0 else over_r if right > 0.0 else -over_r


@cython.cfunc
@cython.exceptval(check=False)
def _turn(wheel: Wheel, load_n: cython.double, blocked_v: cython.double, b: Body) -> cython.double:
    """Turn one wheel for one tick by an exact first-order lag; return the turn, rad.

    Friction holds the wheel when its speed crosses zero. The function adds the motor's charge to
    the energy balance. The energy of a braking motor becomes heat in the bridge.
    """
    rad_s, volt, emf = wheel.rad_s, wheel.volt, b.back_emf_v_s
    after = turn = squared = 0.0
    if not wheel.stuck:
        net_v = volt - (wheel.slope_n + load_n) * b.load_v_n
        drag_v = b.friction_v + wheel.carpet_n * b.load_v_n + blocked_v
        target = 0.0
        if rad_s > 0.0 or (rad_s == 0.0 and net_v > drag_v):
            target = (net_v - drag_v) / emf
        elif rad_s < 0.0 or net_v < -drag_v:
            target = (net_v + drag_v) / emf
        decay, tau, above = b.decay, b.tau_s, rad_s - target
        change = (target - rad_s) * decay
        after, turn = rad_s + change, target * _TICK_S - change * tau
        squared = target * target * _TICK_S + above * tau * (
            2.0 * target * decay + 0.5 * above * (1.0 - (1.0 - decay) * (1.0 - decay))
        )
        if after * rad_s < 0.0:
            after, turn = 0.0, 0.5 * _TICK_S * rad_s
            squared = _TICK_S * rad_s * rad_s / 3.0
    wheel.rad_s = after
    wheel.angle_rad += turn
    charge = (volt * _TICK_S - emf * turn) / b.resistance_ohm
    shaft = emf * (volt * turn - emf * squared) / b.resistance_ohm
    drawn = max(0.0, wheel.duty * charge)
    b.drawn_c += drawn
    b.bridge_j += drawn * b.supply_v - volt * charge
    b.winding_j += volt * charge - shaft
    b.shaft_j += shaft
    return turn


@cython.cfunc
@cython.exceptval(check=False)
def _offset(x: cython.double, y: cython.double, i: cython.int, edges: FloatGrid) -> Pair:
    """Return the vector from the closest point of an edge to a point."""
    dx, dy = x - edges[i, 0], y - edges[i, 1]
    t = (dx * edges[i, 2] + dy * edges[i, 3]) * edges[i, 4]
    if t > 0.0:
        t = min(t, 1.0)
        dx -= t * edges[i, 2]
        dy -= t * edges[i, 3]
    return dx, dy


@cython.cfunc
@cython.exceptval(check=False)
def _measure_gap(b: Body) -> cython.void:
    """Compute the distance from the disc to obstacles; exact if it is small."""
    gone = hypot(b.x_m - b.near_x_m, b.y_m - b.near_y_m)
    count: cython.int = 0
    k: cython.int
    if not gone <= _NEAR_MOVED_M:
        gone, within = 0.0, b.radius_m + _NEAR_M
        for k in range(b.edges.shape[0]):
            dx, dy = _offset(b.x_m, b.y_m, k, b.edges)
            if dx * dx + dy * dy <= within * within:
                b.near[count] = k
                count += 1
        b.near_count, b.near_x_m, b.near_y_m = count, b.x_m, b.y_m
    gap = _NEAR_M - gone
    for k in range(b.near_count):
        dx, dy = _offset(b.x_m, b.y_m, b.near[k], b.edges)
        gap = min(gap, sqrt(dx * dx + dy * dy) - b.radius_m)
    if b.walker_radius_m > 0.0:
        apart = hypot(b.x_m - b.walker_x_m, b.y_m - b.walker_y_m)
        gap = min(gap, apart - b.walker_radius_m - b.radius_m)
    b.gap_m = gap


@cython.cfunc
@cython.exceptval(check=False)
def _free(push: cython.bint, b: Body) -> cython.double:
    """Push the disc out of the walker, then out of each edge in turn; return the smallest gap.

    Without ``push`` the function only measures. An overlap with the walker does not count for the
    gap, because the walker yields if a wall holds the disc.
    """
    least = _SMALL_STEP_M
    count: cython.int = 0
    edge: cython.int
    k: cython.int
    walker: cython.int = 1 if b.walker_radius_m > 0.0 else 0
    for k in range(b.near_count + walker):
        edge = _WALKER if walker and k == 0 else b.near[k - walker]
        if edge == _WALKER:
            dx, dy = b.at_x_m - b.walker_x_m, b.at_y_m - b.walker_y_m
            radius = b.radius_m + b.walker_radius_m
        else:
            dx, dy = _offset(b.at_x_m, b.at_y_m, edge, b.edges)
            radius = b.radius_m
        distance = sqrt(dx * dx + dy * dy)
        gap = distance - radius
        if gap < _TOUCH_M and distance > 0.0:
            dx, dy = dx / distance, dy / distance
            if count < _MAX_TOUCHES:
                b.touch_edge[count], b.touch_x[count], b.touch_y[count] = edge, dx, dy
                count += 1
            if edge == _WALKER:
                gap = max(gap, -_SHOVE_M)
            if push and gap < -_PENETRATION_M:
                b.at_x_m -= gap * dx
                b.at_y_m -= gap * dy
        if edge == _WALKER:
            gap = max(gap, 0.0)
        least = min(least, gap)
    b.touches = count
    return least


@cython.cfunc
@cython.exceptval(check=False)
def _push_out(b: Body) -> cython.bint:
    """Push the disc out of all obstacles; return whether it is free afterwards."""
    for _ in range(_PASSES):
        b.gap_m = _free(True, b)  # noqa: FBT003 - positional, as kernels are called
        if b.gap_m >= -_PENETRATION_M:
            return True
    return False


@cython.cfunc
@cython.exceptval(check=False)
def _move(dx: cython.double, dy: cython.double, b: Body) -> cython.void:
    """Move the disc as far as the walls allow; ``at_x_m`` and ``at_y_m`` are set to the end.

    A wall in contact removes the motion component towards the wall. Coulomb friction reduces the
    motion along the wall.
    """
    blocked = 0.0
    count = b.touches
    k: cython.int
    # Two passes: the second wall of a corner may push the disc back into the first wall.
    for k in range(2 * count):
        nx, ny = b.touch_x[k % count], b.touch_y[k % count]
        into = dx * nx + dy * ny
        if into < 0.0:
            dx -= into * nx
            dy -= into * ny
            blocked -= into
    if blocked > 0.0:
        along = hypot(dx, dy)
        kept = along - b.wall_friction * blocked
        wedged: cython.bint = False
        for k in range(count if count > 1 else 0):
            wedged = wedged or dx * b.touch_x[k] + dy * b.touch_y[k] < -_PENETRATION_M
        if wedged or kept <= 0.0:
            dx = dy = 0.0
        else:
            dx, dy = dx * kept / along, dy * kept / along
    b.at_x_m, b.at_y_m = b.x_m + dx, b.y_m + dy
    if _push_out(b):
        return
    # The corner is too narrow for the whole move: move until the disc also touches the second wall.
    share, step, end_x, end_y = 0.0, 0.5, b.x_m, b.y_m
    for _ in range(_HALVINGS):
        b.at_x_m, b.at_y_m = b.x_m + (share + step) * dx, b.y_m + (share + step) * dy
        if _push_out(b):
            share, end_x, end_y = share + step, b.at_x_m, b.at_y_m
        step *= 0.5
    b.at_x_m, b.at_y_m = end_x, end_y
    b.gap_m = _free(False, b)  # noqa: FBT003 - positional, as kernels are called


@cython.cfunc
@cython.exceptval(check=False)
def _count_contact(vx: cython.double, vy: cython.double, known: cython.int, b: Body) -> cython.void:
    """Count a millisecond in contact, and a collision if it begins in this millisecond.

    A collision is a fast contact with an edge that was not in contact a millisecond before (the
    first ``known`` edges). A slow contact is not a collision.
    """
    new: cython.bint
    if b.tick - b.last_ms > _REARM_MS:
        b.armed = True
    for k in range(b.touches):
        new = True
        for j in range(known):
            new = new and b.known[j] != b.touch_edge[k]
        ux, uy = vx, vy
        if b.touch_edge[k] == _WALKER:
            ux, uy = vx - b.walker_vx_m_s, vy - b.walker_vy_m_s
        closing = -(ux * b.touch_x[k] + uy * b.touch_y[k])
        if new and b.armed and closing > _COLLISION_SPEED_M_S:
            b.collisions += 1
            b.armed = False
    b.last_ms = b.tick
    b.contact_ms += 1.0


@cython.cfunc
@cython.exceptval(check=False)
def _blocked(push: cython.double, b: Body) -> cython.double:
    """Return the share of the wheels' push that acts against the contacts, 0..1."""
    if b.held:
        return 1.0
    c, d = push * cos(b.theta_rad), push * sin(b.theta_rad)
    blocked = 0.0
    for k in range(b.touches):
        blocked = max(blocked, -(c * b.touch_x[k] + d * b.touch_y[k]))
    return blocked


@cython.cfunc
@cython.exceptval(check=False)
def _grip(wheel: Wheel, turn: cython.double, b: Body) -> cython.double:
    """Limit a wheel's rolling speed by traction; return the part of the turn that grips, rad."""
    grip, load_n = wheel.grip_rad_s, wheel.slope_n
    least = grip - (b.traction_n + load_n) * b.rad_s_per_n
    most = grip + (b.traction_n - load_n) * b.rad_s_per_n
    if least <= wheel.rad_s <= most:
        wheel.grip_rad_s = wheel.rad_s
        return turn
    after = least if wheel.rad_s < least else most
    if load_n != 0.0:
        after -= after * (_TICK_S / _BOUNCE_S)
    wheel.grip_rad_s = after
    return 0.5 * (grip + after) * _TICK_S


@cython.cfunc
@cython.exceptval(check=False)
def _pose_tick(ds: cython.double, dth: cython.double, v: cython.double, b: Body) -> cython.void:
    """Move the body by ``ds`` along the tick's midpoint heading, as far as the walls allow."""
    mid = b.theta_rad + 0.5 * dth
    c, d = cos(mid), sin(mid)
    dx, dy = ds * c, ds * d
    travel = fabs(ds)
    walker_step = 0.0
    if b.walker_ms > 0.0:
        b.walker_ms -= 1.0
        b.walker_x_m += b.walker_vx_m_s * _TICK_S
        b.walker_y_m += b.walker_vy_m_s * _TICK_S
        walker_step = hypot(b.walker_vx_m_s, b.walker_vy_m_s) * _TICK_S
    reach = travel + walker_step + _TOUCH_M
    if b.touches == 0 and not b.disturbed:
        b.gap_m -= walker_step
        if not b.gap_m > reach:
            _measure_gap(b)
        if b.gap_m > reach:
            b.gap_m -= travel
            b.x_m += dx
            b.y_m += dy
            b.theta_rad += dth
            b.sway += ds * dth
            b.path_m += travel
            return
    known = b.touches
    c0, d0 = cos(b.theta_rad), sin(b.theta_rad)
    vx, vy = v * c0, v * d0
    if known > 0:
        for k in range(known):
            b.known[k] = b.touch_edge[k]
        vx = b.slide_v_m_s * c0 - b.slide_aside_m_s * d0
        vy = b.slide_v_m_s * d0 + b.slide_aside_m_s * c0
    b.at_x_m, b.at_y_m = b.x_m, b.y_m
    if travel > 0.0 or walker_step > 0.0 or b.disturbed:
        _measure_gap(b)  # renews the list of near edges
        _move(dx, dy, b)
        b.disturbed = False
    ahead, aside = ds, 0.0
    if b.at_x_m != b.x_m + dx or b.at_y_m != b.y_m + dy:
        gone_x, gone_y = b.at_x_m - b.x_m, b.at_y_m - b.y_m
        ahead, aside = gone_x * c + gone_y * d, gone_y * c - gone_x * d
        travel = hypot(gone_x, gone_y)
    b.slide_v_m_s, b.slide_aside_m_s = ahead / _TICK_S, aside / _TICK_S
    b.slide_sway += aside * dth
    b.x_m, b.y_m = b.at_x_m, b.at_y_m
    b.theta_rad += dth
    b.sway += ahead * dth
    b.path_m += travel
    if b.touches > 0:
        _count_contact(vx, vy, known, b)


@cython.cfunc
@cython.exceptval(check=False)
def _tick(b: Body) -> cython.void:
    """Advance by one millisecond."""
    left, right = b.left, b.right
    v = left.travel_m_rad * left.grip_rad_s + right.travel_m_rad * right.grip_rad_s
    b.gravity_x_m_s += b.tilt_x_m_s2 * _TICK_S
    b.gravity_y_m_s += b.tilt_y_m_s2 * _TICK_S
    caster_l = caster_r = 0.0
    yaw_rad_s = right.yaw_rad_rad * right.grip_rad_s - left.yaw_rad_rad * left.grip_rad_s
    aside = b.caster_x_m * yaw_rad_s
    speed = sqrt(v * v + aside * aside)
    if speed > 0.0 and b.caster_n > 0.0:
        straight = 0.5 * b.caster_n * v / speed
        turning = b.caster_n * aside / speed * b.caster_x_m / b.wheel_base_m
        caster_l, caster_r = straight - turning, straight + turning
    blocked_l = blocked_r = 0.0
    volts = fabs(left.volt) + fabs(right.volt)
    if (b.touches > 0 or b.held) and volts > 0.0:
        push = (left.volt + right.volt) / volts
        blocked_v = _blocked(push, b) * b.traction_n * b.load_v_n
        blocked_l = blocked_v if left.volt * push > 0.0 else 0.0
        blocked_r = blocked_v if right.volt * push > 0.0 else 0.0
    turn_l = _turn(left, caster_l, blocked_l, b)
    turn_r = _turn(right, caster_r, blocked_r, b)
    b.tick += 1.0
    if b.lifted or b.held:
        left.grip_rad_s = right.grip_rad_s = b.slide_v_m_s = b.slide_aside_m_s = 0.0
        if b.held and not b.lifted:
            b.last_ms = b.tick
            b.contact_ms += 1.0
        return
    turn_l = _grip(left, turn_l, b)
    turn_r = _grip(right, turn_r, b)
    ds = left.travel_m_rad * turn_l + right.travel_m_rad * turn_r
    dth = right.yaw_rad_rad * turn_r - left.yaw_rad_rad * turn_l
    _pose_tick(ds, dth, v, b)


def advance(ticks: cython.int, left: cython.double, right: cython.double, b: Body) -> None:
    """Advance by ``ticks`` milliseconds.

    Args:
        ticks: Number of milliseconds, at most to the next multiple of ``SLOW_MS``. Parameters are
            constant in this time. 0 only updates the contacts.
        left: Duty of the left motor, -1..1.
        right: Duty of the right motor, -1..1.
        b: The body; the function changes it.

    """
    switch(left, right, b)
    if ticks == 0:
        _measure_gap(b)
        _move(0.0, 0.0, b)
        b.x_m, b.y_m = b.at_x_m, b.at_y_m
    for _ in range(ticks):
        _tick(b)


@cython.ccall
@cython.exceptval(check=False)
def sag(b: Body) -> cython.void:
    """Compute the battery's terminal voltage from its charge and current."""
    charge = b.charge_ah / b.capacity_ah
    ohm = b.battery_ohm
    open_v = b.full_v * (b.empty_ratio + (1.0 - b.empty_ratio) * charge)
    if charge < b.knee:
        depth = 1.0 - charge / b.knee
        open_v *= 1.0 - b.knee_fall * depth
        ohm *= 1.0 + b.knee_resistance * depth
    supply_v = open_v - b.current_a * ohm
    if supply_v < 0.0 or charge == 0.0:
        supply_v = 0.0
    b.open_v, b.supply_v = open_v, supply_v
    if supply_v >= _RAIL_WHOLE_V:
        b.electronics_a = b.electronics_w / supply_v
    else:  # the logic rail draws less power
        b.electronics_a = b.electronics_w / _RAIL_WHOLE_V if supply_v > 0.0 else 0.0


@cython.ccall
@cython.exceptval(check=False)
def discharge_battery(b: Body) -> cython.void:
    """Update the battery with the charge drawn since the last update.

    The voltage was constant in this time, because it depends on the current of the previous period.
    """
    duration_s = (b.tick - b.settled_ms) * _TICK_S
    if duration_s > 0.0:
        electronics_c = b.electronics_a * duration_s
        b.electronics_j += electronics_c * b.supply_v
        charge_c = b.drawn_c - b.settled_c + electronics_c
        b.battery_j += charge_c * b.supply_v
        b.internal_j += charge_c * (b.open_v - b.supply_v)
        b.current_a = charge_c / duration_s
        b.charge_ah = max(0.0, b.charge_ah - charge_c / _SECONDS_PER_HOUR)
        b.settled_ms, b.settled_c = b.tick, b.drawn_c
    sag(b)


@cython.cfunc
@cython.exceptval(check=False)
def _tread_wheel(wheel: Wheel, b: Body) -> cython.void:
    kept = b.unslipped - wheel.slip - wheel.carpet_slip - wheel.extra_slip
    metres = wheel.radius_m * kept if kept > 0.0 else 0.0
    wheel.travel_m_rad, wheel.yaw_rad_rad = 0.5 * metres, metres / b.wheel_base_m


@cython.ccall
@cython.exceptval(check=False)
def tread(b: Body) -> cython.void:
    """Compute the robot's travel and turn per radian of each wheel, after slip."""
    _tread_wheel(b.left, b)
    _tread_wheel(b.right, b)


def felt(b: Body) -> Felt:
    """Return the quantities that the plant reads at every step.

    Returns:
        Position and heading, the angles of both wheels, the specific impulses ahead and to the left
        as in ``Truth``, and the battery voltage.

    """
    left, right = b.left, b.right
    v = left.travel_m_rad * left.grip_rad_s + right.travel_m_rad * right.grip_rad_s
    aside = 0.0
    if b.touches:
        v, aside = b.slide_v_m_s, b.slide_aside_m_s
    return (
        b.x_m,
        b.y_m,
        b.theta_rad,
        left.angle_rad,
        right.angle_rad,
        v - b.slide_sway / _TICK_S + b.gravity_x_m_s,
        aside + b.sway / _TICK_S + b.gravity_y_m_s,
        b.supply_v,
    )


def renew(b: Body) -> Felt:
    """Update battery and slip after ``SLOW_MS``; return what ``felt`` returns.

    Slipping wheels use two random values.
    """
    discharge_battery(b)
    if b.wanders and b.slip_kick > 0.0:
        left, right, at = b.left, b.right, b.slip_at
        left.slip += b.slip_kick * b.slips[at] - b.slip_fade * left.slip
        right.slip += b.slip_kick * b.slips[at + 1] - b.slip_fade * right.slip
        b.slip_at += 2
        tread(b)
    return felt(b)
