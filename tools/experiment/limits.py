"""What limits a planner: the same runs with a perfect pose, and what is left split by cause."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy import ndimage

from bridge.evaluation.metrics import CoverageMeter

if TYPE_CHECKING:
    from bridge.evaluation.raster import Mask, Raster
    from bridge.evaluation.regions import Regions
    from bridge.motion.estimation.estimator import PoseEstimator
    from bridge.motion.geometry import Pose2
    from sim_device.sweeper import VirtualSweeper
    from tools.experiment.observed import Observed
    from tools.virtual.run import VirtualRun

CAUSES = {
    "pose": "swept by the robot's own estimate, but not in truth",
    "false evidence": "the planner's map forbids every place of the axle from which to sweep it",
    "wall gap": "only an axle within 2 cm of touching a wall or an obstacle sweeps it",
    "lane gap": "farther inside, in a piece into which no disc of 4 cm radius fits",
    "early end": "the rest: known to be open and not swept when the run ended",
}
"""In the order in which they are asked of a cell: the first that holds is its cause."""
_CONTACT_M = 0.02
_SLIVER_M = 0.04
_MAP_SLACK_M = 0.025
"""A map of 2 cm cells may forbid so much more than the truth without being false."""


class TruePose:
    """The host's estimator, but that its pose is the plant's own."""

    def __init__(self, inner: PoseEstimator, device: VirtualSweeper) -> None:
        """``inner`` is fed as before, so that all else that it tells stays as it is."""
        self._inner, self._device = inner, device

    @property
    def pose(self) -> Pose2:
        """The truth at this moment."""
        return self._device.plant.pose

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the inner one has
        return getattr(self._inner, name)


def give_true_pose(run: VirtualRun) -> None:
    """Let planner and controllers have the true pose."""
    run.host.localisation.estimator = cast(
        "PoseEstimator", TruePose(run.host.estimator, run.device)
    )


def split_loss(observed: Observed, planner: object) -> dict[str, float]:
    """Share of the sweepable floor lost, by cause."""
    meter = CoverageMeter(observed.plan, observed.model)
    swept = np.isfinite(meter.measure(observed.truth).first_swept_s)
    believed = np.isfinite(meter.measure(observed.estimate).first_swept_s)
    forbidden = forbidden_axle(planner, meter.regions.raster)
    end = observed.estimate[-1][1:3] if observed.estimate else (0.0, 0.0)
    return classify(meter.regions, observed.model.cleaning_width_m, swept, believed, forbidden, end)


def classify(  # noqa: PLR0913, PLR0917 - truth and belief
    regions: Regions,
    width_m: float,
    swept: Mask,
    believed: Mask,
    forbidden: Mask | None,
    end_m: tuple[float, float],
) -> dict[str, float]:
    """Share of the sweepable floor lost, by cause; each unswept cell has one.

    Args:
        regions: the room's, from the truth.
        width_m: of the mouth, which must sit on the axle.
        swept: in truth.
        believed: swept if the estimate were the truth.
        forbidden: where the planner's map says that the axle cannot be; ``None``: it has none.
        end_m: where the robot believes to stand at the end.

    """
    raster = regions.raster
    cell, half = raster.resolution_m, 0.5 * width_m
    left = regions.sweepable & ~swept
    pose = left & believed
    false = _unreachable(raster, forbidden, end_m, half) & left & ~pose
    inner = ndimage.distance_transform_edt(np.pad(regions.centres, 1))[1:-1, 1:-1]
    lanes = _within(inner > _CONTACT_M / cell, half / cell)
    wall = left & ~pose & ~false & ~lanes
    rest = left & ~pose & ~false & ~wall
    slivers = rest & ~_thick(rest, _SLIVER_M / cell)
    total = max(int(np.count_nonzero(regions.sweepable)), 1)
    masks = (pose, false, wall, slivers, rest & ~slivers)
    return {
        name: int(np.count_nonzero(mask)) / total for name, mask in zip(CAUSES, masks, strict=True)
    }


def forbidden_axle(planner: object, raster: Raster) -> Mask | None:
    """Where a planner's map forbids the axle, on the metrics' raster; ``None``: it keeps none."""
    memory = getattr(planner, "memory", None)
    if memory is None:
        return None
    blocked = ((memory.near > 0) | (memory.lens > 0)) & (memory.been == 0)
    x0, y0 = memory.to_metres(0.0, 0.0)
    step = memory.to_metres(1.0, 0.0)[0] - x0
    rows = np.floor((raster.y - y0) / step).astype(np.intp)
    cols = np.floor((raster.x - x0) / step).astype(np.intp)
    known = (rows >= 0) & (rows < blocked.shape[0]) & (cols >= 0) & (cols < blocked.shape[1])
    mask = np.zeros(raster.shape, dtype=np.bool_)
    mask[known] = blocked[rows[known], cols[known]]
    return mask


def _unreachable(
    raster: Raster, forbidden: Mask | None, end_m: tuple[float, float], half_m: float
) -> Mask:
    """What no axle place connected to the robot's end can sweep, by the planner's map."""
    if forbidden is None or forbidden.all():
        return raster.empty()
    labels, _ = ndimage.label(~forbidden)
    away = np.where(forbidden, np.inf, np.hypot(raster.x - end_m[0], raster.y - end_m[1]))
    mine = labels == labels[np.unravel_index(int(np.argmin(away)), raster.shape)]
    return ~_within(mine, (half_m + _MAP_SLACK_M) / raster.resolution_m)


def _within(mask: Mask, cells: float) -> Mask:
    """Cells no farther than so many cells from a mask."""
    if not mask.any():
        return np.zeros_like(mask)
    near: Mask = ndimage.distance_transform_edt(~mask) <= cells
    return near


def _thick(mask: Mask, cells: float) -> Mask:
    """The connected pieces of a mask into which a disc of so many cells fits."""
    labels, count = ndimage.label(mask)
    if not count:
        return mask
    depth = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    deepest = ndimage.maximum(depth, labels, np.arange(count + 1))
    keep = np.asarray(deepest) >= cells
    keep[0] = False
    thick: Mask = keep[labels]
    return thick


def rounded(loss: dict[str, float]) -> dict[str, float]:
    """For a file: to a millionth."""
    return {name: round(value, 6) for name, value in loss.items() if math.isfinite(value)}
