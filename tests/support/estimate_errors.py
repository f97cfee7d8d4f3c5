"""Consistency of the pose covariance with the pose errors, over whole runs.

Host, simulated link and virtual sweeper run together. The estimate is compared with the true pose
at the time of its newest encoder sample. The samples of a run are correlated, because an error
persists. So each run counts as one value, its mean, and the spread between runs gives the
confidence interval.
"""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import stats

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.virtual.loop import own_ms
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from tools.virtual.run import VirtualRun

    Floats = NDArray[np.float64]

FIRST_S = 10.0
"""Time before which samples are ignored, s. The start pose is exact, so there is no uncertainty at
first.
"""
_KEPT = 32


class Reported(NamedTuple):
    """Estimate minus truth, and the estimate's covariance: x, y (m), yaw (rad)."""

    time_s: float
    """Time since the drive began, s."""
    error: Floats
    covariance: Floats

    @property
    def nees(self) -> float:
        """Normalised estimation error squared (NEES); its mean is 3 for a consistent covariance."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))

    @property
    def yaw_nees(self) -> float:
        """NEES of the yaw alone; its mean is 1 for a consistent covariance."""
        return float(self.error[2] ** 2 / self.covariance[2, 2])


def estimate_errors(
    plan: FloorPlan, noise: str, seed: int, *, every_s: float = 10.0, planner: str = "recovery"
) -> list[Reported]:
    """Run a planner to its end; return the errors at regular times of the drive."""
    truth: dict[int, Pose2] = {}
    reported: list[Reported] = []

    def prepare(run: VirtualRun) -> None:
        device, host, step = run.device, run.host, run.device.step
        begun_s: list[float] = []

        def stepped(data: bytes, now_us: int) -> bytes:
            out = step(data, now_us)
            truth[own_ms(device)] = device.plant.pose
            if len(truth) > _KEPT:
                del truth[next(iter(truth))]
            return out

        def stepping(time_s: float, _: Pose2) -> None:
            begun_s[:] = begun_s or [time_s]
            since_s = time_s - begun_s[0]
            due_s = reported[-1].time_s + every_s if reported else FIRST_S
            true = truth.get(host.localisation.encoders_us // 1000)
            if since_s < due_s or true is None:
                return
            pose = host.estimator.pose_at(1e-6 * host.localisation.encoders_us)
            turn = math.remainder(pose.theta_rad - true.theta_rad, math.tau)
            error = np.array([pose.x_m - true.x_m, pose.y_m - true.y_m, turn])
            reported.append(Reported(since_s, error, np.array(host.estimator.covariance)))

        device.step = stepped  # type: ignore[method-assign] # only observes
        host.on_drive_pose = stepping

    run_virtual(plan, RobotModel(), planner, NullSink(), seed=seed, noise=noise, prepare=prepare)
    return reported


class Average(NamedTuple):
    """Mean of a quantity over runs, with its confidence interval."""

    mean: float
    half: float
    """Half the width of the 95 % confidence interval, from the spread between runs (Student's t).
    """

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.half:.2f}"


def average(runs: Sequence[float]) -> Average:
    """Return the mean of one value per run, for two or more runs."""
    spread = statistics.stdev(runs) / math.sqrt(len(runs))
    return Average(statistics.fmean(runs), float(stats.t.ppf(0.975, len(runs) - 1)) * spread)


def anees(runs: Sequence[Sequence[Reported]]) -> Average:
    """Return the average NEES (ANEES) of x, y and yaw."""
    return average([statistics.fmean(t.nees for t in run) for run in runs])


def yaw_anees(runs: Sequence[Sequence[Reported]]) -> Average:
    """Return the average NEES of the yaw alone."""
    return average([statistics.fmean(t.yaw_nees for t in run) for run in runs])


def share_inside(runs: Sequence[Sequence[Reported]], share: float = 0.95) -> float:
    """Return the share of the samples inside the ellipse that should hold ``share`` of them."""
    maximum = float(stats.chi2.ppf(share, 3))
    return statistics.fmean(t.nees < maximum for run in runs for t in run)
