"""Yaw from flat walls seen again by the side infrared.

While the robot drives straight past a wall, the infrared's hits form a line in the frame of
the estimate. The first such line is a reference; a later one that runs along it, or at a
right angle to it as walls do, tells how far the heading has drifted meanwhile. Surfaces at
other angles become references of their own; what is curved, short or in doubt is passed
over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount, RobotModel

MIN_SPAN_M = 0.11
"""The shortest stretch that is fitted; a side step of one cleaning width gives 0.12 m."""
REFERENCE_SPAN_M = 0.25
"""A new reference must be better known than what it will correct."""
MAX_SPAN_M = 0.60
MIN_HITS = 8
RANGE_SIGMA_M = 0.002
"""Infrared noise after calibration (1.5 mm) and its wire step of 1.25 mm."""
MAX_RESIDUAL_M = 0.004
MAX_BOW_M = 0.003
"""A column of 0.7 m diameter bows 5 mm over the shortest stretch."""
JUMP_M = 0.012
STRAIGHT_RAD_S = 0.08
MOVING_M_S = 0.03
MIN_SIGMA_RAD = math.radians(0.15)
"""Walls are not perfectly flat, nor perfectly square to one another."""
GATE_SIGMAS = 3.0
GATE_RAD = math.radians(5.0)
APART_RAD = math.radians(10.0)
"""Between the gate and this a line is neither seen again nor new: passed over."""
MAX_REFERENCES = 8
_QUARTER = math.pi / 2


class WallLine(NamedTuple):
    """A straight stretch of wall in the frame of the estimate."""

    angle_rad: float
    sigma_rad: float
    span_m: float


@dataclass(slots=True)
class _Reference:
    angle_rad: float
    variance: float


class YawFix(NamedTuple):
    """A measurement of the heading's error."""

    error_rad: float
    """Estimated heading less the true one, as far as this wall tells."""
    variance: float


class LineTracker:
    """One side's hits: collects a stretch, fits it when it ends."""

    def __init__(self, mount: RangerMount) -> None:
        self._mount = mount
        self._hits: list[tuple[float, float]] = []
        self._last_m = 0.0

    def add(self, pose: Pose2, range_m: float | None, *, straight: bool) -> WallLine | None:
        """Take one reading; give the line of the stretch that it ends, if any."""
        line = None
        broken = range_m is None or not straight
        if broken or (self._hits and range_m is not None and abs(range_m - self._last_m) > JUMP_M):
            line = self.end()
        if broken or range_m is None:
            return line
        mount = self._mount
        self._hits.append(
            pose.transform(
                mount.x_m + range_m * math.cos(mount.yaw_rad),
                mount.y_m + range_m * math.sin(mount.yaw_rad),
            )
        )
        self._last_m = range_m
        if math.dist(self._hits[0], self._hits[-1]) >= MAX_SPAN_M:
            return self.end()
        return line

    def end(self) -> WallLine | None:
        """Fit and forget the stretch."""
        hits, self._hits = self._hits, []
        return fit_line(hits)


def fit_line(hits: list[tuple[float, float]]) -> WallLine | None:
    """Total least squares with a check for bow; None where the hits are no flat wall."""
    count = len(hits)
    if count < MIN_HITS:
        return None
    mean_x = sum(x for x, _ in hits) / count
    mean_y = sum(y for _, y in hits) / count
    sxx = sum((x - mean_x) ** 2 for x, _ in hits)
    syy = sum((y - mean_y) ** 2 for _, y in hits)
    sxy = sum((x - mean_x) * (y - mean_y) for x, y in hits)
    angle = 0.5 * math.atan2(2.0 * sxy, sxx - syy)
    c, s = math.cos(angle), math.sin(angle)
    along = [(x - mean_x) * c + (y - mean_y) * s for x, y in hits]
    across = [(y - mean_y) * c - (x - mean_x) * s for x, y in hits]
    span = max(along) - min(along)
    moment = sum(a * a for a in along)
    if span < MIN_SPAN_M or math.sqrt(sum(e * e for e in across) / count) > MAX_RESIDUAL_M:
        return None
    # Bow: the share of the residual that follows along² once its mean is taken off.
    mean_square = moment / count
    shape = [a * a - mean_square for a in along]
    weight = sum(q * q for q in shape)
    bow = abs(sum(q * e for q, e in zip(shape, across, strict=True)) / weight) * span * span / 4
    if bow > MAX_BOW_M:
        return None
    sigma = math.hypot(RANGE_SIGMA_M / math.sqrt(moment), MIN_SIGMA_RAD)
    return WallLine(angle, sigma, span)


class WallYaw:
    """Both sides' lines, the references, and the heading errors that follow."""

    def __init__(self, model: RobotModel) -> None:
        self._sides = (LineTracker(model.infrared_left), LineTracker(model.infrared_right))
        self._references: list[_Reference] = []

    @property
    def grid_rad(self) -> float | None:
        """Direction of the first wall seen, or None before it."""
        return self._references[0].angle_rad if self._references else None

    def update(  # noqa: PLR0913, PLR0917 - one reading of both sides and the motion
        self,
        pose: Pose2,
        v_m_s: float,
        yaw_rate_rad_s: float,
        left_m: float | None,
        right_m: float | None,
        yaw_variance: float,
    ) -> list[YawFix]:
        """Take one pair of readings; ``yaw_variance`` is the estimate's own, in rad²."""
        straight = abs(yaw_rate_rad_s) < STRAIGHT_RAD_S and abs(v_m_s) > MOVING_M_S
        fixes: list[YawFix] = []
        for side, range_m in zip(self._sides, (left_m, right_m), strict=True):
            line = side.add(pose, range_m, straight=straight)
            if line is not None:
                fix = self._compare(line, yaw_variance)
                if fix is not None:
                    fixes.append(fix)
        return fixes

    def _compare(self, line: WallLine, yaw_variance: float) -> YawFix | None:
        variance = line.sigma_rad**2
        nearest = min(
            self._references,
            key=lambda r: abs(_wrap_quarter(line.angle_rad - r.angle_rad)),
            default=None,
        )
        error = 0.0 if nearest is None else _wrap_quarter(line.angle_rad - nearest.angle_rad)
        if nearest is None or abs(error) > APART_RAD:
            if line.span_m >= REFERENCE_SPAN_M and len(self._references) < MAX_REFERENCES:
                self._references.append(_Reference(line.angle_rad, variance + yaw_variance))
            return None
        total = variance + nearest.variance + yaw_variance
        if abs(error) > min(GATE_RAD, GATE_SIGMAS * math.sqrt(total)):
            return None
        # The wall and the heading share the surprise by what was unsure of each.
        gain = nearest.variance / total
        nearest.angle_rad += gain * error
        seen = YawFix(error, variance + nearest.variance)
        nearest.variance *= 1.0 - gain
        return seen


def _wrap_quarter(angle_rad: float) -> float:
    """Wrap to [-45°, 45°): walls stand at right angles."""
    return (angle_rad + _QUARTER / 2) % _QUARTER - _QUARTER / 2
