"""The room as numbers: edges and corners in arrays, ray casts, distances to a point.

Immutable and without state: what moves (the robot) asks it. Obstacles and outer walls are
one set of edges; which side is floor only matters for corners and for the start check.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bridge.coverage.floorplan import FloorPlanError, contains, signed_area_m2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.coverage.floorplan import FloorPlan, Point
    from bridge.motion.robot_model import RobotModel

    Floats = NDArray[np.float64]

START_OVERLAP_M = 1e-6
"""How far the start disc may stick into a wall: rounding in a room file, not a mistake."""

_SEAM = 1e-9
"""Relative: neighbouring edges share a corner, and no ray shall slip between them."""

Edge = tuple[float, float, float, float, float, int]
"""``(ax, ay, ex, ey, 1/|e|², index)``: from corner a along e, for loops in plain Python."""


class StartBlockedError(FloorPlanError):
    """The robot's disc does not fit where the room file starts it."""

    def __init__(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        overlap_m: float | None,
    ) -> None:
        """Keep the start, the disc's radius and how far it sticks into a wall (m).

        ``None``: the disc's centre itself is not on the floor.
        """
        self.x_m, self.y_m, self.radius_m, self.overlap_m = x_m, y_m, radius_m, overlap_m
        what = (
            "stands in a wall or an obstacle"
            if overlap_m is None
            else f"overlaps a wall or an obstacle by {1000.0 * overlap_m:.1f} mm"
        )
        super().__init__(f"start: the robot (radius {radius_m:g} m) at ({x_m:g}, {y_m:g}) {what}")


class Nearest(NamedTuple):
    """The point of the walls and obstacles closest to some place on the floor."""

    distance_m: float
    x_m: float
    y_m: float
    normal_x: float
    """Unit vector from the wall's point to the place asked about; (0, 0) on the wall."""
    normal_y: float


