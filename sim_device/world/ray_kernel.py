"""Compiled kernel for ray casts against the room's edges and a walking person (a disc).

All geometry is in float64 arrays. ``edges`` has one row per edge: first corner (2), vector e along
the edge (2), 1/|e|², and unit vector along the edge (2). ``walker`` contains centre (2) and radius;
radius 0 means no person.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
from cython.cimports.libc.math import cos, fabs, hypot, sin, sqrt

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid, Floats

HIT_RANGE, HIT_COSINE, HIT_EDGE = 0, 1, 2
"""Columns of a ray's first hit: range, m (``inf``: no hit); cosine of the angle between ray and
surface normal (1: perpendicular); index of the edge (-1: the walker, or no hit)."""
_INFINITY = cython.declare(cython.double, math.inf)
_SEAM = cython.declare(cython.double, 1e-9)
"""Relative tolerance at the ends of an edge. Neighbouring edges share a corner, and the tolerance
prevents a ray from passing between them."""
_IN_SIGHT_M = cython.declare(cython.double, 1e-6)


@cython.final
@cython.cclass
class UltrasonicGeometry:
    """Geometry of an ultrasonic ranger, in the body's frame."""

    x_m = cython.declare(cython.double, visibility="public")
    y_m = cython.declare(cython.double, visibility="public")
    yaw_rad = cython.declare(cython.double, visibility="public")
    half_angle_rad = cython.declare(cython.double, visibility="public")
    """Half angle of the cone, rad, below π/2."""
    cosine = cython.declare(cython.double, visibility="public")
    """Minimum cosine of the angle between ray and wall normal at which a wall gives an echo."""
    reach_m = cython.declare(cython.double, visibility="public")
    """Maximum range at which corners of the room give an echo, m."""
    edge_reach_m = cython.declare(cython.double, visibility="public")
    """Maximum range at which convex corners (corners of obstacles) give an echo, m."""

    def __init__(  # noqa: PLR0913, PLR0917 - one argument per field
        self,
        x_m: cython.double,
        y_m: cython.double,
        yaw_rad: cython.double,
        half_angle_rad: cython.double,
        cosine: cython.double,
        reach_m: cython.double,
        edge_reach_m: cython.double,
    ) -> None:
        """Store the numbers."""
        self.x_m, self.y_m, self.yaw_rad = x_m, y_m, yaw_rad
        self.half_angle_rad, self.cosine = half_angle_rad, cosine
        self.reach_m, self.edge_reach_m = reach_m, edge_reach_m


@cython.final
@cython.cclass
class _Hit:
    """The first hit of a ray."""

    range_m: cython.double
    """Range of the hit, m; infinite: no hit."""
    cosine: cython.double
    """Cosine of the angle between the ray and the surface normal."""
    edge: cython.int
    """Index of the edge; -1: the walker, or no hit."""


@cython.cfunc
@cython.exceptval(check=False)
def _first_hit(  # noqa: PLR0913, PLR0917 - scalars for C
    hit: _Hit,
    edges: FloatGrid,
    walker: Floats,
    ox: cython.double,
    oy: cython.double,
    dx: cython.double,
    dy: cython.double,
) -> cython.void:
    best: cython.double = _INFINITY
    cosine: cython.double = 0.0
    index: cython.int = -1
    i: cython.int
    for i in range(edges.shape[0]):
        ex, ey = edges[i, 2], edges[i, 3]
        cross = dx * ey - dy * ex
        if cross == 0.0:
            continue
        ao_x, ao_y = edges[i, 0] - ox, edges[i, 1] - oy
        t = (ao_x * ey - ao_y * ex) / cross
        if t < 0.0 or t >= best:
            continue
        u = (ao_x * dy - ao_y * dx) / cross
        if -_SEAM <= u <= 1.0 + _SEAM:
            best, index = t, i
    if index >= 0:
        cosine = fabs(dx * edges[index, 6] - dy * edges[index, 5])
    radius = walker[2]
    if radius > 0.0:
        to_x, to_y = walker[0] - ox, walker[1] - oy
        along = to_x * dx + to_y * dy
        off2 = to_x * to_x + to_y * to_y - along * along
        inside = to_x * to_x + to_y * to_y <= radius * radius
        if inside or (along > 0.0 and off2 <= radius * radius):
            half = sqrt(max(0.0, radius * radius - off2))
            t = 0.0 if inside else along - half
            if t < best:
                best, cosine, index = t, 1.0 if inside else half / radius, -1
    hit.range_m, hit.cosine, hit.edge = best, cosine, index


