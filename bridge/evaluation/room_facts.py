"""Properties of a room for a robot: areas, and unreachable floor where the robot would fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

from bridge.evaluation.regions import find_regions

if TYPE_CHECKING:
    from bridge.evaluation.regions import Regions
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_FINEST_M = 0.01
"""Minimum cell size of a picture, m."""
_MAX_CELLS = 4_000_000
"""Maximum number of cells of the raster. It is 400 m² with cells of 1 cm, which takes 2 s. A larger
room has larger cells."""


class Separate(NamedTuple):
    """Floor where the robot fits, but which it cannot reach from the start."""

    area_m2: float
    """Area of the possible positions of the axle's centre, m²."""
    x_m: float
    y_m: float
    """y of the position that is farthest from all walls, m."""


@dataclass(frozen=True, slots=True)
class RoomFacts:
    """Areas of a room for one robot."""

    regions: Regions
    free_m2: float
    reachable_m2: float
    sweepable_m2: float
    separate: tuple[Separate, ...]
    """Pieces of floor that cannot be reached, the largest first."""


def room_facts(plan: FloorPlan, model: RobotModel) -> RoomFacts:
    """Measure a room for a robot that begins at the room's start."""
    x0, y0, x1, y1 = plan.bounds()
    resolution_m = max(_FINEST_M, math.sqrt((x1 - x0) * (y1 - y0) / _MAX_CELLS))
    regions = find_regions(plan, model, resolution_m)
    raster = regions.raster
    return RoomFacts(
        regions,
        raster.area_m2(regions.free),
        raster.area_m2(regions.reachable),
        raster.area_m2(regions.sweepable),
        _separate(regions, model.radius_m),
    )


def _separate(regions: Regions, radius_m: float) -> tuple[Separate, ...]:
    """Find separate pieces by distances from walls, with one cell of tolerance for the raster."""
    raster = regions.raster
    inside = np.pad(regions.free, 1)
    depth_m = ndimage.distance_transform_edt(inside)[1:-1, 1:-1] * raster.resolution_m
    fits = depth_m >= radius_m + raster.resolution_m
    labels, count = ndimage.label(fits, np.ones((3, 3)))
    reached = set(np.unique(labels[regions.centres]).tolist())
    found = []
    for label in range(1, count + 1):
        if label in reached:
            continue
        piece = labels == label
        row, column = np.unravel_index(int(np.argmax(np.where(piece, depth_m, 0.0))), piece.shape)
        x_m, y_m = float(raster.x[row, column]), float(raster.y[row, column])
        found.append(Separate(raster.area_m2(piece), x_m, y_m))
    return tuple(sorted(found, reverse=True))
