"""Comparison of the measured walls with the walls of the room file. No I/O.

If the robot does not start at the start pose of the room file, its estimate is still correct
relative to the real start. But the map and the coverage do not fit the room. After a few metres,
the measured walls show the error, and often also the real start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.floor_plan.floor_plan import signed_area_m2
from bridge.motion.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RoomTuning:
    """Limits that separate a wrong start from furniture that the room file lacks.

    All values were tuned with ``campaign.changes``.
    """

    min_wall_m: float = 0.4
    """Minimum length of a measured wall that counts, m."""
    min_total_m: float = 2.0
    """Minimum total length of measured walls for a comparison, m."""
    near_m: float = 0.12
    """Maximum distance from a measured point to its wall in the room, m."""
    parallel_rad: float = math.radians(8.0)
    """Maximum angle between a measured wall and its wall in the room, rad."""
    fits: float = 0.5
    """Minimum share of the measured walls that must fit the room if the start is correct."""
    moved_fits: float = 0.35
    """Share of fitting walls below which the robot was moved during the run, if its walls fitted
    before."""
    other_fits: float = 0.8
    """Minimum share of the measured walls that must fit the room from another start."""
    as_good: float = 0.05
    """Difference in the share of fitting walls below which two starts are equally good. The nearer
    start is then used."""
    strange_m: float = 5.0
    """Minimum total length of measured walls for a report that they do not fit, m. The report then
    appears even if no start explains the error."""


class MeasuredWall(NamedTuple):
    """A measured piece of a wall, m. The floor is on its left."""

    x0_m: float
    y0_m: float
    x1_m: float
    y1_m: float

    @property
    def length_m(self) -> float:
        """Length, m."""
        return math.hypot(self.x1_m - self.x0_m, self.y1_m - self.y0_m)

    @property
    def angle_rad(self) -> float:
        """Direction, rad."""
        return math.atan2(self.y1_m - self.y0_m, self.x1_m - self.x0_m)


class RoomFit(NamedTuple):
    """Result of a comparison."""

    share: float
    """Share of the measured walls that fits walls of the room."""
    start: Pose2 | None
    """Start pose from which the walls fit; None: the room's own start, or no start was found."""

    def off(self, start: Pose2) -> tuple[float, float]:
        """Return distance (m) and turn (rad) from the room file's start to the found start."""
        if self.start is None:
            return 0.0, 0.0
        return self.start.distance_m(start), wrap_angle(self.start.theta_rad - start.theta_rad)


_POINT_M = 0.1
"""Distance between compared points on a measured wall, m."""


