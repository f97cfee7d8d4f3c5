"""Holes: pieces of the sweepable floor that were not swept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.evaluation import raster_kernel as kernel

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
    labels, _ = kernel.pieces(left, 1)
    largest = int(np.bincount(labels.ravel())[1:].max())
    depth = kernel.deepest(left)
    # The depth ends at the centre of the first cell outside. The edge is half a cell nearer.
    inradius_m = max(depth - 0.5, 0.0) * raster.resolution_m
    return largest * raster.cell_m2 * 1e4, inradius_m
