"""The walls of the estimate: straight lines, which are landmarks of the filter.

A wall is the line n·(p - a) = ρ. Its normal n = (cos α, sin α) points into the wall. The fixed
anchor point a is near the first measurement, so a change of α turns the wall about that point. α
and ρ are states of the filter. They stay correlated with the uncertain pose of the first
measurement. So a later measurement of the wall removes only the drift since then. ``wall_frames``
decides which walls are orthogonal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.motion.estimation.ekf import STATES, THETA, WHEEL_SCALE, X, Y
from bridge.motion.estimation.wall_frames import Frames, FrameTuning, Wall

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from bridge.motion.estimation.ekf import Ekf
    from bridge.motion.estimation.wall_measurements import FrontMeasurement, LineMeasurement
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount

    Floats = NDArray[np.float64]

MAX_WALLS = 40
"""Maximum number of walls in the map. A new wall then replaces another one."""
_QUARTER = 0.5 * math.pi


@dataclass(frozen=True, slots=True)
class WallTuning:
    """Limits of the association of measurements with walls, and uncertainty of new walls."""

    same_chi2: float = 9.2
    """Maximum normalised squared innovation of the same wall, for two values (99 %)."""
    same_chi1: float = 6.6
    """Maximum normalised squared innovation of the same wall, for one value (99 %)."""
    other_chi2: float = 30.0
    """Normalised squared innovation from which a surface is another wall, for two values. A surface
    between the two gates is ignored."""
    other_chi1: float = 25.0
    """Normalised squared innovation from which a surface is another wall, for one value."""
    same_share: float = 0.7
    """Minimum share of a measured piece in front of a known wall that it belongs to."""
    same_m: float = 0.03
    """Maximum distance of a measured piece from a known wall that it belongs to, m."""
    same_rad: float = math.radians(2.5)
    """Maximum angle between a measured piece and a known wall that it belongs to, rad."""
    step_m: float = 0.003
    """Maximum step in a flat wall, m."""
    gate_m: float = 0.06
    """Maximum innovation of a known wall, m, or ``gate_sigmas``, whichever is larger."""
    gate_sigmas: float = 2.5
    """Maximum innovation of a known wall, in standard deviations, or ``gate_m``, whichever is
    larger."""
    gate_rad: float = math.radians(5.0)
    """Maximum innovation of the direction of a known wall, rad."""
    jump_rad: float = math.radians(1.2)
    """Maximum jump of an over-confident heading due to one piece of a wall, rad. A larger jump
    needs two successive pieces whose directions differ by less than this angle: one piece may
    contain a step between two surfaces. With this limit the coverage of four generated rooms rose
    from 98.4 to 99.7 %."""
    new_sigma_rad: float = math.radians(1.2)
    """Maximum standard deviation of the direction of a new wall, rad."""
    apart_m: float = 0.5
    """Distance beyond the known part of a wall from which a piece in line may be another wall,
    m."""
    same_per_m: float = 12.0
    """Minimum probability density of the innovation of a distance, 1/m, at which a surface that
    does not overlap the known part of a wall is the same wall. The sides of two obstacles may be
    parallel and some centimetres apart, so this density is fifteen times that of another surface:
    about 0.8 per m. With this limit the coverage of two generated rooms rose by 1.5 and
    1.9 points, and that of 16 others did not change."""
    place_sigma_m: float = 0.05
    """Maximum standard deviation of the distance to a place that only the ultrasonic sensor
    measured, m. With a larger one the echo may come from another place: two chair legs may be 11 cm
    apart."""
    apart_short_m: float = 0.1
    """Distance beyond the known part of a wall from which a piece shorter than ``new_span_m`` may
    be another wall, m. Such a piece may be part of a column."""
    front_margin_m: float = 0.2
    """Distance beyond the known part of a wall within which an echo may be of this wall, m."""
    front_cone_rad: float = math.radians(7.0)
    """Maximum angle between the ultrasonic sensor and the normal of a wall that it measures,
    rad."""
    front_new_rad: float = math.radians(4.3)
    """Standard deviation of the direction of a surface that only the ultrasonic sensor measured,
    rad. The direction is uniform over the sensor's cone."""
    skew: float = 0.7
    """Factor on the error due to an oblique wall. If the angle to the normal is δ, the range
    decreases less than the path, by a share of δ²/2."""
    front_new_m: float = 1.0
    """Maximum ultrasonic range of a new wall, m."""
    front_orthogonal_rad: float = math.radians(6.0)
    """Maximum angle to the normal of a known wall, rad. A surface that only the ultrasonic sensor
    measured is used within this angle."""
    frames: FrameTuning = field(default_factory=FrameTuning)
    """Evidence that two walls are orthogonal or parallel."""


