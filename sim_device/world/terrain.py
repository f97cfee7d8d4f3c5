"""Carpets and thresholds of a room, and what a robot feels of them."""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan

    Floats = NDArray[np.float64]


def carpet_rows(plan: FloorPlan) -> Floats:
    """A row per edge of a carpet: both corners (4), the carpet's number, its drag (N), its slip.

    Shape ``(edges, 7)``; the rows of one carpet follow each other.
    """
    rows = [
        (*carpet.polygon[i - 1], *carpet.polygon[i], number, carpet.drag_n, carpet.slip)
        for number, carpet in enumerate(plan.carpets)
        for i in range(len(carpet.polygon))
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def threshold_rows(plan: FloorPlan) -> Floats:
    """A row per threshold: one end (2), the unit vector to the other (2), length, height (m).

    Shape ``(thresholds, 6)``.
    """
    rows = []
    for (ax, ay), (bx, by), height_m in plan.thresholds:
        length = hypot(bx - ax, by - ay)
        rows.append((ax, ay, (bx - ax) / length, (by - ay) / length, length, height_m))
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


@compiled
def carpet_under(x_m: float, y_m: float, carpets: Floats) -> tuple[float, float]:
    """Drag (N) of one wheel that stands at a point, and the share of its travel lost there."""
    drag, slip = 0.0, 0.0
    inside = False
    for i in range(carpets.shape[0]):
        ax, ay, bx, by = carpets[i, 0], carpets[i, 1], carpets[i, 2], carpets[i, 3]
        if (ay > y_m) != (by > y_m) and x_m < (bx - ax) * (y_m - ay) / (by - ay) + ax:
            inside = not inside
        if i + 1 == carpets.shape[0] or carpets[i + 1, 4] != carpets[i, 4]:
            if inside:
                drag += 0.5 * carpets[i, 5]
                slip += carpets[i, 6]
            inside = False
    return drag, min(slip, 1.0)


LOAD_LEFT, LOAD_RIGHT, HEIGHT, PITCH, ROLL, AWAY = range(6)
"""What ``climb`` fills in: weight's push against each wheel (N, against going ahead), height of
the axle's centre (m), the body's tilt (rad: nose up, left side up), and how far the nearest
threshold is from being felt (m, at least; 0 where one is)."""


@compiled
def _hub(x: float, y: float, radius_m: float, rows: Floats) -> tuple[float, float, float, float]:
    """Height of a wheel's hub over its height on the floor, its slope (x, y), and ``AWAY``.

    A wheel of radius r meets a bar of height h at √(2rh - h²) before it; its hub is taken to
    follow a cosine between there and the far side, as a soft tyre rounds the sharp rise.
    """
    height, slope_x, slope_y, away = 0.0, 0.0, 0.0, inf
    for i in range(rows.shape[0]):
        to_x, to_y = x - rows[i, 0], y - rows[i, 1]
        along = to_x * rows[i, 2] + to_y * rows[i, 3]
        across = to_y * rows[i, 2] - to_x * rows[i, 3]
        bar = rows[i, 5]
        reach = sqrt(2.0 * radius_m * bar - bar * bar) if bar < radius_m else radius_m
        beyond = max(abs(across) - reach, -along, along - rows[i, 4])
        away = min(away, beyond)
        if beyond < 0.0:
            height += 0.5 * bar * (1.0 + cos(pi * across / reach))
            slope = -0.5 * bar * pi / reach * sin(pi * across / reach)
            slope_x -= slope * rows[i, 3]
            slope_y += slope * rows[i, 2]
    return height, slope_x, slope_y, max(away, 0.0)


@compiled
def climb(  # noqa: PLR0913, PLR0917 - positional: a compiled call of many a second
    x_m: float,
    y_m: float,
    theta_rad: float,
    stance: Floats,
    thresholds: Floats,
    felt: Floats,
) -> None:
    """Work out what thresholds do to a robot at a pose.

    Weight's energy is a function of the pose, and its slope along each wheel's motion is what
    that wheel has to push, the caster's share included.

    Args:
        x_m: Pose of the axle's centre; so ``y_m``, ``theta_rad``.
        y_m: See ``x_m``.
        theta_rad: See ``x_m``.
        stance: Wheel base, wheel radius, caster's place ahead of the axle, its radius (m), and
            the weight on one wheel and on the caster (N).
        thresholds: As ``threshold_rows`` gives them.
        felt: Filled in, see ``LOAD_LEFT``; six long.

    """
    c, d = cos(theta_rad), sin(theta_rad)
    base, radius, arm = stance[0], stance[1], stance[2]
    on_wheel, on_caster = stance[4], stance[5]
    half = 0.5 * base
    hl, lx, ly, al = _hub(x_m - d * half, y_m + c * half, radius, thresholds)
    hr, rx, ry, ar = _hub(x_m + d * half, y_m - c * half, radius, thresholds)
    hc, cx, cy, ac = _hub(x_m + c * arm, y_m + d * arm, stance[3], thresholds)
    ahead = 0.5 * on_caster * (cx * c + cy * d)
    aside = on_caster * (cy * c - cx * d) * arm / base
    felt[LOAD_LEFT] = on_wheel * (lx * c + ly * d) + ahead - aside
    felt[LOAD_RIGHT] = on_wheel * (rx * c + ry * d) + ahead + aside
    felt[HEIGHT] = 0.5 * (hl + hr)
    felt[PITCH] = (hc - felt[HEIGHT]) / arm
    felt[ROLL] = (hl - hr) / base
    felt[AWAY] = min(al, ar, ac)
