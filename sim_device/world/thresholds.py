"""Thresholds of a room, and their effect on a robot: load, height, pitch and roll."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cython
import numpy as np
from cython.cimports.libc.math import cos, fabs, sin, sqrt

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid, Four

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan

_PI = cython.declare(cython.double, math.pi)
_INFINITY = cython.declare(cython.double, math.inf)


def threshold_rows(plan: FloorPlan) -> NDArray[np.float64]:
    """Return one row per threshold: start (2), unit vector to the end (2), length, height (m).

    The shape is ``(thresholds, 6)``.
    """
    rows = []
    for (ax, ay), (bx, by), height_m in plan.thresholds:
        length = math.hypot(bx - ax, by - ay)
        rows.append((ax, ay, (bx - ax) / length, (by - ay) / length, length, height_m))
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


@cython.final
@cython.cclass
class Stance:
    """Geometry and load of a robot's wheels and caster."""

    wheel_base_m = cython.declare(cython.double, visibility="public")
    wheel_radius_m = cython.declare(cython.double, visibility="public")
    caster_x_m = cython.declare(cython.double, visibility="public")
    """Distance of the caster ahead of the axle, m."""
    caster_radius_m = cython.declare(cython.double, visibility="public")
    on_wheel_n = cython.declare(cython.double, visibility="public")
    """Weight on one wheel, N."""
    on_caster_n = cython.declare(cython.double, visibility="public")

    def __init__(  # noqa: PLR0913, PLR0917 - one argument per field
        self,
        wheel_base_m: cython.double,
        wheel_radius_m: cython.double,
        caster_x_m: cython.double,
        caster_radius_m: cython.double,
        on_wheel_n: cython.double,
        on_caster_n: cython.double,
    ) -> None:
        """Store the numbers."""
        self.wheel_base_m, self.wheel_radius_m = wheel_base_m, wheel_radius_m
        self.caster_x_m, self.caster_radius_m = caster_x_m, caster_radius_m
        self.on_wheel_n, self.on_caster_n = on_wheel_n, on_caster_n


@cython.final
@cython.cclass
class Climb:
    """Effect of thresholds on a robot at a pose."""

    load_left_n = cython.declare(cython.double, visibility="public")
    """Force of the robot's weight against the left wheel's forward motion, N."""
    load_right_n = cython.declare(cython.double, visibility="public")
    height_m = cython.declare(cython.double, visibility="public")
    """Height of the axle's centre, m."""
    pitch_rad = cython.declare(cython.double, visibility="public")
    """Pitch, rad, nose up."""
    roll_rad = cython.declare(cython.double, visibility="public")
    """Roll, rad, left side up."""
    away_m = cython.declare(cython.double, visibility="public")
    """Lower bound of the distance to the nearest threshold with an effect, m; 0 on a threshold."""

    def __init__(self) -> None:
        """Start on level ground."""
        self.load_left_n = self.load_right_n = self.height_m = 0.0
        self.pitch_rad = self.roll_rad = self.away_m = 0.0


@cython.cfunc
@cython.exceptval(check=False)
def _hub(x: cython.double, y: cython.double, radius_m: cython.double, rows: FloatGrid) -> Four:
    """Return the height of a wheel's hub on thresholds, its slope (x, y), and ``away_m``.

    A wheel of radius r touches a bar of height h at a distance of √(2rh - h²). Between the two
    contact points, the hub's height is modelled as a cosine, because a soft tyre smooths the sharp
    rise.
    """
    height, slope_x, slope_y, away = 0.0, 0.0, 0.0, _INFINITY
    for i in range(rows.shape[0]):
        to_x, to_y = x - rows[i, 0], y - rows[i, 1]
        along = to_x * rows[i, 2] + to_y * rows[i, 3]
        across = to_y * rows[i, 2] - to_x * rows[i, 3]
        bar = rows[i, 5]
        reach = sqrt(2.0 * radius_m * bar - bar * bar) if bar < radius_m else radius_m
        beyond = max(fabs(across) - reach, -along, along - rows[i, 4])
        away = min(away, beyond)
        if beyond < 0.0:
            height += 0.5 * bar * (1.0 + cos(_PI * across / reach))
            slope = -0.5 * bar * _PI / reach * sin(_PI * across / reach)
            slope_x -= slope * rows[i, 3]
            slope_y += slope * rows[i, 2]
    return height, slope_x, slope_y, max(away, 0.0)


def climb(  # noqa: PLR0913, PLR0917 - positional, because it is called very often
    x_m: cython.double,
    y_m: cython.double,
    theta_rad: cython.double,
    stance: Stance,
    thresholds: FloatGrid,
    felt: Climb,
) -> None:
    """Compute the effect of thresholds on a robot at a pose.

    The robot's potential energy is a function of its pose. The derivative along each wheel's motion
    is the force that this wheel must overcome, including the caster's share.

    Args:
        x_m: Pose of the axle's centre, x.
        y_m: Pose of the axle's centre, y.
        theta_rad: Heading.
        stance: Geometry and load of the robot.
        thresholds: The rows of ``threshold_rows``.
        felt: Output: the effect.

    """
    c, d = cos(theta_rad), sin(theta_rad)
    base, radius, arm = stance.wheel_base_m, stance.wheel_radius_m, stance.caster_x_m
    half = 0.5 * base
    hl, lx, ly, al = _hub(x_m - d * half, y_m + c * half, radius, thresholds)
    hr, rx, ry, ar = _hub(x_m + d * half, y_m - c * half, radius, thresholds)
    hc, cx, cy, ac = _hub(x_m + c * arm, y_m + d * arm, stance.caster_radius_m, thresholds)
    ahead = 0.5 * stance.on_caster_n * (cx * c + cy * d)
    aside = stance.on_caster_n * (cy * c - cx * d) * arm / base
    felt.load_left_n = stance.on_wheel_n * (lx * c + ly * d) + ahead - aside
    felt.load_right_n = stance.on_wheel_n * (rx * c + ry * d) + ahead + aside
    felt.height_m = 0.5 * (hl + hr)
    felt.pitch_rad = (hc - felt.height_m) / arm
    felt.roll_rad = (hl - hr) / base
    felt.away_m = min(al, ar, ac)
