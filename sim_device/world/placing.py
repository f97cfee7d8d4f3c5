"""Computes the place of the robot after a change of the room."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_device.world.world import World

_PASSES = 32
_FREE_M = 1e-9


def pushed_free(before: World, after: World, x_m: float, y_m: float) -> tuple[float, float] | None:
    """Return the new place of a disc at (x, y) when the room changes to ``after``.

    An obstacle that overlaps the disc pushes the disc out on the shortest path. The push is
    repeated if it ends in another obstacle. The result is None if no free place within the disc's
    diameter can be reached; the disc is then held.
    """
    x, y, radius = x_m, y_m, after.radius_m
    for _ in range(_PASSES):
        wall = after.nearest(x, y)
        floor = after.is_floor(x, y)
        if floor and wall.distance_m >= radius - _FREE_M:
            break
        out = radius if floor else -radius  # inside an obstacle, the disc must move past the edge
        x = wall.x_m + out * wall.normal_x
        y = wall.y_m + out * wall.normal_y
    else:
        return None
    moved2 = (x - x_m) ** 2 + (y - y_m) ** 2
    if moved2 > 4.0 * radius * radius:
        return None
    stood = {tuple(row) for row in before.edges[:, :4].tolist()}
    for row in after.edges[:, :4].tolist():
        if tuple(row) in stood and _crosses((x_m, y_m), (x, y), row):
            return None
    return x, y


def _crosses(a: tuple[float, float], b: tuple[float, float], edge: list[float]) -> bool:
    """Return whether the line from a to b crosses an edge, given as corner and vector."""
    px, py, ex, ey = edge
    dx, dy = b[0] - a[0], b[1] - a[1]
    cross = dx * ey - dy * ex
    if cross == 0.0:
        return False
    t = ((px - a[0]) * ey - (py - a[1]) * ex) / cross
    u = ((px - a[0]) * dy - (py - a[1]) * dx) / cross
    return 0.0 <= t <= 1.0 and 0.0 <= u <= 1.0
