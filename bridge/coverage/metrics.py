"""Coverage of a run: what was swept, when, and what was left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.coverage.regions import find_regions

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bridge.coverage.floorplan import FloorPlan
    from bridge.coverage.raster import Floats, Mask
    from bridge.motion.robot_model import RobotModel

_CHUNK_S = 0.25
"""Poses are merged into straight pieces up to this long: the resolution of the times."""
_TOLERANCE_M = 2e-4
"""... as long as neither end of the mouth strays further than this from the piece."""
_JUMP_M = 0.2
"""Poses further apart than this are not joined: a log with a hole, or an estimate set anew."""
_T90, _T99 = 0.90, 0.99


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
    """The main figure: of what the mouth can reach, what it swept."""
    mouth_free: float
    body_reachable: float
    body_free: float
    """The paper's eq. 9, over the body's footprint: the one to hold against its tables."""
    eq8: float | None
    """Lane lengths times W over the free floor, turns left out; ``None``: lengths not known."""

    def to_dict(self) -> dict[str, float | None]:
        """For a summary."""
        return {
            "mouth_sweepable": self.mouth_sweepable,
            "mouth_free": self.mouth_free,
            "body_reachable": self.body_reachable,
            "body_free": self.body_free,
            "eq8": self.eq8,
        }


@dataclass(frozen=True, slots=True, eq=False)
class CoverageReport:
    """Everything measured over one run."""

    coverage: Coverage
    free_m2: float
    reachable_m2: float
    sweepable_m2: float
    duration_s: float
    path_m: float
    t90_s: float | None
    """When 90 % of the sweepable floor was swept, from the first pose; ``None``: never."""
    t99_s: float | None
    largest_hole_cm2: float
    hole_inradius_m: float
    """Radius of the largest disc that fits in an unswept sweepable piece, to half a cell."""
    repeat_ratio: float | None
    """``None`` if nothing was swept."""
    path_ratio: float
    """Path over sweepable area / W."""
    time_ratio: float
    """Duration over the reference time."""
    reference_time_s: float
    """Sweepable area / (W · cruise speed)."""
    first_swept_s: Floats
    """Per cell (rows along y, columns along x): time from the first pose; infinite: never."""
    body_swept: Mask
    origin_m: tuple[float, float]
    """Corner of the first cell of the two grids."""
    resolution_m: float


class CoverageMeter:
    """Measures runs on one floor plan; the plan's areas are worked out once."""

    def __init__(self, plan: FloorPlan, model: RobotModel, resolution_m: float = 0.005) -> None:
        """Cells of 1 cm or finer are what the figures are defined for."""
        self._model = model
        self.regions = find_regions(plan, model, resolution_m)
        raster = self.regions.raster
        self.free_m2 = raster.area_m2(self.regions.free)
        self.reachable_m2 = raster.area_m2(self.regions.reachable)
        self.sweepable_m2 = raster.area_m2(self.regions.sweepable)

    @property
    def reference_time_s(self) -> float:
        """Time to sweep the sweepable floor once at cruise speed, with no turns."""
        width, speed = self._model.cleaning_width_m, self._model.cruise_speed_m_s
        return self.sweepable_m2 / (width * speed)

    def measure(
        self,
        poses: Iterable[tuple[float, float, float, float]],
        lane_length_m: float | None = None,
    ) -> CoverageReport:
        """Measure a run.

        Args:
            poses: (time_s, x_m, y_m, theta_rad) in the order of time, of the axle's centre.
            lane_length_m: sum of the lanes' lengths, for eq. 8.

        """
        track = [TimedPose(*pose) for pose in poses]
        raster, regions = self.regions.raster, self.regions
        times = np.full(raster.shape, np.inf)
        body = raster.empty()
        start_s = track[0].time_s if track else 0.0
        for part in _unbroken(track):
            pieces = self._pieces(part)
            ends = [self._mouth(p) for p in pieces]
            for pose, old, new in zip(pieces[1:], ends, ends[1:], strict=False):
                raster.stamp_sweep(times, old, new, pose.time_s - start_s)
            centres = [(p.x_m, p.y_m) for p in pieces]
            raster.stamp_path(body, _moving(centres), self._model.radius_m)
        times[~regions.free] = np.inf
        body &= regions.free
        swept = np.isfinite(times)
        return self._report(track, times, swept, body, lane_length_m)

    def share_at(self, report: CoverageReport, times_s: Sequence[float]) -> list[float]:
        """The main figure at given times from the first pose, for curves."""
        swept = np.sort(report.first_swept_s[self.regions.sweepable])
        counts = np.searchsorted(swept, np.asarray(times_s, dtype=np.float64), side="right")
        return [float(count) / max(len(swept), 1) for count in counts]

    # -- inside ----------------------------------------------------------------------------

    def _mouth(self, pose: TimedPose) -> tuple[float, float, float, float]:
        """The mouth's left and right end."""
        half = 0.5 * self._model.cleaning_width_m
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        x = pose.x_m + self._model.mouth_offset_m * c
        y = pose.y_m + self._model.mouth_offset_m * s
        return x - half * s, y + half * c, x + half * s, y - half * c

    def _pieces(self, track: list[TimedPose]) -> list[TimedPose]:
        """Merge poses while both ends of the mouth move straight on, up to 0.25 s."""
        kept = [track[0]]
        anchor = self._mouth(track[0])
        last, last_pose = anchor, track[0]
        directions: tuple[float, ...] | None = None
        for pose in track[1:]:
            ends = self._mouth(pose)
            if ends == last:
                last_pose = pose
                continue
            long = pose.time_s - kept[-1].time_s > _CHUNK_S
            if directions is not None and (long or not _straight(anchor, directions, ends)):
                kept.append(last_pose)
                anchor, directions = last, None
            if directions is None:
                directions = tuple(e - a for e, a in zip(ends, anchor, strict=True))
            last, last_pose = ends, pose
        if last_pose is not kept[-1]:
            kept.append(last_pose)
        return kept

    def _report(
        self,
        track: list[TimedPose],
        times: Floats,
        swept: Mask,
        body: Mask,
        lane_length_m: float | None,
    ) -> CoverageReport:
        raster, regions, width = self.regions.raster, self.regions, self._model.cleaning_width_m
        steps = (math.dist(a[1:3], b[1:3]) for a, b in pairwise(track))
        path_m = sum(step for step in steps if step <= _JUMP_M)
        duration_s = track[-1].time_s - track[0].time_s if track else 0.0
        hole_cm2, inradius_m = self._holes(regions.sweepable & ~swept)
        swept_m2 = raster.area_m2(swept)
        coverage = Coverage(
            mouth_sweepable=_share(swept & regions.sweepable, regions.sweepable),
            mouth_free=_share(swept, regions.free),
            body_reachable=_share(body & regions.reachable, regions.reachable),
            body_free=_share(body, regions.free),
            eq8=None if lane_length_m is None else lane_length_m * width / max(self.free_m2, 1e-12),
        )
        ordered = np.sort(times[regions.sweepable])
        return CoverageReport(
            coverage=coverage,
            free_m2=self.free_m2,
            reachable_m2=self.reachable_m2,
            sweepable_m2=self.sweepable_m2,
            duration_s=duration_s,
            path_m=path_m,
            t90_s=_passed(ordered, _T90),
            t99_s=_passed(ordered, _T99),
            largest_hole_cm2=hole_cm2,
            hole_inradius_m=inradius_m,
            repeat_ratio=path_m * width / swept_m2 - 1.0 if swept_m2 > 0.0 else None,
            path_ratio=path_m * width / max(self.sweepable_m2, 1e-12),
            time_ratio=duration_s / max(self.reference_time_s, 1e-12),
            reference_time_s=self.reference_time_s,
            first_swept_s=times,
            body_swept=body,
            origin_m=(raster.x_min_m, raster.y_min_m),
            resolution_m=raster.resolution_m,
        )

    def _holes(self, left: Mask) -> tuple[float, float]:
        """Area of the largest unswept piece (cm²) and the largest inscribed radius (m)."""
        from scipy import ndimage  # noqa: PLC0415 - heavy, and only metrics need it

        if not left.any():
            return 0.0, 0.0
        raster = self.regions.raster
        labels, _ = ndimage.label(left)
        largest = int(np.bincount(labels.ravel())[1:].max())
        depth = float(ndimage.distance_transform_edt(np.pad(left, 1)).max())
        # from a cell's centre to the centre of the first cell outside: the edge is half a cell
        # nearer
        inradius_m = max(depth - 0.5, 0.0) * raster.resolution_m
        return largest * raster.cell_m2 * 1e4, inradius_m


def _straight(anchor: Sequence[float], directions: Sequence[float], ends: Sequence[float]) -> bool:
    """Whether both ends lie on the lines that they set out along, and go on along them."""
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


def _unbroken(track: list[TimedPose]) -> list[list[TimedPose]]:
    """The track cut where it jumps."""
    parts: list[list[TimedPose]] = [track[:1]] if track else []
    for a, b in pairwise(track):
        if math.dist(a[1:3], b[1:3]) > _JUMP_M:
            parts.append([])
        parts[-1].append(b)
    return parts


def _moving(path: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """A path without the points at which it stands still."""
    kept = path[:1]
    kept.extend(b for a, b in pairwise(path) if a != b)
    return kept


def _share(part: Mask, whole: Mask) -> float:
    total = int(np.count_nonzero(whole))
    return int(np.count_nonzero(part)) / total if total else 0.0


def _passed(ordered_s: Floats, share: float) -> float | None:
    """When a share of the cells was swept, from their sorted times."""
    if not len(ordered_s):
        return None
    time_s = float(ordered_s[math.ceil(share * len(ordered_s)) - 1])
    return time_s if math.isfinite(time_s) else None
