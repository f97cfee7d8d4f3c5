"""Detection that the robot was moved without a measurement by its sensors. No I/O.

The filter cannot detect this. It takes a wall at a wrong place for a new wall, and continues. Two
observations contradict the estimate: the side infrared detects a wall on floor that the robot has
driven over, or the robot drives through a wall of the map. A moved chair or a person causes the
same observations, but only in one place, and the known walls around it still fit. So the evidence
must extend over more than a piece of furniture, and no known wall may be found in between. A known
wall confirms the estimate only across the wall's direction. So it removes only evidence across that
direction. An estimate that is wrong by less than 10 cm causes the same observations near the edge
of the driven floor. So a part of the evidence must be near the axle's path. An observation is no
evidence if it can be explained by the standard deviation of the estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from bridge.motion.estimation.wall_frames import Wall
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount, RobotModel


class Walls(Protocol):
    """The walls of the estimate, as in :class:`bridge.motion.estimation.wall_map.WallMap`."""

    def known(self) -> Iterable[tuple[Wall, float, float]]:
        """Yield every wall with the direction of its normal, rad, and its offset, m."""

    def take_found(self) -> tuple[Wall, float] | None:
        """Return the wall that was last measured again, and its normal, rad.

        Return it only once.
        """


@dataclass(frozen=True, slots=True)
class DisplacementTuning:
    """Limits that separate moved furniture from a moved robot. Tuned with ``campaign.changes``."""

    sigmas: float = 3.0
    """Minimum error of the estimate that an observation must show, in its standard deviations. With
    0, the check ended runs at harsh noise that had errors of 8 and 10 cm, with standard deviations
    of 4 and 7 cm."""
    core: float = 0.5
    """Share of the footprint's radius within which driven floor is free. The rest allows for the
    estimate's error."""
    deep: float = 0.25
    """Share of the footprint's radius that is the maximum distance of deep evidence from the axle's
    path, or of the axle from a wall that it drives through."""
    min_deep_cells: int = 3
    """Minimum number of cells with deep evidence. With 0, harsh noise ended runs with an error of
    4 to 10 cm as if the robot had been moved."""
    max_range_m: float = 0.22
    """Infrared range beyond which a hit is too uncertain, m."""
    min_cells: int = 8
    """Minimum number of 10 cm cells with evidence."""
    min_span_m: float = 1.2
    """Minimum extent of the evidence, m: more than most furniture."""
    min_wall_m: float = 0.5
    """Minimum measured length of a wall that the robot cannot drive through, m."""
    end_m: float = 0.1
    """Length at each end of a measured wall that does not count, m. The estimated wall may be too
    long."""
    known_m: float = 1.0
    """Path after which a new wall of the map counts as a known wall, m."""
    steady_rad_s: float = 0.3
    """Yaw rate above which infrared hits do not count, rad/s."""


_FREE_M = 0.05
"""Length of a cell's edge in the map of the driven floor, m."""
_CELL_M = 0.10
"""Length of a cell's edge in the map of the evidence, m."""
_STEP_M = 0.025
"""Path between two entries in the map of the driven floor, m."""
_FAR_M = 10.0
"""Path that is too long for the time between two readings, m. A longer path means that the estimate
was reset."""


class _Evidence(NamedTuple):
    """Evidence in one cell."""

    across_rad: float
    """Direction across the contradicting wall, rad."""
    deep: bool
    """True if the wall is near the axle's path."""


