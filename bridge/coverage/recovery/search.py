"""The search for the next target: the lane or perimeter with the largest swept area per time.

In the comparison, transit costs more than its time, and a small piece of unswept floor weighs more
than its area. So the robot sweeps the floor near it first, and seldom returns for a small piece.

The work is split into slices, so that no control step is delayed. On a large floor the robot waits
for some control steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery.lane_kernels import BestLane, LaneCosts, scan_lanes
from bridge.coverage.recovery.travel_kernels import STRAIGHT
from bridge.coverage.recovery.window import Buffers, Point, SearchWindow, Turned, free_cell
from bridge.coverage.recovery.window_kernels import (
    CELL_WEIGHT,
    BestPerimeter,
    PerimeterCosts,
    keep_holes,
    mark_targets,
    scan_perimeters,
    weigh_pieces,
)
from bridge.motion.geometry import Pose2

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from bridge.coverage.recovery.geometry import PlannerGeometry
    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.coverage.recovery.options import RecoveryOptions

_QUARTER = 0.5 * math.pi
_ENOUGH = 60
"""Path cost per cell of (rows + columns) of a box. A search up to this cost counts as complete,
because no path within the box costs more."""
_COPYING, _MARKING, _TURNING, _SCANNING = 0.2, 0.3, 0.4, 0.3
"""Work per cell of a window, relative to the work per cell of the path search."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A lane, perimeter or heading fix, and the path to where it begins."""

    kind: str
    """``lane``, ``perimeter`` or ``heading-fix``."""
    path: tuple[Point, ...]
    """Corner points of the path to the beginning, m, without the robot's own position."""
    heading_rad: float
    """Heading of the lane, or direction along the wall, rad."""
    length_m: float
    new_m2: float = 0.0
    rate_m2_s: float = 0.0
    score_m2_s: float = 0.0
    """Result of the comparison with other targets: the rate, but with the additional weight of
    small pieces and the additional cost of transit, m²/s."""

    @property
    def begin(self) -> Pose2:
        """Pose at the beginning."""
        return Pose2(*self.path[-1], self.heading_rad)


