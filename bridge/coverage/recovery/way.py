"""Driving along a way of several pieces: where to, and how fast to its end."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.geometry import wrap_angle

if TYPE_CHECKING:
    from bridge.coverage.recovery.choice import Choice
    from bridge.motion.geometry import Pose2

BEND_RAD = math.radians(15.0)
"""A way that bends less is driven on without a turn in place: who drives steers."""
_SLIGHT_RAD = math.radians(10.0)
"""A bend planned below this is below ``BEND_RAD`` from where it is driven, too."""
_BEND_M_S, _CORNER_M_S = 0.12, 0.05
"""Speeds through a bend, and into a turn in place, which takes the rest out."""


def course(pose: Pose2, x_m: float, y_m: float) -> tuple[float, float]:
    """Heading (rad) and way (m) from a pose to a point."""
    dx, dy = x_m - pose.x_m, y_m - pose.y_m
    return math.atan2(dy, dx), math.hypot(dx, dy)


def end_speed(choice: Choice, k: int, heading_rad: float) -> float:
    """Speed (m/s) at the end of the ``k``-th piece of a choice's way, driven on ``heading_rad``."""
    if k + 1 < len(choice.way):
        (x, y), (x1, y1) = choice.way[k : k + 2]
        bend = math.atan2(y1 - y, x1 - x) - heading_rad
    elif choice.kind == "lane":
        bend = choice.heading_rad - heading_rad
    else:  # which way along the wall is decided there
        return _CORNER_M_S
    return _BEND_M_S if abs(wrap_angle(bend)) < _SLIGHT_RAD else _CORNER_M_S
