"""The planner's map: the swept floor, and the places where the axle cannot be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery import packed
from bridge.coverage.recovery.cliffs import SPAN_RAD, Cliffs
from bridge.coverage.recovery.evidence_kernels import (
    MAX_EVIDENCE,
    SURE,
    add_wall,
    beam,
    bump_area,
    clear_body,
    fresh_ahead,
    speed_limit_m_s,
    sweep,
)
from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.motion.legs import StopReason
from bridge.motion.observation import INFRARED_PERIOD_S

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.coverage.recovery.packed import PackedMap
    from bridge.motion.control.braking import Braking
    from bridge.motion.geometry import Pose2
    from bridge.motion.legs import LegResult
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RangerMount, RobotModel

    Layer = NDArray[np.uint8]
    Ints = NDArray[np.intp]

_FIRST_M = 3.0
"""Half the edge length of the first map, m."""
_GROW_M = 1.5
"""Length by which the map grows, m."""
_NEAR_M = 0.6
"""Distance of the robot from the map's border below which the map grows, m."""
_POINT = 2
"""Weight of a contact. One contact marks a cell as occupied."""
_SPAN_RAD = math.radians(87.0)
"""Angle between the heading and the outer end of a bumper switch, rad."""
_OVERLAP_RAD = math.radians(10.0)
"""Half of the angle around the heading in which a contact presses both switches, rad."""
_LAYERS = ("swept", "wall", "inflated", "blocked", "visited", "attempts")


