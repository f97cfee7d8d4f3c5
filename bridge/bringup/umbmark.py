"""UMBmark: calibration of systematic odometry errors by squares in both directions. No I/O.

Source: J. Borenstein and L. Feng, "Measurement and Correction of Systematic Odometry Errors in
Mobile Robots", IEEE Transactions on Robotics and Automation 12(6), 1996 (and the report
UM-MEAM-94-22). The symbols are the source's: L the square's side, b the wheel base, E_d = D_R/D_L,
E_b = b_actual/b_nominal, ε = (absolute position - odometry's position) at the end of a run, c.g.
the centre of gravity of all runs in one direction. The report and the paper have different equation
numbers. So the equations are listed here by their result, in the order of the derivation:

- type A (wheel base): each turn has the same error α: x_cw = x_ccw = -2Lα;
- type B (diameters): each side is an arc that turns by β: x_cw = -2Lβ, x_ccw = +2Lβ;
- both together: α = (x_cw + x_ccw)/(-4L), β = (x_cw - x_ccw)/(-4L), and the same from y:
  α = (y_cw - y_ccw)/(-4L), β = (y_cw + y_ccw)/(-4L); the two are averaged;
- the arc's radius R = (L/2)/sin(β/2), hence E_d = (R + b/2)/(R - b/2);
- E_b = 90°/(90° - α);
- the correction does not change the mean diameter: c_l = 2/(E_d + 1), c_r = 2/(1/E_d + 1).

These equations are of first order. For errors of 1 %, the remaining error of E_b is a few tenths of
a per cent. ``refine`` starts from their result and fits E_d and E_b to the same ε. It integrates
the recorded counts, without approximation. Squares do not show the mean diameter (the source's
E_s). ``straight_scale`` measures it on a straight path.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from bridge.motion.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bridge.motion.robot_model import RobotModel

    Counts = Sequence[tuple[int, int]] | NDArray[np.int64]

_DONE = 1e-9
"""Relative tolerance of the least-squares fit. It is much smaller than the effect of one count."""
MEASURED_M = 0.005
"""Error of a measurement with a tape, m."""
_ORIGIN = Pose2(0.0, 0.0, 0.0)


class SquareRun(NamedTuple):
    """One square: the encoder counts, and the measured end position."""

    clockwise: bool
    counts: Counts
    """Counts of the left and the right wheel in each interval."""
    end_x_m: float
    """Measured end position in the frame of the start, forwards, m."""
    end_y_m: float
    """Measured end position in the frame of the start, to the left, m."""


class Correction(NamedTuple):
    """Correction factors of the robot's model."""

    wheel_ratio: float
    """E_d: ratio of the right to the left wheel diameter."""
    base_factor: float
    """E_b: ratio of the actual to the nominal wheel base."""
    alpha_rad: float
    beta_rad: float

    def applied_to(self, model: RobotModel) -> RobotModel:
        """Return the corrected model."""
        return replace(
            model,
            wheel_ratio=model.wheel_ratio * self.wheel_ratio,
            wheel_base_m=model.wheel_base_m * self.base_factor,
        )


class Benchmark(NamedTuple):
    """UMBmark's error measures of a set of runs, m."""

    clockwise: tuple[float, float]
    """Centre of gravity of the return errors ε."""
    counter_clockwise: tuple[float, float]

    @property
    def worst_m(self) -> float:
        """E_max,syst: the larger of the two centres' distances from the origin, m."""
        return max(math.hypot(*self.clockwise), math.hypot(*self.counter_clockwise))


def odometry(model: RobotModel, counts: Counts) -> Pose2:
    """Return the end pose of a run, from the encoders only (eq. 4 and 5 of the paper)."""
    if not len(counts):
        return _ORIGIN
    # Vectorised over all intervals for speed. The device ends the session if the host is silent for
    # too long.
    per_count_m = (model.left_metres_per_count, model.right_metres_per_count)
    left, right = np.transpose(np.asarray(counts) * per_count_m)
    turns = (right - left) / model.wheel_base_m
    after = np.cumsum(turns)
    chords_m = 0.5 * (left + right) * np.sinc(turns / (2.0 * math.pi))
    mid = after - 0.5 * turns
    x_m, y_m = np.sum(chords_m * np.cos(mid)), np.sum(chords_m * np.sin(mid))
    return Pose2(float(x_m), float(y_m), wrap_angle(float(after[-1])))


def errors(model: RobotModel, runs: Sequence[SquareRun]) -> list[tuple[float, float]]:
    """Return ε of each run: the measured end position minus the odometry's end position, m."""
    found = []
    for run in runs:
        pose = odometry(model, run.counts)
        found.append((run.end_x_m - pose.x_m, run.end_y_m - pose.y_m))
    return found


