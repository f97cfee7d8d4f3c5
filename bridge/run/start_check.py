"""Check of the start pose: compare range samples at standstill with the room's walls. No I/O.

Each sample is compared with the distance that the room predicts: along the beam of an infrared
sensor, or to the nearest wall in the cone of the ultrasonic sensor. Furniture that the room file
lacks has the same effect as a wrong start pose, so a contradiction is only a warning.
"""

from __future__ import annotations

import math
from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.floor_plan.floor_plan import FloorPlan, Point
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount, RobotModel

    Reading = float | None

BASE_ERROR_M = 0.04
"""Tolerated difference from the predicted distance, m. It allows for the error of a start pose that
a person marked."""
SHARE_ERROR = 0.1
"""Tolerated difference as a share of the distance. It allows for a heading error of a few degrees
and for a dark wall."""
HEADING_ERROR_RAD = 0.1
"""Tolerated error of the start heading, rad: 6°."""
_BEHIND_M = 0.01
"""A wall counts as hidden if a ray towards it hits another wall at least this much earlier, m."""
_RAYS = 15
"""Number of rays that cover the ultrasonic cone and the heading error. They are 2° apart for a cone
of 15°."""


def contradictions(
    plan: FloorPlan,
    model: RobotModel,
    pose: Pose2,
    readings: Sequence[tuple[Reading, Reading, Reading]],
) -> list[str]:
    """Return the sensors that contradict ``pose``, each with measured and expected distance.

    Args:
        plan: The room.
        model: The robot.
        pose: Assumed pose.
        readings: Samples at standstill: ultrasonic, left and right infrared, m; None: no echo.

    """
    found = []
    edges = plan.edges()
    for at, (name, mount) in enumerate(model.rangers.items()):
        if not mount.fitted:
            continue
        measured = _middle([reading[at] for reading in readings])
        origin = pose.transform(mount.x_m, mount.y_m)
        heading = pose.theta_rad + mount.yaw_rad
        near_m, far_m = _expected(edges, origin, heading, mount)
        if not _possible(measured, near_m, far_m, mount):
            shown = "nothing" if measured is None else f"{measured:.2f} m"
            exact_m = near_m if far_m == math.inf else far_m
            exact = "nothing" if exact_m > mount.max_range_m else f"{exact_m:.2f} m"
            found.append(f"{name} reads {shown}, expected {exact}")
    return found


def _middle(values: list[Reading]) -> Reading:
    seen = [value for value in values if value is not None]
    return median(seen) if 2 * len(seen) > len(values) else None


def _expected(
    edges: list[tuple[Point, Point]], origin: Point, heading: float, mount: RangerMount
) -> tuple[float, float]:
    """Return the minimum and maximum expected distance, m; the maximum may be ``inf``."""
    if mount.cone_rad == 0.0:
        exact_m = min((_ray_m(origin, heading, a, b) for a, b in edges), default=math.inf)
        return exact_m, exact_m
    half = 0.5 * mount.cone_rad
    wide = half + HEADING_ERROR_RAD
    near_m = min(
        _ray_m(origin, heading + wide * (2.0 * k / (_RAYS - 1) - 1.0), a, b)
        for a, b in edges
        for k in range(_RAYS)
    )
    # A smooth wall reflects sound back only along its normal. In other directions there may be no
    # echo.
    orthogonal = [_orthogonal(origin, heading, half, a, b) for a, b in edges]
    visible_m = [
        distance_m
        for distance_m, direction in orthogonal
        if min(_ray_m(origin, direction, a, b) for a, b in edges) > distance_m - _BEHIND_M
    ]
    return near_m, min(visible_m, default=math.inf)


def _possible(measured: Reading, near_m: float, far_m: float, mount: RangerMount) -> bool:
    low_m = near_m - BASE_ERROR_M - SHARE_ERROR * near_m
    high_m = far_m + BASE_ERROR_M + SHARE_ERROR * far_m
    if measured is None:
        return high_m >= mount.max_range_m
    return (
        min(low_m, mount.max_range_m - BASE_ERROR_M)
        <= measured
        <= max(high_m, mount.min_range_m + BASE_ERROR_M)
    )


def _ray_m(origin: Point, heading: float, a: Point, b: Point) -> float:
    """Return the distance along a ray to a wall, m; ``inf`` if it misses."""
    dx, dy = math.cos(heading), math.sin(heading)
    ex, ey = b[0] - a[0], b[1] - a[1]
    det = dx * ey - dy * ex
    if det == 0.0:
        return math.inf
    px, py = a[0] - origin[0], a[1] - origin[1]
    along, across = (px * ey - py * ex) / det, (px * dy - py * dx) / det
    return along if along >= 0.0 and 0.0 <= across <= 1.0 else math.inf


def _orthogonal(
    origin: Point, heading: float, half: float, a: Point, b: Point
) -> tuple[float, float]:
    """Return distance and direction of a wall with its normal well inside the cone, or ``inf``."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    length2 = ex * ex + ey * ey
    if length2 == 0.0:
        return math.inf, 0.0
    along = ((origin[0] - a[0]) * ex + (origin[1] - a[1]) * ey) / length2
    qx, qy = a[0] + along * ex - origin[0], a[1] + along * ey - origin[1]
    direction = math.atan2(qy, qx)
    inside = abs(math.remainder(direction - heading, 2.0 * math.pi)) < 0.5 * half
    return (math.hypot(qx, qy) if inside and 0.0 <= along <= 1.0 else math.inf), direction
