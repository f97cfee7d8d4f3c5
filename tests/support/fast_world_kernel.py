"""The compiled kernels of ``fast_world``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
from cython.cimports.libc.math import atan2, cos, exp, fabs, hypot, sin, sqrt

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid, Floats, Pair

_PI = cython.declare(cython.double, math.pi)


@cython.final
@cython.cclass
class _Touch:
    """The nearest wall: its distance, and the unit vector that points away from it."""

    gap: cython.double
    ux: cython.double
    uy: cython.double


@cython.cfunc
@cython.exceptval(check=False)
def _nearest(touch: _Touch, edges: FloatGrid, x: cython.double, y: cython.double) -> cython.void:
    best = 1e18
    bx = 0.0
    by = 1.0
    for i in range(edges.shape[0]):
        ax, ay, ex, ey = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        t = min(max(t, 0.0), 1.0)
        dx, dy = x - ax - t * ex, y - ay - t * ey
        d2 = dx * dx + dy * dy
        if d2 < best:
            best, bx, by = d2, dx, dy
    d = sqrt(best) + 1e-15
    touch.gap, touch.ux, touch.uy = d, bx / d, by / d


@cython.cfunc
@cython.exceptval(check=False)
def _ray(edges: FloatGrid, x: cython.double, y: cython.double, heading: cython.double) -> Pair:
    c, s = cos(heading), sin(heading)
    best = 1e9
    cosine = 0.0
    for i in range(edges.shape[0]):
        ax, ay, ex, ey = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        cross = c * ey - s * ex
        if fabs(cross) < 1e-12:
            continue
        dx, dy = ax - x, ay - y
        along = (dx * ey - dy * ex) / cross
        share = (dx * s - dy * c) / cross
        if 0.0 <= along < best and 0.0 <= share <= 1.0:
            best = along
            cosine = fabs(cross) / sqrt(ex * ex + ey * ey)
    return best, cosine


@cython.cdivision(False)  # noqa: FBT003 - a directive: an angle's remainder has Python's sign
def move(  # noqa: PLR0913, PLR0917 - a kernel
    edges: FloatGrid,
    state: Floats,
    v_cmd: cython.double,
    w_cmd: cython.double,
    radius: cython.double,
    span: cython.double,
) -> None:
    """Move the robot by one control step.

    ``state`` holds: x, y (m), heading (rad), speed (m/s), yaw rate (rad/s), travelled path (m),
    number of collisions, time since the last contact (s), left and right bumper, time in contact
    (s), contact at present.
    """
    sub = 8
    dt = 0.02 / sub
    follow = 1.0 - exp(-dt / 0.05)
    x, y, th, v, w = state[0], state[1], state[2], state[3], state[4]
    left: cython.bint = False
    right: cython.bint = False
    touch: cython.bint
    wall = _Touch()
    for _ in range(sub):
        v += follow * (v_cmd - v)
        w += follow * (w_cmd - w)
        mid = th + 0.5 * w * dt
        nx = x + v * dt * cos(mid)
        ny = y + v * dt * sin(mid)
        th += w * dt
        touch = False
        for _k in range(3):
            _nearest(wall, edges, nx, ny)
            gap, ux, uy = wall.gap, wall.ux, wall.uy
            if gap > radius + 2e-5:
                break
            touch = True
            bearing = (atan2(-uy, -ux) - th + _PI) % (2.0 * _PI) - _PI
            if fabs(bearing) < span:
                left = left or bearing > -0.175
                right = right or bearing < 0.175
            into = -(v * cos(mid) * ux + v * sin(mid) * uy)
            if state[11] < 0.5 and into > 0.03 and state[7] > 0.5:
                state[6] += 1.0
                state[7] = 0.0
            if gap >= radius:
                break
            nx += (radius - gap) * ux
            ny += (radius - gap) * uy
        if touch:
            state[7] = 0.0
            state[10] += dt
            state[11] = 1.0
        else:
            state[7] += dt
            state[11] = 0.0
        state[5] += hypot(nx - x, ny - y)
        x, y = nx, ny
    state[0], state[1], state[2], state[3], state[4] = x, y, th, v, w
    state[8] = 1.0 if left else 0.0
    state[9] = 1.0 if right else 0.0


def sense(  # noqa: PLR0913, PLR0917 - a kernel
    edges: FloatGrid,
    corners: FloatGrid,
    state: Floats,
    out: Floats,
    cone: cython.double,
    front_m: cython.double,
    side_x_m: cython.double,
    side_y_m: cython.double,
) -> None:
    """Write the ranges of the ultrasonic, the left and the right infrared to ``out``.

    The ultrasonic is ``front_m`` ahead of the axle. The left infrared is at ``side_x_m, side_y_m``.
    """
    x, y, th = state[0], state[1], state[2]
    c, s = cos(th), sin(th)
    ux, uy = x + front_m * c, y + front_m * s
    near = 1e9
    for k in range(9):
        r, cosine = _ray(edges, ux, uy, th + cone * (k / 8.0 - 0.5))
        if cosine >= 0.891:
            near = min(near, r)
    limit = cos(0.5 * cone)
    for i in range(corners.shape[0]):
        dx, dy = corners[i, 0] - ux, corners[i, 1] - uy
        d = hypot(dx, dy)
        if d < 1e-6 or d >= near or (dx * c + dy * s) < limit * d:
            continue
        if corners[i, 2] > 0.5 and d > 1.5:
            continue
        r, _ = _ray(edges, ux, uy, atan2(dy, dx))
        if r >= d - 1e-6:
            near = d
    out[0] = near
    for k in range(2):
        side = 1.0 - 2.0 * k
        px = x + side_x_m * c - side * side_y_m * s
        py = y + side_x_m * s + side * side_y_m * c
        r, _ = _ray(edges, px, py, th + side * 0.5 * _PI)
        out[1 + k] = r
