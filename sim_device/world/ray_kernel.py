"""Rays against the room's edges and a round walker, compiled.

All geometry comes as float64 arrays. ``edges`` has a row per edge: corner a (2), the vector e
along it (2), 1/|e|², and the unit vector along it (2). ``walker`` is centre and radius, the
radius 0 where nobody walks. Every callee stands in this file, or the kept machine code would
not notice a change in it.
"""

from __future__ import annotations

from math import cos, hypot, inf, sin, sqrt
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

HIT_RANGE, HIT_COSINE, HIT_EDGE = 0, 1, 2
"""Columns of a hit: range in metres (``inf``: none), cosine of the angle between the ray and
the normal of what it met (1: square on), index of the edge (-1: the walker, or nothing)."""
(EAR_X, EAR_Y, EAR_YAW, EAR_HALF_ANGLE, EAR_COSINE, EAR_REACH, EAR_EDGE_REACH) = range(7)
"""Where a ranger of sound sits, facing where, with which half angle (below π/2); the least cosine
at which a wall echoes; and how far corners do: at all, and those that jut into the floor."""
_SEAM = 1e-9
"""Relative: neighbouring edges share a corner, and no ray shall slip between them."""
_IN_SIGHT_M = 1e-6


@compiled
def _first_hit(  # noqa: PLR0913, PLR0917 - as below
    edges: Floats, walker: Floats, ox: float, oy: float, dx: float, dy: float
) -> tuple[float, float, int]:
    best, cosine, index = inf, 0.0, -1
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
        cosine = abs(dx * edges[index, 6] - dy * edges[index, 5])
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
    return best, cosine, index


@compiled
def cast_beams(  # noqa: PLR0913, PLR0917 - positional: a compiled call of many a second
    edges: Floats,
    walker: Floats,
    x_m: float,
    y_m: float,
    theta_rad: float,
    beams: Floats,
    hits: Floats,
) -> None:
    """Cast beams that are fixed to a body standing at a pose.

    Args:
        edges: Of the room, see the module; shape ``(edges, 7)``.
        walker: See the module; shape ``(3,)``.
        x_m: The body's pose; so ``y_m``, ``theta_rad``.
        y_m: See ``x_m``.
        theta_rad: See ``x_m``.
        beams: Per beam its origin and unit direction in the body's frame; ``(beams, 4)``.
        hits: Filled with what each beam meets first, columns ``HIT_…``; ``(beams, 3)``.

    """
    c, s = cos(theta_rad), sin(theta_rad)
    for k in range(beams.shape[0]):
        bx, by, ux, uy = beams[k, 0], beams[k, 1], beams[k, 2], beams[k, 3]
        hit = _first_hit(
            edges,
            walker,
            x_m + (c * bx - s * by),
            y_m + (s * bx + c * by),
            c * ux - s * uy,
            s * ux + c * uy,
        )
        hits[k, HIT_RANGE], hits[k, HIT_COSINE], hits[k, HIT_EDGE] = hit


@compiled
def echo(  # noqa: PLR0913, PLR0917 - positional: a compiled call of many a second
    edges: Floats,
    walker: Floats,
    corners: Floats,
    x_m: float,
    y_m: float,
    theta_rad: float,
    beams: Floats,
    ear: Floats,
) -> float:
    """Distance to the nearest thing from which a fan of sound comes back; ``inf``: none.

    Args:
        edges: See the module.
        walker: See the module.
        corners: Per corner its place and 1 where it juts into the floor, else 0; ``(n, 3)``.
        x_m: The body's pose; so ``y_m``, ``theta_rad``.
        y_m: See ``x_m``.
        theta_rad: See ``x_m``.
        beams: The fan, as for ``cast_beams``.
        ear: Laid out by ``EAR_…``.

    """
    c, s = cos(theta_rad), sin(theta_rad)
    nearest = inf
    for k in range(beams.shape[0]):
        bx, by, ux, uy = beams[k, 0], beams[k, 1], beams[k, 2], beams[k, 3]
        far, cosine, _ = _first_hit(
            edges,
            walker,
            x_m + (c * bx - s * by),
            y_m + (s * bx + c * by),
            c * ux - s * uy,
            s * ux + c * uy,
        )
        if cosine >= ear[EAR_COSINE] and far < nearest:
            nearest = far
    x_m = x_m + c * ear[EAR_X] - s * ear[EAR_Y]
    y_m = y_m + s * ear[EAR_X] + c * ear[EAR_Y]
    bearing = theta_rad + ear[EAR_YAW]
    ax, ay, narrow = cos(bearing), sin(bearing), cos(ear[EAR_HALF_ANGLE])
    best = min(nearest, ear[EAR_REACH])
    for i in range(corners.shape[0]):
        to_x, to_y = corners[i, 0] - x_m, corners[i, 1] - y_m
        far = hypot(to_x, to_y)
        if far > best or far == 0.0 or to_x * ax + to_y * ay < narrow * far:
            continue
        if corners[i, 2] > 0.0 and far > ear[EAR_EDGE_REACH]:
            continue
        hit, _, _ = _first_hit(edges, walker, x_m, y_m, to_x / far, to_y / far)
        if hit >= far - _IN_SIGHT_M:
            best = nearest = far
    return nearest
