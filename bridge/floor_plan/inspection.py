"""Search for probable mistakes in a valid room file, for ``sweepctl room check``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.errors import MAX_PROBLEMS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.floor_plan.floor_plan import FloorPlan, Point, Polygon

_MAX_CORNERS = 5000
"""Maximum number of corners of a polygon that is checked for crossings. The computing time grows
with the square of the number. At this maximum it is 1 s."""


def plan_cautions(plan: FloorPlan) -> list[str]:
    """Return the probable mistakes, each with its key."""
    found = list(_crossings(plan))
    found += [
        f"{key}: it lies outside the walls"
        for key, polygon in _on_floor(plan)
        if not _near_inside(plan.walls, polygon)
    ]
    return found[:MAX_PROBLEMS]


def _on_floor(plan: FloorPlan) -> Iterator[tuple[str, Polygon]]:
    yield from ((f"obstacles[{i}]", polygon) for i, polygon in enumerate(plan.obstacles))
    yield from ((f"carpets[{i}].polygon", each.polygon) for i, each in enumerate(plan.carpets))
    yield from (
        (f"thresholds[{i}].line", (each.begin, each.end)) for i, each in enumerate(plan.thresholds)
    )
    yield from ((f"cliffs[{i}]", polygon) for i, polygon in enumerate(plan.cliffs))


def _near_inside(walls: Polygon, polygon: Polygon) -> bool:
    """Return True if the bounding boxes overlap. A carpet may be larger than the room."""
    room, shape = np.asarray(walls), np.asarray(polygon)
    overlap = (shape.min(axis=0) <= room.max(axis=0)) & (shape.max(axis=0) >= room.min(axis=0))
    return bool(np.all(overlap))


def _crossings(plan: FloorPlan) -> Iterator[str]:
    polygons = [("walls", plan.walls), *_on_floor(plan)]
    for key, polygon in polygons:
        if key.startswith("thresholds") or len(polygon) > _MAX_CORNERS:
            continue
        at = _first_crossing(polygon)
        if at is not None:
            yield (
                f"{key}: its outline crosses itself near ({at[0]:.2f}, {at[1]:.2f}); "
                f"check the order of its corners"
            )


def _first_crossing(polygon: Polygon) -> Point | None:
    """Return a crossing of two edges that are not neighbours; None: no edges cross."""
    begin = np.asarray(polygon)
    end = np.roll(begin, -1, axis=0)
    along = end - begin
    count = len(polygon)
    for i in range(count - 2):
        others = slice(i + 2, count - (i == 0))  # not the neighbours
        to_other = begin[others] - begin[i]
        cross = along[i, 0] * along[others, 1] - along[i, 1] * along[others, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            here = (to_other[:, 0] * along[others, 1] - to_other[:, 1] * along[others, 0]) / cross
            there = (to_other[:, 0] * along[i, 1] - to_other[:, 1] * along[i, 0]) / cross
        hits = np.flatnonzero((here > 0.0) & (here < 1.0) & (there > 0.0) & (there < 1.0))
        if hits.size:
            x_m, y_m = begin[i] + here[hits[0]] * along[i]
            return float(x_m), float(y_m)
    return None