class EvidenceMap:
    """Map with layers of cells, in the frame of the estimate; see ``evidence_kernels``.

    ``attempts`` counts the fruitless attempts for each cell.
    """

    def __init__(self, model: RobotModel, options: RecoveryOptions, pose: Pose2) -> None:
        """Create a map that contains only the robot's place."""
        self._model, self._options = model, options
        self.geometry = geometry = PlannerGeometry.from_model(model, options)
        self._cell_m = geometry.cell_m
        self._per_m = 1.0 / geometry.cell_m
        self._ahead = geometry.ahead_m * self._per_m
        self._reach = geometry.inflation_cells
        self._inner = geometry.clear_cells
        size = round(2.0 * _FIRST_M * self._per_m)
        self.x0_m = pose.x_m - _FIRST_M
        self.y0_m = pose.y_m - _FIRST_M
        self.swept: Layer = np.zeros((size, size), dtype=np.uint8)
        self.wall, self.inflated, self.blocked, self.visited, self.attempts = (
            np.zeros_like(self.swept) for _ in range(5)
        )
        x, y = self.to_cells(pose.x_m, pose.y_m)
        self._last = (x, y, pose.theta_rad)
        self._visited_at = (x, y)
        self._low, self._high = [x, y], [x, y]
        self.cliffs = Cliffs(options, geometry)
        self._jump_cells = options.jump_s * model.max_speed_m_s * self._per_m
        self._guessed: list[tuple[float, float]] = []
        """Points of obstacles in the map whose only evidence is a bump, m."""
        self._readings: tuple[float | None, float | None] = (None, None)
        self._read_s = -1.0
        self.new_cells = 0
        self.swept_cells = geometry.swept_cells(0.0)
        """Half the width of the strip that counts as swept, cells."""
        clear_body(self.wall, self.inflated, self.visited, x, y, self._inner, self._reach)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.swept.shape

    def to_cells(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return column and row of a point, with fractions."""
        return (x_m - self.x0_m) * self._per_m, (y_m - self.y0_m) * self._per_m

    def to_metres(self, column: float, row: float) -> tuple[float, float]:
        """Return the point at a column and a row with fractions."""
        cell = self._cell_m
        return self.x0_m + column * cell, self.y0_m + row * cell

    def box(self, margin_m: float | None = None) -> tuple[int, int, int, int]:
        """Return row and column limits (exclusive end) of the floor near the axle's path.

        ``margin_m`` is the maximum distance from the path, m. Its default is in the options.
        """
        if margin_m is None:
            margin_m = self._options.margin_m + self._model.radius_m
        margin = margin_m * self._per_m
        rows, cols = self.shape
        return (
            max(int(self._low[1] - margin), 1),
            min(int(self._high[1] + margin), rows - 1),
            max(int(self._low[0] - margin), 1),
            min(int(self._high[0] + margin), cols - 1),
        )

    # -- evidence ----------------------------------------------------------------------------

    def include(self, x_m: float, y_m: float) -> None:
        """Extend the searched part of the map to a point, m."""
        self._extend(*self.to_cells(x_m, y_m))

    def update(self, obs: Observation) -> None:
        """Mark the floor under the mouth, clear the footprint, and use the side infrared."""
        pose = obs.pose
        x, y = (pose.x_m - self.x0_m) * self._per_m, (pose.y_m - self.y0_m) * self._per_m
        lx, ly, lth = self._last
        turned = abs(math.remainder(pose.theta_rad - lth, math.tau))
        options = self._options
        self.swept_cells = self.geometry.swept_cells(obs.lateral_sigma_m)
        moved = abs(x - lx) + abs(y - ly)
        if moved > options.moved_cells or turned > options.turned_rad:
            if math.hypot(x - lx, y - ly) < self._jump_cells:  # a jump is not driven
                self.new_cells += sweep(
                    self.swept,
                    lx,
                    ly,
                    lth,
                    x,
                    y,
                    pose.theta_rad,
                    self.swept_cells,
                    self._ahead,
                )
            self._last = (x, y, pose.theta_rad)
            bx, by = self._visited_at
            if abs(x - bx) + abs(y - by) > 0.5:  # noqa: PLR2004 - half a cell
                self._move(x, y)
        if self.cliffs and not obs.cliff:
            self.cliffs.see_floor(pose)
        readings = (obs.infrared_left_m, obs.infrared_right_m)
        if readings != self._readings or obs.time_s - self._read_s >= INFRARED_PERIOD_S:
            self._readings = readings
            self._read_s = obs.time_s
            if abs(obs.yaw_rate_rad_s) < options.look_rad_s:
                self._look(pose, self._model.infrared_left, readings[0])
                self._look(pose, self._model.infrared_right, readings[1])

    def add_point(self, x_m: float, y_m: float, weight: int = _POINT) -> None:
        """Add an obstacle at a point, m."""
        x, y = self.to_cells(x_m, y_m)
        add_wall(self.wall, self.inflated, int(y), int(x), weight, self._reach)

    def contact_rad(self, pose: Pose2, *, left: bool, right: bool, beside: int = 0) -> float:
        """Return the most likely bearing of a contact relative to the heading, rad.

        This is the bearing of the evidence nearest to the rim on the pressed side. Without evidence
        it is the middle of that side. Evidence nearly abeam on the side ``beside`` (1: left, -1:
        right) is ignored, because a followed wall is always near the rim.
        """
        low, high = _pressed(left=left, right=right)
        if beside > 0:
            high = min(high, self._options.abeam_rad)
        elif beside < 0:
            low = max(low, -self._options.abeam_rad)
        seen = self._touched(pose, low, high)
        return 0.5 * (low + high) if seen is None else seen

    def bearing_rad(self, result: LegResult, beside: int = 0) -> float:
        """Return the bearing of the obstacle that ended a leg from the heading, rad; 0: ahead.

        Args:
            result: end of the leg.
            beside: side of a followed wall, left (1) or right (-1). The contact is not with this
                wall.

        """
        left, right = result.bumper_left, result.bumper_right
        if result.reason is not StopReason.BUMPER or left == right:
            return 0.0
        return self.contact_rad(result.pose, left=left, right=right, beside=beside)

    def count_occupied(self, x_m: float, y_m: float, radius_m: float) -> int:
        """Count the occupied cells within a radius of a point, m."""
        return int((self.wall[self._disc(x_m, y_m, radius_m)] >= SURE).sum())

    def add_bump(self, pose: Pose2, *, left: bool, right: bool, abeam: int = 0) -> None:
        """Add a contact that presses one bumper switch or both.

        One switch does not locate an unknown obstacle. So the obstacle is added at the middle of
        the switch, and the robot drives slowly there. The real obstacle may be 12 cm away. Then
        :meth:`clear_bumps` removes the added obstacle. ``abeam`` is the side of a wall that the
        robot follows in contact, left (1) or right (-1). The contact is then nearly abeam.
        """
        low, high = _pressed(left=left, right=right)
        if abeam:
            oblique_rad = self._options.oblique_rad
            low, high = (oblique_rad, _SPAN_RAD) if abeam > 0 else (-_SPAN_RAD, -oblique_rad)
        seen = self._touched(pose, low, high)
        bearing = 0.5 * (low + high) if seen is None else seen
        rim = self._model.radius_m + 0.25 * self._cell_m
        point = pose.transform(rim * math.cos(bearing), rim * math.sin(bearing))
        self.add_point(*point)
        if (seen is None and left != right) or self._is_guess(point):
            self._guessed.append(point)
        if left and right:
            low, high = -_OVERLAP_RAD, _OVERLAP_RAD
        x, y = self.to_cells(pose.x_m, pose.y_m)
        theta = pose.theta_rad
        bump_area(self.blocked, x, y, theta + low, theta + high, self._model.radius_m * self._per_m)

    def add_cliff(self, pose: Pose2) -> None:
        """Add a cliff ahead of a pose."""
        near_m = self.geometry.known_floor_m
        self.cliffs.add(
            pose, lambda x_m, y_m: bool(self.visited[self._disc(x_m, y_m, near_m)].any())
        )

    def places(self) -> tuple[Layer, Layer]:
        """Return the cells blocked by bumps or cliffs, and the cells that the axle visited.

        A visit overrides a bump. It does not override a cliff, because the axle may have been over
        it.
        """
        if not self.cliffs:
            return self.blocked, self.visited
        shut = np.zeros_like(self.blocked)
        reach = self._model.radius_m * self._per_m
        for pose in self.cliffs.poses:
            x, y = self.to_cells(pose.x_m, pose.y_m)
            theta = pose.theta_rad
            bump_area(shut, x, y, theta - SPAN_RAD, theta + SPAN_RAD, reach)
        for mark in self.cliffs.marks:
            shut[self._disc(mark.x_m, mark.y_m, self.geometry.cliff_m)] = 1
        return self.blocked | shut, self.visited & (1 - shut)

    def is_swept_path(self, points: Iterable[tuple[float, float]]) -> bool:
        """Return True if the axle can be at every point, m, and each was visited or swept."""
        blocked, visited = self.places()
        rows, columns = self.shape
        for point in points:
            column, row = (int(at) for at in self.to_cells(*point))
            if not (0 <= row < rows and 0 <= column < columns):
                return False
            free = self.swept[row, column] and not (
                self.inflated[row, column] or blocked[row, column]
            )
            if not (visited[row, column] or free):
                return False
        return True

    def abandon(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Count a fruitless attempt at the cells of a square around a point, m.

        ``radius_m`` is half the length of its edge.
        """
        square, _ = self._square(*self.to_cells(x_m, y_m), radius_m)
        part = self.attempts[square]
        np.add(part, 1, out=part, where=part < 250)  # noqa: PLR2004 - a byte

    def block(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Block the cells within a radius of a point, m, for the axle.

        Visited cells stay passable.
        """
        self.blocked[self._disc(x_m, y_m, radius_m)] = 1

    def clear(self, pose: Pose2, things_m: float, places_m: float) -> None:
        """Remove evidence near a pose.

        Args:
            pose: centre of the squares and of the circle.
            things_m: half the edge of the square in which obstacles are removed, m.
            places_m: half the edge of the square in which blocks are removed, and radius of the
                circle in which cliffs are removed, m.

        """
        x, y = self.to_cells(pose.x_m, pose.y_m)
        part, _ = self._square(x, y, places_m)
        self.blocked[part] = 0
        self.cliffs.clear(pose, places_m)
        part, (r0, c0) = self._square(x, y, things_m)
        for row, col in np.argwhere(self.wall[part]).tolist():
            add_wall(self.wall, self.inflated, row + r0, col + c0, -MAX_EVIDENCE, self._reach)

    def clear_bumps(self, radius_m: float) -> bool:
        """Remove evidence that comes from bumps only.

        Reset fruitless attempts within ``radius_m`` of it.

        An obstacle stays if both switches were pressed, or if it was known before. Bumps are added
        at the estimated pose. So two attempts from slightly wrong poses can block a passage that is
        open.

        Returns:
            True if there was such evidence.

        """
        cells = np.argwhere((self.blocked > 0) & (self.visited == 0))
        reach = math.ceil(radius_m * self._per_m)
        for row, col in cells[:: max(reach // 2, 1)].tolist():
            r0, c0 = max(row - reach, 0), max(col - reach, 0)
            self.attempts[r0 : row + reach + 1, c0 : col + reach + 1] = 0
        self.blocked[:] = 0
        any_guess = bool(self._guessed)
        for point in self._guessed:
            self.add_point(*point, weight=-_POINT)
        self._guessed.clear()
        return any_guess or len(cells) > 0

    def fresh(
        self, pose: Pose2, ahead_m: tuple[float, float], aside_m: tuple[float, float]
    ) -> float:
        """Return the unswept share of a rectangle ahead.

        Args:
            pose: pose from which the rectangle is measured.
            ahead_m: limits along the heading, m.
            aside_m: limits across the heading, m, left positive, the lower limit first.

        """
        x, y = self.to_cells(pose.x_m, pose.y_m)
        per = self._per_m
        return fresh_ahead(
            self.swept,
            x,
            y,
            pose.theta_rad,
            ahead_m[0] * per,
            ahead_m[1] * per,
            aside_m[0] * per,
            aside_m[1] * per,
        )

    def speed_limit_m_s(
        self,
        pose: Pose2,
        following: int,
        brake: Braking,
        contact_m_s: float,
        *,
        straight: bool = False,
    ) -> float:
        """Return the maximum forward speed with harmless contacts at known obstacles, m/s.

        Args:
            pose: the robot's pose.
            following: side of a followed wall, left (1) or right (-1); 0: none. It may be touched.
            brake: braking distance of the robot.
            contact_m_s: maximum speed of a harmless contact along the normal, m/s.
            straight: True if the followed wall is straight. Older evidence of this wall then does
                not count. It may be some centimetres wrong because of a pose correction.

        """
        x, y = self.to_cells(pose.x_m, pose.y_m)
        cell = self._cell_m
        rim_m = self._model.radius_m + 0.5 * cell
        beside = self.geometry.beside_m[straight]
        known = speed_limit_m_s(
            self.wall,
            x,
            y,
            pose.theta_rad,
            cell,
            rim_m,
            beside if following < 0 else rim_m,
            beside if following > 0 else rim_m,
            contact_m_s,
            brake.decel,
            brake.latency_s,
            self._model.max_speed_m_s,
        )
        return min(known, self.cliffs.speed_limit_m_s(pose)) if self.cliffs else known

    def packed(self) -> PackedMap:
        """Return the map with 2 bits per cell, to be stored by a microcontroller between legs."""
        r0, r1, c0, c1 = self.box(self._model.radius_m + packed.RIM_M)
        part = np.s_[r0:r1, c0:c1]
        done = (self.swept[part] > 0) | (self.attempts[part] >= self._options.max_attempts)
        kind = packed.kinds(done, self.visited[part] > 0, self.wall[part] >= SURE)
        return packed.pack(*self.to_metres(c0, r0), kind)

    def unpack(self, kept: PackedMap) -> None:
        """Replace the layers of this map by a packed map; see the module ``packed``.

        It is used to measure the loss of information by packing. No planner calls it.

        Raises:
            ValueError: the packed map is not a part of this map.

        """
        kind = packed.unpack(kept)
        column, row = self.to_cells(kept.x0_m, kept.y0_m)
        r0, c0 = round(row), round(column)
        if min(r0, c0) < 0 or r0 + kept.rows > self.shape[0] or c0 + kept.columns > self.shape[1]:
            raise ValueError("the packed map is not a part of this map")
        for name in _LAYERS:
            getattr(self, name).fill(0)
        part = np.s_[r0 : r0 + kept.rows, c0 : c0 + kept.columns]
        self.visited[part] = kind == packed.VISITED
        self.swept[part] = (kind == packed.VISITED) | (kind == packed.DONE)
        for r, c in np.argwhere(kind == packed.OCCUPIED).tolist():
            add_wall(self.wall, self.inflated, r + r0, c + c0, SURE, self._reach)

    # -- internal ------------------------------------------------------------------------------

    def _square(
        self, x: float, y: float, reach_m: float
    ) -> tuple[tuple[slice, slice], tuple[int, int]]:
        """Return the cells in a square around a place, and the first of these cells."""
        reach = reach_m * self._per_m
        r0, c0 = max(int(y - reach), 0), max(int(x - reach), 0)
        return np.s_[r0 : int(y + reach) + 1, c0 : int(x + reach) + 1], (r0, c0)

    def _disc(self, x_m: float, y_m: float, radius_m: float) -> tuple[Ints, Ints]:
        """Return rows and columns of the cells whose centres are within a radius of a point."""
        x, y = self.to_cells(x_m, y_m)
        reach = radius_m * self._per_m
        r0, c0 = max(int(y - reach), 0), max(int(x - reach), 0)
        rows, cols = np.ogrid[
            r0 : min(int(y + reach) + 1, self.shape[0]), c0 : min(int(x + reach) + 1, self.shape[1])
        ]
        near_rows, near_cols = np.nonzero(np.hypot(rows + 0.5 - y, cols + 0.5 - x) <= reach)
        return near_rows + r0, near_cols + c0

    def _touched(self, pose: Pose2, low: float, high: float) -> float | None:
        """Return the bearing, within two limits, of the evidence nearest to the rim; None: none."""
        x, y = self.to_cells(pose.x_m, pose.y_m)
        radius = self._model.radius_m * self._per_m
        near = self.geometry.rim_cells
        reach = math.ceil(radius + near)
        r0, c0 = max(int(y) - reach, 0), max(int(x) - reach, 0)
        part = self.wall[r0 : int(y) + reach + 1, c0 : int(x) + reach + 1]
        best, found = near, None
        for row, col in np.argwhere(part > 0).tolist():
            dx, dy = col + c0 + 0.5 - x, row + r0 + 0.5 - y
            bearing = math.remainder(math.atan2(dy, dx) - pose.theta_rad, math.tau)
            off = abs(math.hypot(dx, dy) - radius)
            if off < best and low <= bearing <= high:
                best, found = off, bearing
        return found

    def _is_guess(self, point: tuple[float, float]) -> bool:
        """Return True if the only evidence of an obstacle at a point is an earlier bump."""
        return any(math.dist(point, guess) < self._cell_m for guess in self._guessed)

    def _extend(self, x: float, y: float) -> None:
        self._low = [min(self._low[0], x), min(self._low[1], y)]
        self._high = [max(self._high[0], x), max(self._high[1], y)]

    def _move(self, x: float, y: float) -> None:
        self._visited_at = (x, y)
        self._extend(x, y)
        clear_body(self.wall, self.inflated, self.visited, x, y, self._inner, self._reach)
        rim = _NEAR_M * self._per_m + self._options.margin_m * self._per_m
        rows, cols = self.shape
        if min(x, y) < rim or x > cols - rim or y > rows - rim:
            self._grow(x, y, rim)

    def _look(self, pose: Pose2, mount: RangerMount, range_m: float | None) -> None:
        options = self._options
        trust_m = options.infrared_trust_m
        x, y = self.to_cells(*pose.transform(mount.x_m, mount.y_m))
        angle = pose.theta_rad + mount.yaw_rad
        seen = range_m is not None and range_m <= trust_m
        far_m = trust_m if range_m is None or range_m > trust_m else range_m
        weight = 0 if not seen else 2 if far_m < options.strong_m else 1
        beam(
            self.wall,
            self.inflated,
            x,
            y,
            math.cos(angle),
            math.sin(angle),
            (far_m - options.beam_end_m) * self._per_m,
            far_m * self._per_m,
            weight,
            self._reach,
        )

    def _grow(self, x: float, y: float, rim: float) -> None:
        """Enlarge the map on the sides that the robot is near to."""
        step = round(_GROW_M * self._per_m)
        rows, cols = self.shape
        left, down = step if x < rim else 0, step if y < rim else 0
        right, up = step if x > cols - rim else 0, step if y > rows - rim else 0
        for name in _LAYERS:
            setattr(self, name, np.pad(getattr(self, name), ((down, up), (left, right))))
        self.x0_m -= left * self._cell_m
        self.y0_m -= down * self._cell_m
        lx, ly, lth = self._last
        self._last = (lx + left, ly + down, lth)
        self._visited_at = (self._visited_at[0] + left, self._visited_at[1] + down)
        self._low = [self._low[0] + left, self._low[1] + down]
        self._high = [self._high[0] + left, self._high[1] + down]


def _pressed(*, left: bool, right: bool) -> tuple[float, float]:
    """Return the limits of the bearings at which a pressed bumper switch may have contact, rad."""
    return -_OVERLAP_RAD if left else -_SPAN_RAD, _OVERLAP_RAD if right else _SPAN_RAD