@cython.cfunc
@cython.exceptval(check=False)
def _cast(  # noqa: PLR0913, PLR0917 - scalars for C
    hit: _Hit,
    edges: FloatGrid,
    walker: Floats,
    x_m: cython.double,
    y_m: cython.double,
    c: cython.double,
    s: cython.double,
    beams: FloatGrid,
    k: cython.Py_ssize_t,
) -> cython.void:
    """Find the first hit of one beam that is fixed to a body; heading as cosine and sine."""
    bx, by, ux, uy = beams[k, 0], beams[k, 1], beams[k, 2], beams[k, 3]
    _first_hit(
        hit,
        edges,
        walker,
        x_m + (c * bx - s * by),
        y_m + (s * bx + c * by),
        c * ux - s * uy,
        s * ux + c * uy,
    )


def cast_beams(  # noqa: PLR0913, PLR0917 - positional, because it is called very often
    edges: FloatGrid,
    walker: Floats,
    x_m: cython.double,
    y_m: cython.double,
    theta_rad: cython.double,
    beams: FloatGrid,
    hits: FloatGrid,
) -> None:
    """Cast beams that are fixed to a body at a pose.

    Args:
        edges: Edges of the room as described in the module docstring; shape ``(edges, 7)``.
        walker: Centre and radius of the walker; shape ``(3,)``.
        x_m: Pose of the body, x.
        y_m: Pose of the body, y.
        theta_rad: Pose of the body, heading.
        beams: Origin and unit direction of each beam in the body's frame; shape ``(beams, 4)``.
        hits: Output: the first hit of each beam, with columns ``HIT_…``; shape ``(beams, 3)``.

    """
    hit = _Hit()
    c, s = cos(theta_rad), sin(theta_rad)
    for k in range(beams.shape[0]):
        _cast(hit, edges, walker, x_m, y_m, c, s, beams, k)
        # in the order of HIT_RANGE, HIT_COSINE, HIT_EDGE
        hits[k, 0], hits[k, 1], hits[k, 2] = hit.range_m, hit.cosine, hit.edge


def echo(  # noqa: PLR0913, PLR0917 - positional, because it is called very often
    edges: FloatGrid,
    walker: Floats,
    corners: FloatGrid,
    x_m: cython.double,
    y_m: cython.double,
    theta_rad: cython.double,
    beams: FloatGrid,
    ear: UltrasonicGeometry,
) -> float:
    """Return the distance to the nearest surface that gives an echo, m; ``inf``: none.

    Args:
        edges: As for ``cast_beams``.
        walker: As for ``cast_beams``.
        corners: Place of each corner, and 1 if the corner is convex (an obstacle's corner), else 0;
            shape ``(n, 3)``.
        x_m: Pose of the body, x.
        y_m: Pose of the body, y.
        theta_rad: Pose of the body, heading.
        beams: The rays in the cone, as for ``cast_beams``.
        ear: Geometry of the ranger.

    """
    hit = _Hit()
    c, s = cos(theta_rad), sin(theta_rad)
    nearest: cython.double = _INFINITY
    for k in range(beams.shape[0]):
        _cast(hit, edges, walker, x_m, y_m, c, s, beams, k)
        if hit.cosine >= ear.cosine and hit.range_m < nearest:
            nearest = hit.range_m
    x_m = x_m + c * ear.x_m - s * ear.y_m
    y_m = y_m + s * ear.x_m + c * ear.y_m
    bearing = theta_rad + ear.yaw_rad
    ax, ay, narrow = cos(bearing), sin(bearing), cos(ear.half_angle_rad)
    best = min(nearest, ear.reach_m)
    for i in range(corners.shape[0]):
        to_x, to_y = corners[i, 0] - x_m, corners[i, 1] - y_m
        far = hypot(to_x, to_y)
        if far > best or far == 0.0 or to_x * ax + to_y * ay < narrow * far:
            continue
        if corners[i, 2] > 0.0 and far > ear.edge_reach_m:
            continue
        _first_hit(hit, edges, walker, x_m, y_m, to_x / far, to_y / far)
        if hit.range_m >= far - _IN_SIGHT_M:
            best = nearest = far
    return nearest
