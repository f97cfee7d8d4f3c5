"""Coverage of a run: swept floor, its time, and missed floor."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.evaluation.holes import largest_hole
from bridge.evaluation.regions import find_regions

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bridge.evaluation.raster import Floats, Mask
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_new = tuple.__new__
_CHUNK_S = 0.25
"""Maximum duration of a segment into which poses are merged, s. It is the resolution of the
times."""
_TOLERANCE_M = 2e-4
"""Maximum distance between the path of either end of the mouth and its merged segment, m."""
_JUMP_M = 0.2
"""Maximum distance between poses that are joined, m. A larger jump is a gap in the log or a reset
of the estimate."""
_T90, _T99 = 0.90, 0.99
_Mouth = tuple[float, float, float, float]
"""Positions of the mouth's ends, m: x and y of the left end, x and y of the right end."""
_NO_MOUTH: _Mouth = (0.0, 0.0, 0.0, 0.0)


class TimedPose(NamedTuple):
    """A pose with its time: seconds, metres, radians."""

    time_s: float
    x_m: float
    y_m: float
    theta_rad: float


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares of the floor, 0 to 1."""

    mouth_sweepable: float
    """Swept share of the floor that the mouth can reach. Goals refer to this metric."""
    mouth_passing: float
    """Swept share of the floor that the mouth can reach while the robot drives forwards. It
    excludes floor that a mouth ahead of the axle reaches only in a turn towards a wall."""
    mouth_free: float
    body_reachable: float
    body_free: float
    """Coverage by the footprint (the paper's eq. 9), for comparison with the paper's tables."""
    eq8: float | None
    """Total lane length times W, divided by the free floor's area, without turns (the paper's eq.
    8); None: the lengths are unknown."""

    def to_dict(self) -> dict[str, float | None]:
        """Return the values for a summary."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class CoverageReport:
    """All metrics of one run."""

    coverage: Coverage
    """Swept shares of the floor."""
    free_m2: float
    """Area of the free floor, m²."""
    reachable_m2: float
    """Area of the floor that the footprint can cover, m²."""
    sweepable_m2: float
    """Area of the floor that the mouth can reach, m²."""
    duration_s: float
    """Time from the first pose to the last, s."""
    path_m: float
    """Path length, m."""
    t90_s: float | None
    """Time at which 90 % of the sweepable floor was swept, s from the first pose; None: never."""
    t99_s: float | None
    """As ``t90_s``, for 99 %."""
    largest_hole_cm2: float
    """Area of the largest unswept piece of sweepable floor, cm²."""
    hole_inradius_m: float
    """Radius of the largest disc inside an unswept piece of sweepable floor, m. Its error is half a
    cell."""
    repeat_ratio: float | None
    """Path length times W, divided by the swept area, minus 1; None: nothing was swept. Raster
    errors can make it slightly negative."""
    path_ratio: float
    """Path length divided by (sweepable area / W)."""
    time_ratio: float
    """Duration divided by the reference time."""
    reference_time_s: float
    """Reference time, s: sweepable area / (W · cruise speed). A run may be faster."""
    min_time_s: float
    """Lower bound of the time of every run, s: sweepable area / ``max_sweep_rate_m2_s``."""
    first_swept_s: Floats
    """Time from the first pose until each cell was swept, s (rows along y, columns along x);
    infinite: never."""
    body_swept: Mask
    """Cells that the footprint has covered."""
    origin_m: tuple[float, float]
    """Corner of the first cell of the grids, m."""
    resolution_m: float
    """Length of a cell's edge, m."""


def max_sweep_rate_m2_s(model: RobotModel) -> float:
    """Return the maximum area that the mouth can sweep per second, at the robot's speed limits.

    A point of the mouth at the distance y to the left of its middle moves across the mouth at v -
    ωy. This is true for any position of the mouth on the robot. The sweep rate is the integral of
    |v - ωy| over the width W. It is convex in v and ω, so its maximum is at the limits of v and ω.
    The maximum is v·W if the mouth's ends do not move backward, otherwise v²/ω + ωW²/4.
    """
    speed, yaw_rate = model.max_speed_m_s, model.max_yaw_rate_rad_s
    half = 0.5 * model.cleaning_width_m
    if speed >= yaw_rate * half:
        return speed * model.cleaning_width_m
    return speed * speed / yaw_rate + yaw_rate * half * half


