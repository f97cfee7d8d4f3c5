"""The sweepable floor that a run leaves unswept, divided by cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.metrics import CoverageMeter

if TYPE_CHECKING:
    from bridge.coverage.planner import Planner
    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.evaluation.raster import Mask, Raster
    from bridge.evaluation.regions import Regions
    from tools.experiment.observed import Observed

CAUSES = {
    "pose": "swept by the robot's own estimate, but not in truth",
    "false evidence": "the planner's map forbids every axle position from which to sweep it",
    "wall gap": "only an axle whose footprint is within 2 cm of a wall or an obstacle sweeps it",
    "lane gap": "elsewhere, in a piece into which no disc of 4 cm radius fits",
    "early end": "the rest: free in the map, but not swept when the run ended",
}
"""Causes of lost coverage, in the order in which they are tested. The first that applies counts."""
_CONTACT_M = 0.02
"""Clearance of the footprint to a wall below which a loss is a wall gap, m."""
_SLIVER_M = 0.04
"""Radius of the disc that does not fit into a gap between lanes, m."""
_MAP_SLACK_M = 0.025
"""Error of the planner's map that is tolerated, m: one cell of 2 cm and its rounding."""


def split_loss(observed: Observed, planner: Planner) -> dict[str, float]:
    """Return the lost share of the sweepable floor by cause, for a run."""
    meter = CoverageMeter(observed.plan, observed.model)
    swept = np.isfinite(meter.measure(observed.truth).first_swept_s)
    estimated = np.isfinite(meter.measure(observed.estimate).first_swept_s)
    forbidden = None
    if isinstance(planner, RecoveryPlanner):
        forbidden = forbidden_axle(planner.context.evidence_map, meter.regions.raster)
    end = observed.estimate[-1][1:3] if observed.estimate else (0.0, 0.0)
    reach_m = observed.model.mouth_reach_m
    return classify(meter.regions, reach_m, swept, estimated, forbidden, end)


def classify(  # noqa: PLR0913, PLR0917 - one parameter for each mask
    regions: Regions,
    reach_m: float,
    swept: Mask,
    estimated: Mask,
    forbidden: Mask | None,
    end_m: tuple[float, float],
) -> dict[str, float]:
    """Return the lost share of the sweepable floor by cause; each unswept cell has one cause.

    Args:
        regions: regions of the room, from the truth.
        reach_m: greatest distance from the axle's centre at which the mouth sweeps, m.
        swept: cells that were swept.
        estimated: cells that the estimated path sweeps.
        forbidden: cells where the planner's map forbids the axle; None: the planner has no map.
        end_m: estimated position at the end, m.

    """
    raster = regions.raster
    cell = raster.resolution_m
    left = regions.sweepable & ~swept
    pose = left & estimated
    false = _unreachable(raster, forbidden, end_m, reach_m) & left & ~pose
    inner = ndimage.distance_transform_edt(np.pad(regions.centres, 1))[1:-1, 1:-1]
    lanes = _within(inner > _CONTACT_M / cell, reach_m / cell)
    wall = left & ~pose & ~false & ~lanes
    rest = left & ~pose & ~false & ~wall
    slivers = rest & ~_thick(rest, _SLIVER_M / cell)
    total = max(int(np.count_nonzero(regions.sweepable)), 1)
    masks = (pose, false, wall, slivers, rest & ~slivers)
    return {
        name: int(np.count_nonzero(mask)) / total for name, mask in zip(CAUSES, masks, strict=True)
    }


def forbidden_axle(memory: EvidenceMap, raster: Raster) -> Mask:
    """Return the cells where a planner's map forbids the axle."""
    blocked, visited = memory.places()
    shut = ((memory.inflated > 0) | (blocked > 0)) & (visited == 0)
    x0, y0 = memory.to_metres(0.0, 0.0)
    step = memory.to_metres(1.0, 0.0)[0] - x0
    rows = np.floor((raster.y - y0) / step).astype(np.intp)
    cols = np.floor((raster.x - x0) / step).astype(np.intp)
    known = (rows >= 0) & (rows < shut.shape[0]) & (cols >= 0) & (cols < shut.shape[1])
    mask = np.zeros(raster.shape, dtype=np.bool_)
    mask[known] = shut[rows[known], cols[known]]
    return mask


def _unreachable(
    raster: Raster, forbidden: Mask | None, end_m: tuple[float, float], reach_m: float
) -> Mask:
    """Return the cells that, by the planner's map, the robot cannot sweep from its last pose."""
    if forbidden is None or forbidden.all():
        return raster.empty()
    labels, _ = ndimage.label(~forbidden)
    away = np.where(forbidden, np.inf, np.hypot(raster.x - end_m[0], raster.y - end_m[1]))
    mine = labels == labels[np.unravel_index(int(np.argmin(away)), raster.shape)]
    return ~_within(mine, (reach_m + _MAP_SLACK_M) / raster.resolution_m)


def _within(mask: Mask, cells: float) -> Mask:
    """Return the cells whose distance from a mask is at most ``cells``."""
    if not mask.any():
        return np.zeros_like(mask)
    near: Mask = ndimage.distance_transform_edt(~mask) <= cells
    return near


def _thick(mask: Mask, cells: float) -> Mask:
    """Return the connected pieces of a mask into which a disc of radius ``cells`` fits."""
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
    """Round the shares to a millionth, before they are written to a file."""
    return {name: round(value, 6) for name, value in loss.items()}