class Chooser:
    """Searches for the next target. It owns the arrays of the search."""

    def __init__(self, options: RecoveryOptions) -> None:
        """Begin with empty arrays. They grow with the map."""
        self._options = options
        self._buffers = Buffers()
        self._spent = 0.0
        self.enclosed = False
        """True if the last search found no start cell, or no path to visited cells."""
        self.unreachable_at: Point | None = None
        """Nearest visited place that the search could not reach, m."""
        self.left_m2 = 0.0
        """Reachable floor that is neither swept nor abandoned, m². It is computed in the last
        search."""
        self.beside_walls_m2 = 0.0
        """Floor that the mouth reaches only if the robot turns towards a wall, m². ``left_m2`` does
        not include it."""

    def search(
        self, evidence_map: EvidenceMap, pose: Pose2, grid_rad: float
    ) -> Generator[None, None, Choice | None]:
        """Search in slices and return the best choice, or None.

        The generator yields at the end of each slice.
        """
        options, geometry = self._options, evidence_map.geometry
        column, row = evidence_map.to_cells(pose.x_m, pose.y_m)
        box = evidence_map.box()
        parts = [_clip(box, int(row), int(column), geometry.path_costs[0] // STRAIGHT), box]
        choice: Choice | None = None
        self._spent = self.left_m2 = 0.0
        self.unreachable_at = None
        for k, max_cost in enumerate(geometry.path_costs):
            part = parts[min(k, 1)]
            if k < len(parts):
                yield from self._spend(_COPYING * _size(part))
                window = SearchWindow(evidence_map, part, options.max_attempts, self._buffers)
                here = window.cell(pose.x_m, pose.y_m)
                start = free_cell(window.open, *here, geometry.snap_cells)
                self.enclosed = start is None
                if start is None:
                    return None
                window.begin(start)
            while not window.search_paths(max_cost, int(options.slice_cells - self._spent)):
                self._spent = 0.0
                yield
            self._spent += window.settled
            choice = yield from self._best(window, max_cost, pose, grid_rad, geometry)
            near_m2_s = geometry.area_m2(geometry.near_rate)
            if choice is not None and choice.score_m2_s >= near_m2_s:
                break
            if part == box and max_cost >= _ENOUGH * (part[1] - part[0] + part[3] - part[2]):
                break
        if choice is None:
            choice = yield from self._best(window, max_cost, pose, grid_rad, geometry, holes=True)
        if choice is None:
            self.beside_walls_m2 = (
                geometry.area_m2(_turning(window, max_cost, geometry)) - self.left_m2
            )
            self.unreachable_at = _parted(evidence_map, window, pose)
            self.enclosed = self.unreachable_at is not None
        return choice

    def path_to(
        self, evidence_map: EvidenceMap, pose: Pose2, points: Sequence[Point]
    ) -> Generator[None, None, tuple[int, tuple[Point, ...]] | None]:
        """Search in slices for the nearest of some points; return its index and the path to it.

        Return None if no path of at most ``search_lengths_m[-1]`` leads to a point. Points at which
        the robot cannot be are skipped.
        """
        options = self._options
        self._spent = 0.0
        box = evidence_map.box()
        yield from self._spend(_COPYING * _size(box))
        window = SearchWindow(evidence_map, box, options.max_attempts, self._buffers)
        here = window.cell(pose.x_m, pose.y_m)
        start = free_cell(window.open, *here, evidence_map.geometry.snap_cells)
        goals = [free_cell(window.open, *window.cell(*point), 1) for point in points]
        if start is None:
            return None
        window.begin(start)
        for max_cost in evidence_map.geometry.path_costs[:-1]:
            while not window.search_paths(max_cost, int(options.slice_cells - self._spent)):
                self._spent = 0.0
                yield
            self._spent += window.settled
            costs = [
                (int(window.dist[goal]), k) for k, goal in enumerate(goals) if goal is not None
            ]
            cost, k = min((each for each in costs if each[0] >= 0), default=(max_cost, -1))
            goal = goals[k]
            if cost < max_cost and goal is not None:
                window.paths[:] = window.dist
                return k, (*window.path(*goal)[:-1], points[k])
        return None

    # -- internal ------------------------------------------------------------------------------

    def _spend(self, cells: float) -> Generator[None]:
        """Count the processed cells. Yield when their number is too large for one control step."""
        if self._spent and self._spent + cells > self._options.slice_cells:
            self._spent = 0.0
            yield
        self._spent += cells

    def _best(  # noqa: PLR0913 - a window, and from where
        self,
        window: SearchWindow,
        max_cost: int,
        pose: Pose2,
        grid_rad: float,
        geometry: PlannerGeometry,
        *,
        holes: bool = False,
    ) -> Generator[None, None, Choice | None]:
        min_rate = geometry.hole_rate if holes else geometry.min_rate
        x, y = window.place(pose)
        yield from self._spend(_MARKING * window.cells)
        left = mark_targets(
            window.dist,
            max_cost,
            window.done,
            window.target,
            window.paths,
            int(window.reach_cells**2),
        )
        self.left_m2 = geometry.area_m2(left)
        if holes:
            yield from self._spend(_MARKING * window.cells)
            hole = self._buffers.layer("hole", window.target.shape)
            left = keep_holes(window.target, hole, geometry.hole_cells)
        perimeter = BestPerimeter()
        costs = _perimeter_costs(geometry, min_rate)
        paths = window.perimeter_lengths
        scan_perimeters(window.open, paths, window.done, y, x, pose.theta_rad, costs, perimeter)
        best = BestLane(), BestLane()
        image: Turned | None = None
        if left >= geometry.min_cells:
            yield from self._spend((_MARKING + _TURNING) * window.cells)
            weigh_pieces(
                window.target,
                window.open,
                window.done,
                window.paths,
                self._buffers.ints("piece", (1, window.cells)).ravel(),
                geometry.return_cells,
                geometry.small_cells,
                geometry.min_cells,
            )
            image = Turned(window, grid_rad, self._buffers)
            for across in range(2):
                yield from self._spend(_SCANNING * window.cells)
                target, paths = image.rows(across=across)
                scan_lanes(
                    target,
                    paths,
                    *image.place(x, y, across=across),
                    pose.theta_rad - grid_rad,
                    _lane_costs(window, across * _QUARTER, min_rate),
                    best[across],
                    self._buffers.ints("sums", (2, target.shape[1])),
                )
        score = max(best[0].score, best[1].score, perimeter.score)
        if score <= 0.0:
            return None
        if perimeter.score == score or image is None:
            return self._perimeter_choice(window, perimeter, geometry)
        across = int(best[1].score > best[0].score)
        return self._lane(window, image, best[across], across)

    def _perimeter_choice(
        self, window: SearchWindow, found: BestPerimeter, geometry: PlannerGeometry
    ) -> Choice:
        return Choice(
            "perimeter",
            window.path(found.row, found.col),
            found.bearing_rad + _QUARTER,
            0.0,
            geometry.area_m2(geometry.perimeter_cells),
            geometry.area_m2(found.rate),
            geometry.area_m2(found.score),
        )

    def _lane(self, window: SearchWindow, image: Turned, found: BestLane, across: int) -> Choice:
        geometry = window.geometry
        begin, end = (found.last, found.first) if found.backwards else (found.first, found.last)
        middle = found.row + 0.5 * (window.lane_rows % 2)
        x, y = image.point(middle, begin + 0.5, across=across)
        heading = image.angle_rad + across * _QUARTER + (math.pi if found.backwards else 0.0)
        path = window.path(int(y), int(x))
        return Choice(
            "lane",
            # use the line of the lane, not the centre of the nearest cell
            (*path[:-1], window.metres(x, y)),
            heading,
            (abs(end - begin) + 1) * geometry.cell_m,
            geometry.area_m2(found.new),
            geometry.area_m2(found.rate),
            geometry.area_m2(found.score),
        )


def _turning(window: SearchWindow, max_cost: int, geometry: PlannerGeometry) -> int:
    """Return the number of unswept cells that the mouth reaches, including by turns in place."""
    return mark_targets(
        window.dist, max_cost, window.done, window.target, window.paths, geometry.turning_cells_2
    )


def _perimeter_costs(geometry: PlannerGeometry, min_rate: float) -> PerimeterCosts:
    return PerimeterCosts(
        speed_cm_s=geometry.lane_speed_m_s * 100.0,
        turn_s_rad=geometry.turn_s_rad,
        stop_s=geometry.stop_s,
        cells=geometry.perimeter_cells,
        full_rate=geometry.full_rate,
        cell_cm=geometry.cell_m * 100.0,
        near_cost=geometry.near_cost,
        beside_cells=geometry.beside_cells,
        transit_share=geometry.transit_share,
        min_rate=min_rate,
    )


def _lane_costs(window: SearchWindow, heading_rad: float, min_rate: float) -> LaneCosts:
    geometry = window.geometry
    return LaneCosts(
        speed_cm_s=geometry.lane_speed_m_s * 100.0,
        turn_s_rad=geometry.turn_s_rad,
        stop_s=geometry.stop_s,
        frontier=geometry.frontier,
        heading_rad=heading_rad,
        cell_cm=geometry.cell_m * 100.0,
        near_cost=geometry.near_cost,
        min_cells=geometry.min_cells,
        gap_cells=geometry.gap_cells,
        rows=window.lane_rows,
        transit_share=geometry.transit_share,
        min_rate=min_rate,
        cell_weight=CELL_WEIGHT,
        ahead_cells=geometry.ahead_cells,
    )


def _parted(evidence_map: EvidenceMap, window: SearchWindow, pose: Pose2) -> Point | None:
    """Return the nearest visited and free place to which there is no path.

    Return None if there are only a few such cells. The map may have grown after the window was
    made.
    """
    rows, cols = window.dist.shape
    column, row = evidence_map.to_cells(*window.metres(0.5, 0.5))
    r0, c0 = int(row), int(column)
    part = np.s_[r0 : r0 + rows, c0 : c0 + cols]
    blocked, visited = evidence_map.places()
    was_there = (visited[part] > 0) & (evidence_map.inflated[part] == 0) & (blocked[part] == 0)
    cells = np.argwhere(was_there & (window.dist < 0))
    if len(cells) < evidence_map.geometry.unreachable_cells:
        return None
    x, y = window.place(pose)
    row, column = cells[np.hypot(cells[:, 0] + 0.5 - y, cells[:, 1] + 0.5 - x).argmin()].tolist()
    return window.metres(column + 0.5, row + 0.5)


def _size(part: tuple[int, int, int, int]) -> int:
    r0, r1, c0, c1 = part
    return (r1 - r0) * (c1 - c0)


def _clip(
    box: tuple[int, int, int, int], row: int, column: int, reach: int
) -> tuple[int, int, int, int]:
    """Clip a box to the cells near a cell."""
    r0, r1, c0, c1 = box
    return (
        max(r0, row - reach),
        min(r1, row + reach + 1),
        max(c0, column - reach),
        min(c1, column + reach + 1),
    )