class CoverageMeter:
    """Measures runs on one floor plan. The plan's areas are computed only once."""

    def __init__(self, plan: FloorPlan, model: RobotModel, resolution_m: float = 0.005) -> None:
        """Create a meter. The metrics are defined for cells of 1 cm or smaller."""
        self.model = model
        self.regions = find_regions(plan, model, resolution_m)
        raster = self.regions.raster
        self.free_m2 = raster.area_m2(self.regions.free)
        self.reachable_m2 = raster.area_m2(self.regions.reachable)
        self.sweepable_m2 = raster.area_m2(self.regions.sweepable)

    @property
    def reference_time_s(self) -> float:
        """Time for sweeping the sweepable floor once at cruise speed, without turns, s."""
        width, speed = self.model.cleaning_width_m, self.model.cruise_speed_m_s
        return self.sweepable_m2 / (width * speed)

    @property
    def min_time_s(self) -> float:
        """Lower bound of the time for sweeping the floor at the robot's speed limits, s."""
        return self.sweepable_m2 / max_sweep_rate_m2_s(self.model)

    def measure(
        self,
        poses: Iterable[tuple[float, float, float, float]],
        lane_length_m: float | None = None,
    ) -> CoverageReport:
        """Measure a run.

        Args:
            poses: poses of the axle's centre in the order of time: (time_s, x_m, y_m, theta_rad).
            lane_length_m: sum of the lanes' lengths, for eq. 8.

        """
        track = self.track()
        for pose in poses:
            track.add(*pose)
        return track.report(lane_length_m)

    def track(self) -> CoverageTrack:
        """Return a measurement of a run, pose by pose. Its memory does not grow with the run."""
        return CoverageTrack(self)

    def share_at(self, report: CoverageReport, times_s: Sequence[float]) -> list[float]:
        """Return the coverage (``mouth_sweepable``) at given times from the first pose."""
        swept = np.sort(report.first_swept_s[self.regions.sweepable])
        counts = np.searchsorted(swept, np.asarray(times_s, dtype=np.float64), side="right")
        return [float(count) / max(len(swept), 1) for count in counts]


