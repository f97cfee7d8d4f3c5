"""Carpets of a room, and their effect on a wheel: drag and lost travel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython
import numpy as np

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan


@cython.boundscheck(True)  # noqa: FBT003 - a directive: these are Python's own tuples
@cython.wraparound(True)  # noqa: FBT003 - as above
def carpet_rows(plan: FloorPlan) -> NDArray[np.float64]:
    """Return one row per carpet edge: corners (4), number of the carpet, drag (N), slip.

    The shape is ``(edges, 7)``; the rows of one carpet are consecutive.
    """
    rows = [
        (*carpet.polygon[i - 1], *carpet.polygon[i], number, carpet.drag_n, carpet.slip)
        for number, carpet in enumerate(plan.carpets)
        for i in range(len(carpet.polygon))
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def carpet_under(x_m: cython.double, y_m: cython.double, carpets: FloatGrid) -> tuple[float, float]:
    """Return a wheel's drag (N) at a point, and the share of its travel that is lost."""
    drag, slip = 0.0, 0.0
    inside: cython.bint = False
    for i in range(carpets.shape[0]):
        ax, ay, bx, by = carpets[i, 0], carpets[i, 1], carpets[i, 2], carpets[i, 3]
        if (ay > y_m) != (by > y_m) and x_m < (bx - ax) * (y_m - ay) / (by - ay) + ax:
            inside = not inside
        if i + 1 == carpets.shape[0] or carpets[i + 1, 4] != carpets[i, 4]:
            if inside:
                drag += 0.5 * carpets[i, 5]
                slip += carpets[i, 6]
            inside = False
    return drag, min(slip, 1.0)