class _Match(NamedTuple):
    wall: int
    chi2: float
    second_chi2: float
    """Normalised squared innovation of the second-best wall; 0: an unknown surface fits as well."""
    rows: Floats
    innovation: Floats
    """Innovation of direction (rad) and distance (m)."""
    expected: Floats
    """Covariance of the innovation."""
    noise: Floats
    """Covariance of the measurement only."""


class WallMap:
    """Associates measurements with walls, and updates the filter."""

    def __init__(self, ekf: Ekf, tuning: WallTuning | None = None) -> None:
        """Store the walls as landmarks of ``ekf``."""
        self._ekf = ekf
        self._tuning = tuning or WallTuning()
        self.walls: list[Wall] = []
        self._frames = Frames(self.walls, self._tuning.frames)
        self._new_span_m = self._tuning.frames.new_span_m
        self._made = 0
        """Number of walls added so far."""
        self._found: Wall | None = None
        """Wall that was last measured again, until :meth:`take_found` returns it."""
        self._jump_rad: float | None = None
        """Heading error by the last piece of a known wall, rad; None: it needed no larger jump."""

    # -- present estimate -------------------------------------------------------------------

    def normal_rad(self, wall: int) -> float:
        """Direction of a wall's normal, rad."""
        return self._ekf.walls[2 * wall]

    def offset_m(self, wall: int) -> float:
        """Distance of a wall from its anchor, m."""
        return self._ekf.walls[2 * wall + 1]

    def known(self) -> Iterator[tuple[Wall, float, float]]:
        """Yield every wall with the direction of its normal, rad, and its offset, m."""
        values = self._ekf.walls
        if 2 * len(self.walls) == len(values):
            for i, wall in enumerate(self.walls):
                yield wall, values[2 * i], values[2 * i + 1]

    def take_found(self) -> tuple[Wall, float] | None:
        """Return the wall that was measured again last, and its normal, rad.

        Return it only once.
        """
        wall, self._found = self._found, None
        if wall is None or not any(wall is each for each in self.walls):
            return None
        return wall, self.normal_rad(next(i for i, w in enumerate(self.walls) if w is wall))

    @property
    def heading_sigma_rad(self) -> float:
        """Standard deviation of the heading relative to orthogonal walls, rad; 0: no walls.

        The walls of a frame are correlated, so one wall of the longest frame represents all. The
        value is at most 0.1 s old, because the covariance is.
        """
        i = self._frames.longest
        if i < 0 or 2 * len(self.walls) != len(self._ekf.walls):
            return 0.0
        k = STATES + 2 * i
        p = self._ekf.joint_covariance.p
        return math.sqrt(max(p.item(THETA, THETA) + p.item(k, k) - 2.0 * p.item(THETA, k), 0.0))

    # -- measurements --------------------------------------------------------------------------

    def see_line(self, measurement: LineMeasurement) -> bool:
        """Use a line that was measured at the present pose.

        Return True if it updated the pose as a measurement of a known wall. If the line may be one
        of two surfaces, it updates only the heading.
        """
        self._check()
        ekf, tuning, pose = self._ekf, self._tuning, self._ekf.pose
        noise = np.array(
            [
                [measurement.var_normal, measurement.covar],
                [measurement.covar, measurement.var_distance],
            ],
            dtype=np.float64,
        )
        best = self._match(measurement, pose, noise)
        same = best is not None and self._covers(best.wall, measurement, pose, best.innovation)
        if best is None or (best.chi2 > tuning.other_chi2 and not same):
            self._add_line(measurement, pose, noise)
            return False
        off_rad, off_m = best.innovation.tolist()
        gate_m = max(tuning.gate_m, tuning.gate_sigmas * math.sqrt(best.expected[1, 1]))
        if abs(off_rad) > tuning.gate_rad or abs(off_m) > gate_m:
            return False
        if best.second_chi2 < tuning.same_chi2:
            self._take_direction(best)
            return False
        if same or best.chi2 < tuning.same_chi2:
            ekf.yaw_noise.learn(off_rad**2 / float(best.expected[0, 0]))
            ekf.path_noise.learn(off_m**2 / float(best.expected[1, 1]))
        if best.chi2 > tuning.same_chi2:
            if not same:
                return False
            # No other surface can be at this place. So the estimate was over-confident, or the
            # piece contains a step.
            if abs(off_rad) > tuning.jump_rad and not self._confirms(off_rad):
                return False
            ekf.inflate(abs(off_m), abs(off_rad))
        self._jump_rad = None
        ekf.update(self._index(best.wall), best.rows, best.innovation, noise)
        self._extend(best.wall, measurement, ekf.pose)
        self._found = self.walls[best.wall]
        self._make_orthogonal(best.wall)
        return True

    def _confirms(self, off_rad: float) -> bool:
        """Return True if the last piece of a wall disagreed with the heading by the same angle."""
        last, self._jump_rad = self._jump_rad, off_rad
        return last is not None and abs(off_rad - last) < self._tuning.jump_rad

    def _take_direction(self, match: _Match) -> None:
        """Use only the direction of a line that may be a wall or another surface near the wall.

        The other surface is parallel to the wall, so the heading is right in both cases.
        """
        ekf, tuning, wall = self._ekf, self._tuning, self.walls[match.wall]
        off_rad, variance = float(match.innovation[0]), float(match.expected[0, 0])
        if wall.frame < 0 or wall.seen_m < self._new_span_m:
            return
        if abs(off_rad) > tuning.frames.gate_rad or off_rad * off_rad > tuning.same_chi1 * variance:
            return
        ekf.yaw_noise.learn(off_rad * off_rad / variance)
        ekf.update(
            self._index(match.wall), match.rows[:1], match.innovation[:1], match.noise[:1, :1]
        )

    def see_front(self, measurement: FrontMeasurement, mount: RangerMount) -> bool:
        """Use a distance to a surface ahead.

        Return True if it updated the pose as a measurement of a known wall.
        """
        self._check()
        ekf, tuning = self._ekf, self._tuning
        pose = ekf.pose
        sensor = pose.transform(mount.x_m, mount.y_m)
        found: list[_Match] = []
        straight_on = self._straight_on(pose.theta_rad + mount.yaw_rad)
        for i, wall in enumerate(self.walls):
            if not straight_on and wall.seen_m < self._new_span_m:
                continue
            alpha = self.normal_rad(i)
            facing = math.remainder(alpha - pose.theta_rad - mount.yaw_rad, math.tau)
            if abs(facing) > tuning.front_cone_rad:
                continue
            along = _along(wall, alpha, sensor)
            if not wall.low_m - tuning.front_margin_m < along < wall.high_m + tuning.front_margin_m:
                continue
            rows, predicted_m, by_skew = self._front_rows(i, pose, mount, sensor)
            innovation = np.array([measurement.range_m - predicted_m])
            _, s = ekf.joint_covariance.project(self._index(i), rows)
            noise = np.array([[measurement.variance + by_skew]])
            s += noise
            chi2 = float(innovation[0] ** 2) / float(s[0, 0])
            sure = wall.seen_m >= self._new_span_m or s[0, 0] < tuning.place_sigma_m**2
            second_chi2 = math.inf if sure else 0.0
            found.append(_Match(i, chi2, second_chi2, rows, innovation, s, noise))
        best = self._choose(found, tuning.same_chi1)
        if best is None or best.chi2 > tuning.other_chi1:
            if straight_on:
                self._add_front(measurement, pose, mount)
            return False
        gate_m = max(tuning.gate_m, tuning.gate_sigmas * math.sqrt(best.expected[0, 0]))
        if (
            best.chi2 > tuning.same_chi1
            or best.second_chi2 < tuning.same_chi1
            or abs(best.innovation[0]) > gate_m
        ):
            return False
        wall = self.walls[best.wall]
        held: tuple[int, ...] = (THETA, STATES + 2 * best.wall)
        if wall.seen_m < self._new_span_m:
            held += (WHEEL_SCALE,)
        ekf.update(self._index(best.wall), best.rows, best.innovation, best.noise, held)
        along = _along(wall, self.normal_rad(best.wall), sensor)
        wall.low_m, wall.high_m = min(wall.low_m, along), max(wall.high_m, along)
        wall.measurements += 1
        if wall.seen_m >= self._new_span_m:
            self._found = wall
        self._make_orthogonal(best.wall)
        return True

    # -- internal ------------------------------------------------------------------------------

    def _check(self) -> None:
        """Remove the walls from the list if the filter has marginalised them."""
        self._ekf.propagate_covariance()
        if 2 * len(self.walls) != len(self._ekf.walls):
            self.walls.clear()
            self._frames.find_longest()

    def _match(self, measurement: LineMeasurement, pose: Pose2, noise: Floats) -> _Match | None:
        """Return the wall with the smallest squared innovation, and the innovation of the next."""
        tuning = self._tuning
        found: list[_Match] = []
        for i, wall in enumerate(self.walls):
            off = math.remainder(
                pose.theta_rad + measurement.normal_rad - self.normal_rad(i), math.tau
            )
            if abs(off) > 3.0 * tuning.gate_rad:
                continue
            rows, predicted_m = self._line_rows(i, pose)
            innovation = np.array([off, measurement.distance_m - predicted_m])
            if abs(innovation[1]) > 3.0 * tuning.gate_m or not self._beside(
                wall, i, measurement, pose, tuning.apart_m
            ):
                continue
            _, s = self._ekf.joint_covariance.project(self._index(i), rows)
            s += noise
            chi2 = float(innovation @ np.linalg.solve(s, innovation))
            sure = (
                self._beside(wall, i, measurement, pose, 0.0)
                or _density(innovation[1], s[1, 1]) > tuning.same_per_m
            )
            second_chi2 = math.inf if sure else 0.0
            found.append(_Match(i, chi2, second_chi2, rows, innovation, s, noise))
        return self._choose(found, tuning.same_chi2)

    def _choose(self, found: list[_Match], same_chi2: float) -> _Match | None:
        """Return the best match, with the innovation of the next other wall. Prefer a long wall."""
        if not found:
            return None
        best = min(found, key=lambda match: match.chi2)
        if self.walls[best.wall].seen_m < self._new_span_m:
            long = [
                match
                for match in found
                if match.chi2 < same_chi2 and self.walls[match.wall].seen_m >= self._new_span_m
            ]
            best = min(long, key=lambda match: match.chi2, default=best)
        others = [
            m.chi2 for m in found if m is not best and not self._is_same_wall(m.wall, best.wall)
        ]
        return best._replace(second_chi2=min((*others, best.second_chi2)))

    def _straight_on(self, direction_rad: float) -> bool:
        """Return True if a direction is normal to a known wall, or if no wall is known.

        An oblique echo may come from a corner, and its position changes with the robot's pose.
        """
        framed = [i for i, wall in enumerate(self.walls) if wall.frame >= 0]
        return not framed or any(
            abs(math.remainder(direction_rad - self.normal_rad(i), _QUARTER))
            < self._tuning.front_orthogonal_rad
            for i in framed
        )

    @staticmethod
    def _index(wall: int) -> tuple[int, ...]:
        first = STATES + 2 * wall
        return (X, Y, THETA, first, first + 1)

    def _line_rows(self, i: int, pose: Pose2) -> tuple[Floats, float]:
        """Return the rows of H for (normal, distance), and the expected distance, m."""
        wall, alpha = self.walls[i], self.normal_rad(i)
        c, s = math.cos(alpha), math.sin(alpha)
        dx, dy = pose.x_m - wall.anchor_x_m, pose.y_m - wall.anchor_y_m
        rows = np.array([[0.0, 0.0, -1.0, 1.0, 0.0], [-c, -s, 0.0, dx * s - dy * c, 1.0]])
        return rows, self.offset_m(i) - dx * c - dy * s

    def _front_rows(
        self, i: int, pose: Pose2, mount: RangerMount, sensor: tuple[float, float]
    ) -> tuple[Floats, float, float]:
        """Return the row of H for a distance ahead, its expected value and the obliqueness error.

        The row contains the angles, but they are held (Schmidt's filter). So their variance is used
        in each measurement, but they do not change. Otherwise a range error of a millimetre would
        change a wall's direction and turn the robot's heading by degrees.
        """
        wall, alpha = self.walls[i], self.normal_rad(i)
        c, s = math.cos(alpha), math.sin(alpha)
        ct, st = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        by_theta = c * (mount.x_m * st + mount.y_m * ct) - s * (mount.x_m * ct - mount.y_m * st)
        dx, dy = sensor[0] - wall.anchor_x_m, sensor[1] - wall.anchor_y_m
        rows = np.array([[-c, -s, by_theta, dx * s - dy * c, 1.0]])
        k = STATES + 2 * i
        turned = float(self._ekf.joint_covariance.p[k, k])
        skew = self._tuning.skew * turned * (dx * c + dy * s)
        variance = skew * skew
        return rows, self.offset_m(i) - dx * c - dy * s, variance

    def _is_same_wall(self, i: int, j: int) -> bool:
        """Return True if two walls with one normal are one wall, measured at two places in line.

        A place that only the ultrasonic sensor measured has no known direction. It belongs to a
        wall in line with it if it lies within the known part of the wall or just beyond. The front
        of a cupboard just before a wall is not part of the wall. The uncertainty of the step
        between them decides.
        """
        tuning = self._tuning
        if self.walls[i].seen_m < self._new_span_m:
            i, j = j, i
        one, other = self.walls[i], self.walls[j]
        alpha = self.normal_rad(i)
        if other.seen_m < self._new_span_m <= one.seen_m:
            along = _along(one, alpha, (other.anchor_x_m, other.anchor_y_m))
            if not one.low_m - tuning.front_margin_m < along < one.high_m + tuning.front_margin_m:
                return False
        elif not one.frame == other.frame >= 0:
            return False
        c, s = math.cos(alpha), math.sin(alpha)
        dx, dy = other.anchor_x_m - one.anchor_x_m, other.anchor_y_m - one.anchor_y_m
        step_m = dx * c + dy * s + self.offset_m(j) - self.offset_m(i)
        index = (STATES + 2 * i, STATES + 2 * i + 1, STATES + 2 * j + 1)
        rows = np.array([[dy * c - dx * s, -1.0, 1.0]])
        _, variance = self._ekf.joint_covariance.project(index, rows)
        sigma_m = math.hypot(tuning.step_m, math.sqrt(max(float(variance[0, 0]), 0.0)))
        return abs(step_m) < min(2.0 * sigma_m, tuning.same_m)

    def _beside(
        self, wall: Wall, i: int, measurement: LineMeasurement, pose: Pose2, apart_m: float
    ) -> bool:
        """Return True if a measurement is within the known part of a wall, or near its end."""
        at = _along(wall, self.normal_rad(i), (pose.x_m, pose.y_m))
        if measurement.span_m < self._new_span_m:
            apart_m = min(apart_m, self._tuning.apart_short_m)
        return (
            at + measurement.low_m < wall.high_m + apart_m
            and at + measurement.high_m > wall.low_m - apart_m
        )

    def _covers(
        self, i: int, measurement: LineMeasurement, pose: Pose2, innovation: Floats
    ) -> bool:
        """Return True if a measurement can only be this wall: no other is visible there."""
        tuning = self._tuning
        if abs(innovation[0]) > tuning.same_rad or abs(innovation[1]) > tuning.same_m:
            return False
        wall = self.walls[i]
        at = _along(wall, self.normal_rad(i), (pose.x_m, pose.y_m))
        both = min(at + measurement.high_m, wall.high_m) - max(at + measurement.low_m, wall.low_m)
        return both > tuning.same_share * measurement.span_m

    def _extend(self, i: int, measurement: LineMeasurement, pose: Pose2) -> None:
        wall = self.walls[i]
        at = _along(wall, self.normal_rad(i), (pose.x_m, pose.y_m))
        wall.low_m = min(wall.low_m, at + measurement.low_m)
        wall.high_m = max(wall.high_m, at + measurement.high_m)
        wall.seen_m += measurement.span_m
        wall.measurements += 1
        self._frames.find_longest()

    def _add_line(self, measurement: LineMeasurement, pose: Pose2, noise: Floats) -> None:
        if (
            measurement.span_m < self._new_span_m
            or measurement.var_normal > self._tuning.new_sigma_rad**2
        ):
            return
        alpha = pose.theta_rad + measurement.normal_rad
        c, s = math.cos(alpha), math.sin(alpha)
        middle = 0.5 * (measurement.low_m + measurement.high_m)
        to_x, to_y = (
            measurement.distance_m * c - middle * s,
            measurement.distance_m * s + middle * c,
        )
        half = 0.5 * measurement.span_m
        wall = Wall(pose.x_m + to_x, pose.y_m + to_y, -half, half, measurement.span_m, 1)
        # α = θ + β and ρ = δ + (p - a)·n(α), where t·(p - a) = -middle
        rows = np.array([[0.0, 0.0, 1.0], [c, s, -middle]])
        mix = np.array([[1.0, 0.0], [-middle, 1.0]])
        self._append(wall, alpha, rows, mix @ noise @ mix.T)

    def _add_front(self, measurement: FrontMeasurement, pose: Pose2, mount: RangerMount) -> None:
        if measurement.range_m > self._tuning.front_new_m:
            return
        alpha = pose.theta_rad + mount.yaw_rad
        c, s = math.cos(alpha), math.sin(alpha)
        sensor = pose.transform(mount.x_m, mount.y_m)
        ahead = measurement.range_m
        wall = Wall(sensor[0] + ahead * c, sensor[1] + ahead * s, -0.05, 0.05, 0.0, 1)
        # A change of the unknown direction turns the wall about the hit point. There it does not
        # change ρ.
        lever_x, lever_y = sensor[0] - pose.x_m, sensor[1] - pose.y_m
        by_theta = lever_x * s - lever_y * c  # of the range alone: 0 for a sensor on the axis
        rows = np.array([[0.0, 0.0, 1.0], [c, s, by_theta]])
        noise = np.array([[self._tuning.front_new_rad**2, 0.0], [0.0, measurement.variance]])
        self._append(wall, alpha, rows, noise)

    def _append(self, wall: Wall, alpha: float, rows: Floats, noise: Floats) -> None:
        if len(self.walls) >= MAX_WALLS:
            self._drop()
        self._ekf.joint_covariance.augment((X, Y, THETA), rows, noise)
        self._ekf.walls += [alpha, 0.0]
        wall.number, self._made = self._made, self._made + 1
        self.walls.append(wall)
        self._make_orthogonal(len(self.walls) - 1)

    def _drop(self) -> None:
        """Marginalise the wall with the smallest number of measurements."""
        i = min(
            range(len(self.walls)), key=lambda k: (self.walls[k].measurements, self.walls[k].seen_m)
        )
        del self.walls[i]
        del self._ekf.walls[2 * i : 2 * i + 2]
        self._ekf.joint_covariance.marginalise(STATES + 2 * i, 2)
        self._frames.find_longest()

    def _make_orthogonal(self, i: int) -> None:
        """Constrain a wall's direction to the direction of the longest orthogonal wall."""
        joint_covariance, alphas = self._ekf.joint_covariance, self._ekf.walls[::2]
        found = self._frames.partner(i, alphas, joint_covariance.p[STATES::2, STATES::2])
        if found is None:
            return
        partner, error = found
        self._frames.join(self.walls[i], self.walls[partner])
        rows = np.array([[1.0, -1.0]])
        index = (STATES + 2 * i, STATES + 2 * partner)
        self._ekf.update(
            index, rows, np.array([-error]), np.array([[self._tuning.frames.orthogonal_rad**2]])
        )


def _along(wall: Wall, alpha: float, point: tuple[float, float]) -> float:
    """Return the position of a point along the wall, m, relative to the wall's anchor point."""
    dx, dy = point[0] - wall.anchor_x_m, point[1] - wall.anchor_y_m
    return dy * math.cos(alpha) - dx * math.sin(alpha)


def _density(value: float, variance: float) -> float:
    """Return the probability density of a value of the normal distribution with mean 0."""
    return math.exp(-0.5 * value * value / variance) / math.sqrt(math.tau * variance)