class DisplacementCheck:
    """Collects evidence that the estimate is wrong. Removes it when known walls are found again."""

    def __init__(self, model: RobotModel, tuning: DisplacementTuning | None = None) -> None:
        """Begin without evidence."""
        self._tuning = tuning or DisplacementTuning()
        self._mounts = (model.infrared_left, model.infrared_right)
        self._radius_m = model.radius_m
        self._core_m = self._tuning.core * model.radius_m
        self._deep_m = self._tuning.deep * model.radius_m
        self._free: dict[tuple[int, int], bool] = {}
        """Cells of the driven floor. True: near the axle's path."""
        self._evidence: dict[tuple[int, int], _Evidence] = {}
        self._last: Pose2 | None = None
        self._path_m = 0.0
        self._since_m = 0.0
        """Path at the first evidence, m."""
        self._known: dict[int, float] = {}
        """Path at which each wall was first measured again, m, by the wall's number."""
        self._confirmed_rad: float | None = None
        """Normal of the wall that confirmed one direction since the estimate was last confirmed."""

    @property
    def evidence(self) -> tuple[int, float]:
        """Number of cells with evidence, and their extent, m."""
        return len(self._evidence), _extent(self._evidence)

    @property
    def displaced(self) -> bool:
        """True if the robot is not at its estimated place."""
        return (
            len(self._evidence) >= self._tuning.min_cells
            and sum(found.deep for found in self._evidence.values()) >= self._tuning.min_deep_cells
            and _extent(self._evidence) >= self._tuning.min_span_m
        )

    def update(
        self,
        pose: Pose2,
        yaw_rate_rad_s: float,
        ranges_m: tuple[float | None, float | None],
        walls: Walls,
        sigma_along_m: Callable[[float], float],
    ) -> bool:
        """Use a reading of the side infrared. Return True if it confirms the estimate.

        The estimate is confirmed if there is no evidence, and known walls in both directions were
        measured since the last confirmation.

        Args:
            pose: estimated pose.
            yaw_rate_rad_s: yaw rate, rad/s.
            ranges_m: left and right infrared range, m; None: nothing in range.
            walls: the walls of the estimate, after this reading.
            sigma_along_m: returns the standard deviation of the position along a direction, m.

        """
        tuning, last = self._tuning, self._last
        step_m = _FAR_M if last is None else pose.distance_m(last)
        confirmed = self._take_matches(walls)
        if last is not None and step_m < _STEP_M:
            return confirmed
        self._last = pose
        self._path_m += min(step_m, _STEP_M * 4.0)
        if abs(yaw_rate_rad_s) < tuning.steady_rad_s:
            for mount, range_m in zip(self._mounts, ranges_m, strict=True):
                if range_m is not None and mount.min_range_m < range_m < tuning.max_range_m:
                    self._take_hit(pose, mount, range_m, sigma_along_m)
        self._take_crossings(pose, walls, sigma_along_m)
        self._enter(pose)
        return confirmed

    # -- internal ------------------------------------------------------------------------------

    def _take_matches(self, walls: Walls) -> bool:
        """Remove evidence across the direction of a known wall that was just measured again."""
        found = walls.take_found()
        if found is None:
            return False
        wall, normal_rad = found
        first_m = self._known.setdefault(wall.number, self._path_m)
        before_m = self._since_m if self._evidence else self._path_m
        if before_m - first_m < self._tuning.known_m:
            return False
        for cell, evidence in list(self._evidence.items()):
            if _is_along(evidence.across_rad, normal_rad):
                del self._evidence[cell]
        if self._confirmed_rad is None:
            self._confirmed_rad = normal_rad
        if self._evidence or _is_along(self._confirmed_rad, normal_rad):
            return False
        self._confirmed_rad = None
        return True

    def _take_hit(
        self,
        pose: Pose2,
        mount: RangerMount,
        range_m: float,
        sigma_along_m: Callable[[float], float],
    ) -> None:
        x, y = pose.transform(
            mount.x_m + range_m * math.cos(mount.yaw_rad),
            mount.y_m + range_m * math.sin(mount.yaw_rad),
        )
        deep = self._free.get((math.floor(x / _FREE_M), math.floor(y / _FREE_M)))
        across_rad = pose.theta_rad + mount.yaw_rad
        if deep is not None and self._exceeds(
            (self._deep_m if deep else self._core_m) + 0.5 * _FREE_M, sigma_along_m(across_rad)
        ):
            self._contradict(x, y, _Evidence(across_rad, deep))

    def _exceeds(self, distance_m: float, sigma_m: float) -> bool:
        """Return True if a wall at a distance from the axle's path is no error of the estimate.

        The hull cannot pass a wall that is nearer to the path than the footprint's radius.
        """
        return self._radius_m - distance_m > self._tuning.sigmas * sigma_m

    def _take_crossings(
        self, pose: Pose2, walls: Walls, sigma_along_m: Callable[[float], float]
    ) -> None:
        """Find walls of the map that the robot drives through."""
        for wall, normal_rad, offset_m in walls.known():
            if wall.seen_m < self._tuning.min_wall_m:
                continue
            c, s = math.cos(normal_rad), math.sin(normal_rad)
            dx, dy = pose.x_m - wall.anchor_x_m, pose.y_m - wall.anchor_y_m
            distance_m = abs(offset_m - dx * c - dy * s)
            if distance_m > self._core_m:
                continue
            end_m = self._tuning.end_m
            if wall.low_m + end_m < dy * c - dx * s < wall.high_m - end_m and self._exceeds(
                distance_m, sigma_along_m(normal_rad)
            ):
                deep = distance_m < self._deep_m
                self._contradict(pose.x_m, pose.y_m, _Evidence(normal_rad, deep))

    def _contradict(self, x_m: float, y_m: float, evidence: _Evidence) -> None:
        if not self._evidence:
            self._since_m = self._path_m
        cell = (math.floor(x_m / _CELL_M), math.floor(y_m / _CELL_M))
        before = self._evidence.setdefault(cell, evidence)
        self._evidence[cell] = before._replace(deep=before.deep or evidence.deep)

    def _enter(self, pose: Pose2) -> None:
        """Add the floor under the robot."""
        reach = math.ceil(self._core_m / _FREE_M)
        column, row = math.floor(pose.x_m / _FREE_M), math.floor(pose.y_m / _FREE_M)
        for i in range(column - reach, column + reach + 1):
            for j in range(row - reach, row + reach + 1):
                x, y = (i + 0.5) * _FREE_M - pose.x_m, (j + 0.5) * _FREE_M - pose.y_m
                if x * x + y * y < self._core_m * self._core_m:
                    deep = x * x + y * y < self._deep_m * self._deep_m
                    self._free[i, j] = deep or self._free.get((i, j), False)


def _extent(cells: Iterable[tuple[int, int]]) -> float:
    columns, rows = [c for c, _ in cells], [r for _, r in cells]
    if not columns:
        return 0.0
    return _CELL_M * math.hypot(max(columns) - min(columns), max(rows) - min(rows))


def _is_along(a_rad: float, b_rad: float) -> bool:
    """Return whether two directions are along the same line rather than orthogonal, rad."""
    return abs(math.cos(a_rad - b_rad)) > math.sqrt(0.5)