def benchmark(model: RobotModel, runs: Sequence[SquareRun]) -> Benchmark:
    """Return the error measures of a set of runs with a model.

    Raises:
        ValueError: one of the directions was not driven.

    """
    centres = []
    for clockwise in (True, False):
        own = [r for r in runs if r.clockwise is clockwise]
        if not own:
            raise ValueError("the square must be driven in both directions")
        found = errors(model, own)
        centres.append((sum(x for x, _ in found) / len(own), sum(y for _, y in found) / len(own)))
    return Benchmark(*centres)


def scatter_m(model: RobotModel, runs: Sequence[SquareRun]) -> float:
    """Return the standard deviation of ε about its direction's centre of gravity, m; 0: unknown."""
    square, freedom = 0.0, 0
    for clockwise in (True, False):
        found = errors(model, [r for r in runs if r.clockwise is clockwise])
        if len(found) > 1:
            centre = [sum(values) / len(found) for values in zip(*found, strict=True)]
            square += sum(math.dist(each, centre) ** 2 for each in found)
            freedom += len(found) - 1
    return math.sqrt(square / freedom) if freedom else 0.0


def refutation(
    before: Benchmark, after: Benchmark, verified: Benchmark, scatter_of_centre_m: float = 0.0
) -> str | None:
    """Return the reason why new squares contradict a correction; None if they confirm it.

    Args:
        before: Errors of the runs from which the correction was computed.
        after: Errors of the same runs with the corrected model: the prediction. The remaining error
            is scatter. The fit uses two of four degrees of freedom, so it hides half of the
            scatter.
        verified: Errors of new runs, driven and evaluated with the corrected model.
        scatter_of_centre_m: Standard error of a centre of gravity, m, if each direction was driven
            again.

    """
    limit_m = MEASURED_M + max(2.0 * after.worst_m, after.worst_m + 3.0 * scatter_of_centre_m)
    found = f"the error of the new squares is {1000 * verified.worst_m:.1f} mm"
    if verified.worst_m > max(before.worst_m, MEASURED_M):
        return f"{found}; with the old values it was {1000 * before.worst_m:.1f} mm"
    if verified.worst_m > limit_m:
        return (
            f"{found}; predicted were {1000 * after.worst_m:.1f} mm, "
            f"at most {1000 * limit_m:.1f} mm would confirm that"
        )
    return None


def borenstein(model: RobotModel, runs: Sequence[SquareRun], side_m: float) -> Correction:
    """Return the correction by the source's closed-form equations, relative to ``model``.

    Raises:
        ValueError: one of the directions was not driven.

    """
    (x_cw, y_cw), (x_ccw, y_ccw) = benchmark(model, runs)
    alpha = 0.5 * ((x_cw + x_ccw) + (y_cw - y_ccw)) / (-4.0 * side_m)
    beta = 0.5 * ((x_cw - x_ccw) + (y_cw + y_ccw)) / (-4.0 * side_m)
    return Correction(_ratio(beta, side_m, model.wheel_base_m), _base(alpha), alpha, beta)


def _ratio(beta: float, side_m: float, base_m: float) -> float:
    if beta == 0.0:
        return 1.0
    radius_m = 0.5 * side_m / math.sin(0.5 * beta)
    return (radius_m + 0.5 * base_m) / (radius_m - 0.5 * base_m)


def _base(alpha: float) -> float:
    return 0.5 * math.pi / (0.5 * math.pi - alpha)


def refine(model: RobotModel, runs: Sequence[SquareRun], start: Correction) -> Correction:
    """Fit E_d and E_b by least squares, so that the recorded counts give the measured ends.

    The fit starts at the result of the closed-form equations, and uses scipy's trust region method.
    """
    kept = [run._replace(counts=np.asarray(run.counts)) for run in runs]

    def residuals(values: NDArray[np.float64]) -> list[float]:
        ratio, base = values
        corrected = Correction(ratio, base, 0.0, 0.0).applied_to(model)
        return [value for error in errors(corrected, kept) for value in error]

    begin = (start.wheel_ratio, start.base_factor)
    found = least_squares(residuals, begin, xtol=_DONE, ftol=_DONE, gtol=_DONE)
    return Correction(float(found.x[0]), float(found.x[1]), start.alpha_rad, start.beta_rad)


def straight_scale(model: RobotModel, counts: Counts, measured_m: float) -> float:
    """Return the source's E_s: a straight path's measured length divided by its odometry length.

    Raises:
        ValueError: the robot did not move.

    """
    pose = odometry(model, counts)
    distance_m = math.hypot(pose.x_m, pose.y_m)
    if distance_m <= 0.0:
        raise ValueError("the robot did not move")
    return measured_m / distance_m