class RoomCheck:
    """Compares measured walls with one room."""

    def __init__(self, plan: FloorPlan, tuning: RoomTuning | None = None) -> None:
        """Compare with the walls and obstacles of a room."""
        self._tuning = tuning or RoomTuning()
        self._start = plan.start
        sides = [(plan.walls, 1.0), *((obstacle, -1.0) for obstacle in plan.obstacles)]
        edges = np.array(
            [
                (*polygon[i - 1], *polygon[i])
                for polygon in (
                    p if side * signed_area_m2(p) > 0.0 else p[::-1] for p, side in sides
                )
                for i in range(len(polygon))
            ],
            dtype=np.float64,
        )
        ends = edges[:, 2:] - edges[:, :2]
        self._length = np.hypot(ends[:, 0], ends[:, 1])
        self._edges, self._length = edges[self._length > 0.0], self._length[self._length > 0.0]
        self._along = (self._edges[:, 2:] - self._edges[:, :2]) / self._length[:, None]

    @property
    def tuning(self) -> RoomTuning:
        """The limits."""
        return self._tuning

    def fit(self, walls: Sequence[MeasuredWall], *, seek: bool = True) -> RoomFit | None:
        """Compare the walls with the room; None: the walls are too short for a result.

        ``seek``: search for another start if the walls do not fit.
        """
        tuning = self._tuning
        long = sorted(
            (wall for wall in walls if wall.length_m >= tuning.min_wall_m),
            key=lambda wall: -wall.length_m,
        )
        total_m = sum(wall.length_m for wall in long)
        if total_m < tuning.min_total_m:
            return None
        share = self._share(_points(long), np.zeros(1), np.zeros((1, 2)))[0]
        if share >= tuning.fits:
            return RoomFit(float(share), None)
        start = self._other_start(long) if seek else None
        if seek and start is None and total_m < tuning.strange_m:
            return None
        return RoomFit(float(share), start)

    def _other_start(self, walls: Sequence[MeasuredWall]) -> Pose2 | None:
        """Return the start from which the walls fit the room best; None: no start fits."""
        first = walls[0]
        second = next((wall for wall in walls if _crosses(first, wall)), None)
        if second is None:
            return None
        turns, shifts = [], []
        for i, j in product(self._longer(first), self._longer(second)):
            turn = wrap_angle(self._angle(i) - first.angle_rad)
            if (
                abs(wrap_angle(self._angle(j) - second.angle_rad - turn))
                < self._tuning.parallel_rad
            ):
                turns.append(turn)
                shifts.append(self._shift(first, second, i, j, turn))
        if not turns:
            return None
        shares = self._share(_points(walls), np.array(turns), np.array(shifts))
        best = float(shares.max())
        if best < self._tuning.other_fits:
            return None
        starts = [
            _moved(self._start, turns[k], shifts[k])
            for k in np.flatnonzero(shares >= best - self._tuning.as_good).tolist()
        ]
        return min(starts, key=lambda start: start.distance_m(self._start))

    def _longer(self, wall: MeasuredWall) -> list[int]:
        margin_m = 2.0 * self._tuning.near_m
        found: list[int] = np.flatnonzero(self._length >= wall.length_m - margin_m).tolist()
        return found

    def _angle(self, edge: int) -> float:
        return math.atan2(self._along[edge, 1], self._along[edge, 0])

    def _shift(
        self, first: MeasuredWall, second: MeasuredWall, i: int, j: int, turn_rad: float
    ) -> tuple[float, float]:
        """Return the shift, m, that puts both turned walls on the lines of two edges."""
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        rows, values = np.empty((2, 2)), np.empty(2)
        for k, (wall, edge) in enumerate(((first, i), (second, j))):
            normal = np.array([-self._along[edge, 1], self._along[edge, 0]])
            x, y = 0.5 * (wall.x0_m + wall.x1_m), 0.5 * (wall.y0_m + wall.y1_m)
            turned = np.array([c * x - s * y, s * x + c * y])
            rows[k], values[k] = normal, normal @ (self._edges[edge, :2] - turned)
        dx, dy = np.linalg.solve(rows, values).tolist()
        return dx, dy

    def _share(self, points: Floats, turns_rad: Floats, shifts_m: Floats) -> Floats:
        """Return the share of points (x, y, direction) on walls of the room, for each motion."""
        c, s = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
        x = c * points[:, 0] - s * points[:, 1] + shifts_m[:, :1]
        y = s * points[:, 0] + c * points[:, 1] + shifts_m[:, 1:]
        angle = points[:, 2] + turns_rad[:, None]
        on = np.zeros(x.shape, dtype=bool)
        limit = math.cos(self._tuning.parallel_rad)
        for (ax, ay, _, _), (tx, ty), length in zip(
            self._edges, self._along, self._length, strict=True
        ):
            dx, dy = x - ax, y - ay
            along, across = dx * tx + dy * ty, dy * tx - dx * ty
            near = self._tuning.near_m
            parallel = np.cos(angle) * tx + np.sin(angle) * ty > limit
            on |= parallel & (np.abs(across) < near) & (along > -near) & (along < length + near)
        shares: Floats = on.mean(axis=1)
        return shares


def _moved(pose: Pose2, turn_rad: float, shift_m: tuple[float, float]) -> Pose2:
    """Return a pose turned about the origin and then shifted."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    x, y, theta = pose
    return Pose2(
        c * x - s * y + shift_m[0], s * x + c * y + shift_m[1], wrap_angle(theta + turn_rad)
    )


def _points(walls: Sequence[MeasuredWall]) -> Floats:
    points = []
    for wall in walls:
        count = max(round(wall.length_m / _POINT_M), 2)
        for k in range(count):
            share = (k + 0.5) / count
            points.append(
                (
                    wall.x0_m + share * (wall.x1_m - wall.x0_m),
                    wall.y0_m + share * (wall.y1_m - wall.y0_m),
                    wall.angle_rad,
                )
            )
    return np.array(points)


def _crosses(one: MeasuredWall, other: MeasuredWall) -> bool:
    return abs(math.sin(one.angle_rad - other.angle_rad)) > math.sqrt(0.5)
