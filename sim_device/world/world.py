"""Geometry of the room: arrays of edges and corners, ray casts, and distances to a point.

A world is immutable. Obstacles and outer walls form one set of edges. Only the corners and the
start check distinguish the floor side of an edge. A walker (a person's leg) is an additional disc.
A world with another walker shares all arrays with the original world, so it is fast to create.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.floor_plan.floor_plan import check_robot_fits, contains, signed_area_m2
from sim_device.world.carpets import carpet_rows
from sim_device.world.ray_kernel import HIT_COSINE, HIT_RANGE, UltrasonicGeometry, cast_beams, echo
from sim_device.world.thresholds import threshold_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan, Point
    from bridge.motion.robot_model import RobotModel

    Floats = NDArray[np.float64]

_AT_ORIGIN = (0.0, 0.0, 0.0)


class Nearest(NamedTuple):
    """The point of a wall or obstacle that is closest to a place on the floor."""

    distance_m: float
    x_m: float
    y_m: float
    normal_x: float
    """Unit vector from this point to the place, x component; (0, 0) for a place on the wall."""
    normal_y: float


class World:
    """Geometry of a floor plan with a free start place.

    Raises:
        StartBlockedError: the start disc overlaps a wall, or overlaps or is inside an obstacle.

    """

    def __init__(self, plan: FloorPlan, model: RobotModel, *, check_start: bool = True) -> None:
        """Create the geometry for a robot with the model's radius.

        With ``check_start`` false, the start place may be blocked, because the robot is already
        elsewhere.
        """
        self.plan = plan
        self.radius_m = model.radius_m
        pairs = [(a, b) for a, b in plan.edges() if a != b]
        a = np.array([p for p, _ in pairs], dtype=np.float64)
        e = np.array([q for _, q in pairs], dtype=np.float64) - a
        inv_len2 = 1.0 / (e * e).sum(axis=1)
        self.edges: Floats = np.ascontiguousarray(
            np.column_stack([a, e, inv_len2, e * np.sqrt(inv_len2)[:, None]]),
        )
        """Edges in the format of ``ray_kernel``, one row per edge; read-only."""
        self.walker: Floats = np.zeros(3)
        """Centre and radius of the walker, m; radius 0: no walker."""
        self.carpets: Floats = carpet_rows(plan)
        self.thresholds: Floats = threshold_rows(plan)
        corners = [*_corners(plan.walls, floor_inside=True)]
        for obstacle in plan.obstacles:
            corners += _corners(obstacle, floor_inside=False)
        self.corners: Floats = np.array(corners, dtype=np.float64).reshape(-1, 3)
        """Corners in the format of ``ray_kernel``, one row per corner: x and y, m, and 1 if the
        corner is convex (an obstacle's corner) or 0 if it is concave (a corner of the room)."""
        if check_start:
            check_robot_fits(plan, self.radius_m)

    def with_walker(self, x_m: float, y_m: float, radius_m: float) -> World:
        """Return a world with a round walker; radius 0 removes the walker."""
        made = copy.copy(self)
        made.walker = np.array([x_m, y_m, radius_m])
        return made

    def is_floor(self, x_m: float, y_m: float) -> bool:
        """Return True if a point is inside the walls and outside all obstacles."""
        return contains(self.plan.walls, x_m, y_m) and not any(
            contains(o, x_m, y_m) for o in self.plan.obstacles
        )

    def nearest(self, x_m: float, y_m: float) -> Nearest:
        """Return the wall point closest to (x, y), computed exactly over all edges."""
        qx, qy, d2 = self._closest(x_m, y_m)
        i = int(np.argmin(d2))
        distance = float(np.sqrt(d2[i]))
        wall_x, wall_y = float(qx[i]), float(qy[i])
        if distance == 0.0:
            return Nearest(0.0, wall_x, wall_y, 0.0, 0.0)
        nx, ny = (x_m - wall_x) / distance, (y_m - wall_y) / distance
        return Nearest(distance, wall_x, wall_y, nx, ny)

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Return the gap between the robot's disc at (x, y) and the nearest wall, m; < 0: overlap.

        The result is valid only if (x, y) is on the floor.
        """
        return self.nearest(x_m, y_m).distance_m - self.radius_m

    def edges_near(self, x_m: float, y_m: float, within_m: float) -> list[int]:
        """Return the indices of the edges with a point within ``within_m`` of (x, y)."""
        _, _, d2 = self._closest(x_m, y_m)
        near: list[int] = np.flatnonzero(d2 <= within_m * within_m).tolist()
        return near

    def cast_beams(self, pose: tuple[float, float, float], beams: Floats, hits: Floats) -> None:
        """Cast beams that are fixed to a body at ``pose`` (x and y in metres, heading in radians).

        Args:
            pose: Pose of the body.
            beams: Origin and unit direction in the body's frame; float64, ``(beams, 4)``.
            hits: Output, one row per beam: range (m, ``inf``: no hit), cosine of the angle of
                incidence (1: perpendicular) and edge index (-1: walker or no hit); float64,
                ``(beams, 3)``.

        """
        cast_beams(self.edges, self.walker, pose[0], pose[1], pose[2], beams, hits)

    def echo_m(
        self, pose: tuple[float, float, float], beams: Floats, ear: UltrasonicGeometry
    ) -> float:
        """Return the distance to the nearest echo, m; ``inf``: none.

        ``pose`` and ``beams`` are as for ``cast_beams``.
        """
        x_m, y_m, theta_rad = pose
        return echo(self.edges, self.walker, self.corners, x_m, y_m, theta_rad, beams, ear)

    def cast(
        self,
        origin_x: Floats,
        origin_y: Floats,
        dir_x: Floats,
        dir_y: Floats,
    ) -> tuple[Floats, Floats]:
        """Cast rays against all edges and the walker.

        Args:
            origin_x: Ray origins, x, m, shape ``(rays,)``.
            origin_y: Ray origins, y, m, shape ``(rays,)``.
            dir_x: Unit directions, x, shape ``(rays,)``.
            dir_y: Unit directions, y, shape ``(rays,)``.

        Returns:
            Range to the first hit in metres (``inf``: none), and the cosine of the angle between
            ray and wall normal (1: perpendicular), each of shape ``(rays,)``.

        """
        hits = np.empty((len(origin_x), 3))
        rays = np.ascontiguousarray(np.column_stack([origin_x, origin_y, dir_x, dir_y]))
        self.cast_beams(_AT_ORIGIN, rays, hits)
        return hits[:, HIT_RANGE], hits[:, HIT_COSINE]

    def _closest(self, x_m: float, y_m: float) -> tuple[Floats, Floats, Floats]:
        ax, ay, ex, ey, inv_len2 = self.edges.T[:5]
        along = np.clip(((x_m - ax) * ex + (y_m - ay) * ey) * inv_len2, 0.0, 1.0)
        qx, qy = ax + along * ex, ay + along * ey
        return qx, qy, (x_m - qx) ** 2 + (y_m - qy) ** 2


def _corners(
    polygon: tuple[Point, ...],
    *,
    floor_inside: bool,
) -> list[tuple[float, float, bool]]:
    """Return the corners, each with a flag that is 1 for a convex corner."""
    if signed_area_m2(polygon) < 0.0:
        polygon = polygon[::-1]
    out: list[tuple[float, float, bool]] = []
    for before, here, after in zip(
        polygon[-1:] + polygon[:-1],
        polygon,
        polygon[1:] + polygon[:1],
        strict=True,
    ):
        turn = (here[0] - before[0]) * (after[1] - here[1]) - (here[1] - before[1]) * (
            after[0] - here[0]
        )
        if turn != 0.0:  # 180 degrees is not a corner
            out.append((here[0], here[1], (turn > 0.0) != floor_inside))
    return out