class CoverageTrack:
    """Measurement of one run, pose by pose; its metrics can be read at any time."""

    def __init__(self, meter: CoverageMeter) -> None:
        self._model = model = meter.model
        self._meter = meter
        self._half_m = 0.5 * model.cleaning_width_m
        raster = meter.regions.raster
        self._times = np.full(raster.shape, np.inf)
        self._body = raster.empty()
        self._first: TimedPose | None = None
        self._newest: TimedPose | None = None
        self._path_m = 0.0
        self._begun: TimedPose | None = None
        """Start of the current piece of the path."""
        self._anchor = self._end = _NO_MOUTH
        self._end_pose: TimedPose | None = None
        """Newest pose of the current piece; None: the piece has only its start."""
        self._directions: tuple[float, ...] | None = None

    def add(self, time_s: float, x_m: float, y_m: float, theta_rad: float) -> None:
        """Add the next pose of the axle's centre, in the order of time."""
        pose = _new(TimedPose, (time_s, x_m, y_m, theta_rad))
        newest, self._newest = self._newest, pose
        if newest is None:
            self._first = pose
            self._set_out(pose)
            return
        step_m = math.hypot(x_m - newest.x_m, y_m - newest.y_m)
        if step_m > _JUMP_M:
            self._close()
            self._set_out(pose)
            return
        self._path_m += step_m
        self._follow(pose)

    def share(self) -> float:
        """Return the coverage up to the newest pose, 0 to 1.

        It is fast enough for a live picture.
        """
        self._close()
        sweepable = self._meter.regions.sweepable
        return _share(np.isfinite(self._times) & sweepable, sweepable)

    def report(self, lane_length_m: float | None = None) -> CoverageReport:
        """Return all metrics up to the newest pose. More poses may follow.

        ``lane_length_m`` is the sum of the lanes' lengths, for eq. 8.
        """
        self._close()
        meter, regions = self._meter, self._meter.regions
        raster, width = regions.raster, self._model.cleaning_width_m
        times = np.where(regions.free, self._times, np.inf)
        body = self._body & regions.free
        swept = np.isfinite(times)
        path_m, duration_s = self._path_m, 0.0
        if self._first is not None and self._newest is not None:
            duration_s = self._newest.time_s - self._first.time_s
        hole_cm2, inradius_m = largest_hole(raster, regions.sweepable & ~swept)
        swept_m2 = raster.area_m2(swept)
        free_m2 = meter.free_m2
        coverage = Coverage(
            mouth_sweepable=_share(swept & regions.sweepable, regions.sweepable),
            mouth_passing=_share(swept & regions.passing, regions.passing),
            mouth_free=_share(swept, regions.free),
            body_reachable=_share(body & regions.reachable, regions.reachable),
            body_free=_share(body, regions.free),
            eq8=None if lane_length_m is None else lane_length_m * width / max(free_m2, 1e-12),
        )
        ordered = np.sort(times[regions.sweepable])
        return CoverageReport(
            coverage=coverage,
            free_m2=free_m2,
            reachable_m2=meter.reachable_m2,
            sweepable_m2=meter.sweepable_m2,
            duration_s=duration_s,
            path_m=path_m,
            t90_s=_passed(ordered, _T90),
            t99_s=_passed(ordered, _T99),
            largest_hole_cm2=hole_cm2,
            hole_inradius_m=inradius_m,
            repeat_ratio=path_m * width / swept_m2 - 1.0 if swept_m2 > 0.0 else None,
            path_ratio=path_m * width / max(meter.sweepable_m2, 1e-12),
            time_ratio=duration_s / max(meter.reference_time_s, 1e-12),
            reference_time_s=meter.reference_time_s,
            min_time_s=meter.min_time_s,
            first_swept_s=times,
            body_swept=body,
            origin_m=(raster.x_min_m, raster.y_min_m),
            resolution_m=raster.resolution_m,
        )

    # -- inside ----------------------------------------------------------------------------

    def _set_out(self, pose: TimedPose) -> None:
        """Begin a new piece that is not connected with the previous piece."""
        self._begun, self._anchor = pose, self._mouth(pose)
        self._end, self._end_pose = self._anchor, None
        self._directions = None
        self._stand(pose)

    def _follow(self, pose: TimedPose) -> None:
        """Extend the current piece while both ends of the mouth move straight."""
        begun = self._begun
        ends = self._mouth(pose)
        if begun is None:
            return
        if ends == self._end:
            if self._directions is not None:
                self._close()  # a standstill is not part of the time of the piece
            self._end_pose = pose
            return
        if self._directions is not None and (
            pose.time_s - begun.time_s > _CHUNK_S
            or not _straight(self._anchor, self._directions, ends)
        ):
            self._close()
        if self._directions is None:
            ax, ay, bx, by = self._anchor
            self._directions = (ends[0] - ax, ends[1] - ay, ends[2] - bx, ends[3] - by)
        self._end, self._end_pose = ends, pose

    def _close(self) -> None:
        """Stamp the current piece, and begin the next piece at its end."""
        begun, last = self._begun, self._end_pose
        if begun is None or last is None or self._first is None:
            return
        raster = self._meter.regions.raster
        raster.stamp_sweep(self._times, self._anchor, self._end, last.time_s - self._first.time_s)
        a, b = (begun.x_m, begun.y_m), (last.x_m, last.y_m)
        if a != b:
            raster.stamp_capsule(self._body, a, b, self._model.radius_m)
        self._begun, self._anchor = last, self._end
        self._end_pose = self._directions = None

    def _stand(self, pose: TimedPose) -> None:
        """Stamp the footprint at the start of a piece, because the piece may have no other pose."""
        centre = (pose.x_m, pose.y_m)
        self._meter.regions.raster.stamp_capsule(self._body, centre, centre, self._model.radius_m)

    def _mouth(self, pose: TimedPose) -> _Mouth:
        """Return the mouth's left and right end."""
        _, x, y, theta_rad = pose
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        x += self._model.mouth_offset_m * c
        y += self._model.mouth_offset_m * s
        half = self._half_m
        return x - half * s, y + half * c, x + half * s, y - half * c


def _straight(anchor: Sequence[float], directions: Sequence[float], ends: Sequence[float]) -> bool:
    """Return True if both ends are on their initial lines and move along them."""
    for k in (0, 2):
        dx, dy = directions[k], directions[k + 1]
        ex, ey = ends[k] - anchor[k], ends[k + 1] - anchor[k + 1]
        length = math.hypot(dx, dy)
        if length == 0.0:
            if math.hypot(ex, ey) > _TOLERANCE_M:
                return False
            continue
        if dx * ex + dy * ey < 0.0 or abs(dx * ey - dy * ex) > _TOLERANCE_M * length:
            return False
    return True


def _share(part: Mask, whole: Mask) -> float:
    total = int(np.count_nonzero(whole))
    return int(np.count_nonzero(part)) / total if total else 0.0


def _passed(ordered_s: Floats, share: float) -> float | None:
    """Return the time at which a share of the cells was swept, from their sorted times."""
    if not len(ordered_s):
        return None
    time_s = float(ordered_s[math.ceil(share * len(ordered_s)) - 1])
    return time_s if math.isfinite(time_s) else None
