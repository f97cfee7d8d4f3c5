"""A disc against edges: how far it is, and where a wall lets it go.

Plain Python over the few edges near the robot: for a handful that beats arrays by far.
Quasi-static: the wall takes the part of a move that goes into it, and friction takes some of
what is left along it (Coulomb's law in displacements: the blocked part times the
coefficient). A push straighter than friction's cone does not slide at all.
"""

from __future__ import annotations

from math import hypot, sqrt
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sim_device.world import Edge

TOUCH_M = 2e-5
"""A gap below this is contact: far below any sensor, far above rounding."""
PENETRATION_M = 1e-9
"""The disc never sticks further into a wall than this (nor than the start did)."""
COLLISION_SPEED_M_S = 0.03
"""Slower onsets of contact are no collision."""
REARM_MS = 500
"""Time free of contact after which a collision can be counted again."""
_PASSES = 12


class Touch(NamedTuple):
    """One edge that the disc touches."""

    edge: int
    normal_x: float
    """Unit vector from the wall to the disc's centre."""
    normal_y: float


class Move(NamedTuple):
    """Where the disc ended."""

    x_m: float
    y_m: float
    touches: tuple[Touch, ...]
    gap_m: float
    """To the nearest edge given; ``inf`` without edges."""


def nearest_m(x_m: float, y_m: float, edges: Iterable[Edge]) -> float:
    """Distance from a point to the nearest of the edges; ``inf`` without edges."""
    best = float("inf")
    for ax, ay, ex, ey, inv_len2, _ in edges:
        dx, dy = x_m - ax, y_m - ay
        t = (dx * ex + dy * ey) * inv_len2
        if t > 0.0:
            if t > 1.0:  # noqa: PLR1730 - each millisecond: no call
                t = 1.0
            dx -= t * ex
            dy -= t * ey
        d2 = dx * dx + dy * dy
        best = min(best, d2)
    return sqrt(best)


def move_disc(  # noqa: PLR0913, PLR0917 - positional because it is called each millisecond
    x_m: float,
    y_m: float,
    dx_m: float,
    dy_m: float,
    radius_m: float,
    edges: list[Edge],
    touching: tuple[Touch, ...],
    friction: float,
) -> Move:
    """Move a disc by (dx, dy) as far as the walls allow.

    Args:
        x_m: Centre before the move, free of walls; so ``y_m``.
        y_m: See ``x_m``.
        dx_m: The move, short against the radius; so ``dy_m``.
        dy_m: See ``dx_m``.
        radius_m: Of the disc.
        edges: All edges that the move could reach.
        touching: What the disc touched before the move.
        friction: Coefficient between the disc's rim and a wall.

    """
    if touching:
        dx_m, dy_m = _along_walls(dx_m, dy_m, touching, friction)
    x, y = x_m + dx_m, y_m + dy_m
    for _ in range(_PASSES):
        settled = _settle(x, y, radius_m, edges)
        if settled.gap_m >= -PENETRATION_M:
            return settled
        x, y = settled.x_m, settled.y_m
    # A wedge too narrow to go into: stay.
    return _settle(x_m, y_m, radius_m, edges, push=False)


def _along_walls(
    dx: float,
    dy: float,
    touching: tuple[Touch, ...],
    friction: float,
) -> tuple[float, float]:
    """Take from a move what goes into the walls touched, and what friction holds back."""
    blocked = 0.0
    for _ in range(2):  # the second wall of a corner may send it back into the first
        for _, nx, ny in touching:
            into = dx * nx + dy * ny
            if into < 0.0:
                dx -= into * nx
                dy -= into * ny
                blocked -= into
    if blocked == 0.0:
        return dx, dy
    if len(touching) > 1:
        for _, nx, ny in touching:
            if dx * nx + dy * ny < -PENETRATION_M:
                return 0.0, 0.0
    along = hypot(dx, dy)
    kept = along - friction * blocked
    if kept <= 0.0:
        return 0.0, 0.0
    return dx * kept / along, dy * kept / along


def _settle(
    x: float,
    y: float,
    radius: float,
    edges: list[Edge],
    *,
    push: bool = True,
) -> Move:
    """Push the disc out of each edge in turn; the gap is the least met on the way."""
    touches: list[Touch] = []
    least = float("inf")
    for ax, ay, ex, ey, inv_len2, index in edges:
        dx, dy = x - ax, y - ay
        t = (dx * ex + dy * ey) * inv_len2
        if t > 0.0:
            if t > 1.0:  # noqa: PLR1730 - each millisecond: no call
                t = 1.0
            dx -= t * ex
            dy -= t * ey
        distance = sqrt(dx * dx + dy * dy)
        gap = distance - radius
        if gap < TOUCH_M:
            dx /= distance
            dy /= distance
            touches.append(Touch(index, dx, dy))
            if push and gap < -PENETRATION_M:
                x -= gap * dx
                y -= gap * dy
        least = min(gap, least)
    return Move(x, y, tuple(touches), least)


class ContactCounter:
    """Collisions and time in contact.

    A collision is an onset of contact with normal speed above 0.03 m/s on an edge not touched
    in the last millisecond (so that running into a second wall while sliding along a first
    one counts). The next one counts only after 0.5 s free of any contact. A slow onset is
    none, and does not keep a fast one after it from being one.
    """

    __slots__ = ("_armed", "_last_ms", "collisions", "contact_ms")

    def __init__(self) -> None:
        """Start armed, with nothing counted."""
        self.collisions = 0
        self.contact_ms = 0
        self._armed = True
        self._last_ms = -REARM_MS

    def count(
        self,
        tick_ms: int,
        before: tuple[Touch, ...],
        now: tuple[Touch, ...],
        vx_m_s: float,
        vy_m_s: float,
    ) -> None:
        """Count a millisecond in contact.

        Args:
            tick_ms: Its number.
            before: What was touched before it.
            now: What is touched after it; not empty.
            vx_m_s: The disc's velocity before it; so ``vy_m_s``.
            vy_m_s: See ``vx_m_s``.

        """
        if not self._armed and tick_ms - self._last_ms > REARM_MS:
            self._armed = True
        if self._armed:
            known = {touch.edge for touch in before}
            for edge, nx, ny in now:
                if edge not in known and -(vx_m_s * nx + vy_m_s * ny) > COLLISION_SPEED_M_S:
                    self.collisions += 1
                    self._armed = False
                    break
        self._last_ms = tick_ms
        self.contact_ms += 1