class World:
    """A floor plan, checked to hold the robot at its start.

    Raises:
        StartBlockedError: the start disc overlaps a wall or an obstacle, or stands in one.

    """

    def __init__(self, plan: FloorPlan, model: RobotModel) -> None:
        """Take the room and the robot's radius; see the class for errors."""
        self.plan = plan
        self.radius_m = model.radius_m
        pairs = [(a, b) for a, b in plan.edges() if a != b]
        a = np.array([p for p, _ in pairs], dtype=np.float64)
        b = np.array([q for _, q in pairs], dtype=np.float64)
        self._ax, self._ay = a[:, 0].copy(), a[:, 1].copy()
        self._ex, self._ey = (b - a)[:, 0].copy(), (b - a)[:, 1].copy()
        length2 = self._ex**2 + self._ey**2
        self._inv_len2 = 1.0 / length2
        inv_len = np.sqrt(self._inv_len2)
        self._ux, self._uy = self._ex * inv_len, self._ey * inv_len
        self._edges: list[Edge] = [
            (*row, i)
            for i, row in enumerate(
                zip(
                    self._ax.tolist(),
                    self._ay.tolist(),
                    self._ex.tolist(),
                    self._ey.tolist(),
                    self._inv_len2.tolist(),
                    strict=True,
                ),
            )
        ]
        corners = [*_corners(plan.walls, floor_inside=True)]
        for obstacle in plan.obstacles:
            corners += _corners(obstacle, floor_inside=False)
        self.corner_x_m = np.array([c[0] for c in corners], dtype=np.float64)
        self.corner_y_m = np.array([c[1] for c in corners], dtype=np.float64)
        self.corner_juts = np.array([c[2] for c in corners], dtype=np.bool_)
        """Per corner: True where it juts into the floor (an obstacle's corner), False where
        the floor ends in it (a room's corner)."""
        self._check_start()

    @property
    def edge_count(self) -> int:
        """Number of wall and obstacle edges."""
        return len(self._edges)

    def is_floor(self, x_m: float, y_m: float) -> bool:
        """Whether a point lies inside the walls and in no obstacle."""
        return contains(self.plan.walls, x_m, y_m) and not any(
            contains(o, x_m, y_m) for o in self.plan.obstacles
        )

    def nearest(self, x_m: float, y_m: float) -> Nearest:
        """Find the wall point closest to (x, y), exact, over every edge."""
        qx, qy, d2 = self._closest(x_m, y_m)
        i = int(np.argmin(d2))
        distance = float(np.sqrt(d2[i]))
        wall_x, wall_y = float(qx[i]), float(qy[i])
        if distance == 0.0:
            return Nearest(0.0, wall_x, wall_y, 0.0, 0.0)
        nx, ny = (x_m - wall_x) / distance, (y_m - wall_y) / distance
        return Nearest(distance, wall_x, wall_y, nx, ny)

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Gap between the robot's disc centred at (x, y) and the nearest wall; < 0: overlap.

        Only meaningful for a centre on the floor.
        """
        return self.nearest(x_m, y_m).distance_m - self.radius_m

    def edges_near(self, x_m: float, y_m: float, within_m: float) -> list[Edge]:
        """Edges with a point within ``within_m`` of (x, y)."""
        _, _, d2 = self._closest(x_m, y_m)
        return [self._edges[i] for i in np.flatnonzero(d2 <= within_m * within_m).tolist()]

    def cast(
        self,
        origin_x: Floats,
        origin_y: Floats,
        dir_x: Floats,
        dir_y: Floats,
    ) -> tuple[Floats, Floats]:
        """Cast rays against every edge.

        Args:
            origin_x: Ray origins, metres, shape ``(rays,)``; so ``origin_y``.
            origin_y: See ``origin_x``.
            dir_x: Unit directions, shape ``(rays,)``; so ``dir_y``.
            dir_y: See ``dir_x``.

        Returns:
            Range to the first hit in metres (``inf``: none) and the cosine of the angle
            between ray and wall normal there (1: square on), each of shape ``(rays,)``.

        """
        ao_x = self._ax - origin_x[:, None]
        ao_y = self._ay - origin_y[:, None]
        dx, dy = dir_x[:, None], dir_y[:, None]
        cross: Any = dx * self._ey - dy * self._ex
        parallel = cross == 0.0
        cross[parallel] = 1.0
        t: Any = (ao_x * self._ey - ao_y * self._ex) / cross
        u: Any = (ao_x * dy - ao_y * dx) / cross
        miss = (u < -_SEAM) | (u > 1.0 + _SEAM) | (t < 0.0) | parallel
        t[miss] = np.inf
        first = t.argmin(axis=1)
        ranges: Floats = t[np.arange(len(first)), first]
        cos_incidence: Floats = np.abs(dir_x * self._uy[first] - dir_y * self._ux[first])
        return ranges, cos_incidence

    def _closest(self, x_m: float, y_m: float) -> tuple[Floats, Floats, Floats]:
        dx, dy = x_m - self._ax, y_m - self._ay
        t: Any = (dx * self._ex + dy * self._ey) * self._inv_len2
        np.minimum(np.maximum(t, 0.0, out=t), 1.0, out=t)
        qx, qy = self._ax + t * self._ex, self._ay + t * self._ey
        return qx, qy, (x_m - qx) ** 2 + (y_m - qy) ** 2

    def _check_start(self) -> None:
        start = self.plan.start
        if not self.is_floor(start.x_m, start.y_m):
            raise StartBlockedError(start.x_m, start.y_m, self.radius_m, None)
        overlap = -self.clearance_m(start.x_m, start.y_m)
        if overlap > START_OVERLAP_M:
            raise StartBlockedError(start.x_m, start.y_m, self.radius_m, overlap)


def _corners(
    polygon: tuple[Point, ...],
    *,
    floor_inside: bool,
) -> list[tuple[float, float, bool]]:
    """Corners with whether each juts into the floor."""
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
        if turn != 0.0:  # a corner of 180 degrees is no corner
            out.append((here[0], here[1], (turn > 0.0) != floor_inside))
    return out
