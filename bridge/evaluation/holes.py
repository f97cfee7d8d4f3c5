"""Holes: pieces of the sweepable floor that were not swept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from bridge.evaluation.raster import Mask, Raster


def largest_hole(raster: Raster, left: Mask) -> tuple[float, float]:
    """Return the area of the largest unswept piece (cm²) and the largest inscribed radius (m).

    Args:
        raster: the grid of the floor plan.
        left: True in each unswept cell of the sweepable floor.

    """
    if not left.any():
        return 0.0, 0.0
    labels, _ = ndimage.label(left)
    largest = int(np.bincount(labels.ravel())[1:].max())
    depth = depth_cells(left)
    # The depth ends at the centre of the first cell outside. The edge is half a cell nearer.
    inradius_m = max(depth - 0.5, 0.0) * raster.resolution_m
    return largest * raster.cell_m2 * 1e4, inradius_m


def depth_cells(mask: Mask) -> float:
    """Return the maximum distance, in cells, from a cell in the mask to the nearest cell outside.

    Points outside the raster count as outside the mask.
    """
    return float(ndimage.distance_transform_edt(np.pad(mask, 1)).max())
